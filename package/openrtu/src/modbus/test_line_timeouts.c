/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Time-outs that are learned, and what a dead device costs its line. */
#include "modbus/test_bus.h"

#define FLOOR_NS   (10 * MS)
#define REQUEST_NS (8 * bus.line.wire.char_ns)
#define LEARNED_NS                                                                                           \
	(MODBUS_LATENCY_FACTOR * (REACTION_NS + bus.line.wire.char_ns)) /* of the first character */

/* One device with eight holding registers, of whose latency something is known. */
static void start_learned(uint8_t retries)
{
	start_simple(retries);
	bus.devices[0].response_timeout_min_ns = FLOOR_NS;
	run_for(SECOND);
	forget_trace();
}

static void lose_one_answer(void)
{
	bus.slaves[0].fault = MUTE;
	bus.slaves[0].faults = 1;
	while (bus.slaves[0].faults > 0)
		run_for(MS);
}

/* ---- what is learned ------------------------------------------------------------------------------ */

static void test_nothing_is_known_of_a_device_that_never_answered(void **state)
{
	(void)state;
	set_up();
	add_device(17, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	bus.devices[0].response_timeout_min_ns = FLOOR_NS;
	bus.slaves[0].reaction_ns = TIMEOUT_NS - 2 * MS;
	start();
	assert_int_equal(bus.devices[0].timeout_ns, 0);
	run_for(SECOND);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_int_equal(bus.devices[0].timeout_ns, TIMEOUT_NS);
	/* Whatever is behind a port that is opened anew may be slower. */
	modbus_line_close(&bus.line, bus.now_ns);
	modbus_line_open(&bus.line, bus.now_ns);
	assert_int_equal(bus.devices[0].timeout_ns, 0);
}

static void test_a_lost_answer_costs_what_was_learned(void **state)
{
	(void)state;
	start_learned(1);
	bus.slaves[0].reaction_ns = 3 * REACTION_NS;
	run_for(SECOND);
	int64_t learned_ns = bus.devices[0].timeout_ns;
	assert_in_range(learned_ns, 3 * LEARNED_NS - 10 * MS, 3 * LEARNED_NS);
	lose_one_answer();
	int64_t asked_ns = bus.sent[bus.sent_count - 1].time_ns;
	forget_trace();
	run_for(SECOND);
	assert_int_equal(bus.sent[0].time_ns - asked_ns, REQUEST_NS + learned_ns);
	assert_int_equal(bus.line.counters.timeouts, 1);
	assert_int_equal(bus.deaths[0], 0);
	assert_in_range(bus.devices[0].timeout_ns, learned_ns - MS, learned_ns);
}

static void test_less_than_the_floor_is_never_waited(void **state)
{
	(void)state;
	start_simple(1);
	bus.devices[0].response_timeout_min_ns = 40 * MS;
	run_for(SECOND);
	assert_int_equal(bus.devices[0].timeout_ns, 40 * MS);
}

/* The echo of a request comes at once, and noise when it likes: neither is the device's. */
static void test_only_its_answers_are_learned_from(void **state)
{
	(void)state;
	start_learned(3);
	modbus_line_close(&bus.line, bus.now_ns);
	bus.echoing = true;
	modbus_line_open(&bus.line, bus.now_ns);
	for (int i = 0; i < 200; i++) {
		put_on_wire(bus.now_ns, (const uint8_t[]){0xAA}, 1);
		run_for(100 * MS);
	}
	assert_in_range(bus.devices[0].timeout_ns, LEARNED_NS - MS, LEARNED_NS);
}

/* A write may take its time, in an EEPROM for example: it tells nothing of reads. */
static void test_a_command_has_the_whole_response_time(void **state)
{
	(void)state;
	start_learned(1);
	bus.slaves[0].write_ns = 80 * MS;
	for (uint32_t tag = 1; tag < 10; tag++) {
		command(0, MODBUS_WRITE_REGISTER, 3, (uint16_t)tag, tag);
		run_for(SECOND);
		assert_int_equal(bus.last_tag, tag);
		assert_int_equal(bus.last_result, MODBUS_DONE);
	}
	assert_in_range(bus.devices[0].timeout_ns, LEARNED_NS - MS, LEARNED_NS);
}

static void test_a_slow_answer_is_remembered_for_thousands(void **state)
{
	(void)state;
	start_learned(1);
	bus.slaves[0].late = 1;
	bus.slaves[0].late_ns = 15 * MS;
	while (bus.slaves[0].late > 0)
		run_for(MS);
	run_for(100 * MS);
	int64_t after_ns = bus.devices[0].timeout_ns;
	assert_in_range(after_ns, LEARNED_NS + 60 * MS - MS, LEARNED_NS + 60 * MS);
	for (uint32_t done = bus.line.counters.answers + MODBUS_LATENCY_FADING / 2;
	     bus.line.counters.answers < done;)
		run_for(10 * MS);
	assert_in_range(bus.devices[0].timeout_ns, after_ns / 2, after_ns * 2 / 3);
	run_for(300 * SECOND);
	assert_in_range(bus.devices[0].timeout_ns, LEARNED_NS - MS, LEARNED_NS);
}

/* ---- devices that are slow, not dead ----------------------------------------------------------------- */

static void test_a_device_at_the_end_of_its_time_never_dies(void **state)
{
	(void)state;
	for (uint8_t retries = 0; retries < 6; retries++) {
		start_learned(retries);
		bus.slaves[0].reaction_ns = TIMEOUT_NS - bus.line.wire.char_ns - MS;
		run_for(SECOND);
		forget_trace();
		run_for(60 * SECOND);
		assert_int_equal(bus.deaths[0], 0);
		assert_int_equal(bus.line.counters.timeouts, 0);
		assert_true(bus.reads_done[0] > 60 * 7);
	}
}

/* At once slower than what was learned, by every amount. It does one thing after the other, or hears only when it is idle. */
static void test_a_device_that_gets_slower_does_not_die(void **state)
{
	(void)state;
	for (int64_t reaction = 6; reaction < 99; reaction++) {
		for (uint8_t variant = 0; variant < 12; variant++) {
			start_learned(variant / 2);
			bus.slaves[0].one_ear = variant % 2;
			bus.slaves[0].reaction_ns = reaction * MS;
			run_for(2 * SECOND);
			assert_int_equal(bus.deaths[0], 0);
			assert_true(bus.line.counters.timeouts <= 4);
			assert_in_range(bus.devices[0].timeout_ns, reaction * MS + 1, TIMEOUT_NS);
			forget_trace();
			run_for(SECOND);
			assert_int_equal(bus.line.counters.timeouts, 0);
			assert_true(bus.reads_done[0] >= 8);
		}
	}
}

/* Short reads and probes are answered at once: what they teach must not make the long one a refused one. */
static void test_a_read_that_takes_longer_than_others_is_not_refused(void **state)
{
	(void)state;
	for (uint8_t variant = 0; variant < 12; variant++) {
		start_learned(variant / 2);
		bus.slaves[0].one_ear = variant % 2;
		bus.slaves[0].long_ns = 80 * MS;
		run_for(5 * SECOND);
		assert_int_equal(bus.deaths[0], 0);
		assert_int_equal(bus.devices[0].read_count, 1);
		assert_true(bus.line.counters.timeouts <= 4);
		assert_true(bus.reads_done[0] > 30);
	}
}

/* Sound frames that answer nothing look late behind an early time-out. */
static void test_a_device_that_never_answers_right_dies(void **state)
{
	(void)state;
	for (uint8_t retries = 0; retries < 6; retries++) {
		start_learned(retries);
		bus.slaves[0].fault = WRONG_LENGTH;
		bus.slaves[0].faults = 1000000;
		run_until_dead(0, (retries + 2) * (TIMEOUT_NS + MODBUS_GAP_NS));
	}
}

/* The read before it was given up early: the device is still at it when the command comes. */
static void test_a_command_behind_a_slow_read_is_confirmed(void **state)
{
	(void)state;
	for (int64_t reaction = 10; reaction < 99; reaction++) {
		start_learned(1);
		bus.slaves[0].one_ear = reaction % 2;
		run_for(reaction % 10 * MS);
		bus.slaves[0].reaction_ns = reaction * MS;
		forget_trace();
		while (bus.line.counters.timeouts == 0 && bus.sent_count < 3)
			run_for(MS);
		command(0, MODBUS_WRITE_REGISTER, 3, (uint16_t)reaction, 1);
		run_for(SECOND);
		assert_int_equal(bus.last_tag, 1);
		assert_int_equal(bus.last_result, MODBUS_DONE);
		assert_int_equal(bus.deaths[0], 0);
	}
}

/* Late by up to MODBUS_LATE_NS behind the whole response time: on_read and on_command know what is right. */
static void test_an_early_time_out_mistakes_no_late_answer(void **state)
{
	(void)state;
	for (int64_t late = 20; late < 1090; late += 7) {
		set_up();
		add_device(17, (uint8_t)(late % 6));
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 4);
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 40, 4);
		bus.devices[0].response_timeout_min_ns = FLOOR_NS;
		start();
		run_for(SECOND);
		for (unsigned count = 1; count < 4; count++) {
			bus.slaves[0].late = count;
			bus.slaves[0].late_ns = late * MS;
			command(0, MODBUS_WRITE_REGISTER, 50, (uint16_t)(late + count), count);
			run_for(30 * SECOND);
			assert_true(bus.devices[0].alive);
			assert_int_equal(bus.commands_done, count);
		}
	}
}

/* ---- what a dead device costs -------------------------------------------------------------------------- */

struct dead_case {
	int64_t floor_ms, ceiling_ms;
	unsigned baud;
	uint8_t retries;
	uint16_t period_ms; /* of the living devices, 0: none */
	uint8_t dead;       /* so many of three */
	bool never_lived;
};

static void start_to_die(const struct dead_case *it)
{
	set_up();
	bus.line.wire = modbus_wire(it->baud, 11);
	for (uint8_t unit = 1; unit <= DEVICES_MAX; unit++) {
		add_device(unit, it->retries);
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
		for (uint32_t i = 0; unit > it->dead && i < 8; i++)
			bus.objects[unit - 1][i].period_ms = it->period_ms;
		bus.devices[unit - 1].response_timeout_ns = it->ceiling_ms * MS;
		bus.devices[unit - 1].response_timeout_min_ns = it->floor_ms * MS;
		bus.slaves[unit - 1].present = !(it->never_lived && unit <= it->dead);
	}
	start();
}

/* They live for so long that the time pays for the requests by which they are found dead. */
static void let_die(const struct dead_case *it)
{
	start_to_die(it);
	for (uint8_t i = 0; it->never_lived && i < it->dead; i++) {
		while (bus.devices[i].counters.timeouts == 0)
			run_for(MS);
		bus.died_ns[i] = bus.now_ns; /* the first probe shows it */
		bus.lost_by_death_ns[i] = bus.lost_ns[i];
	}
	if (it->never_lived)
		return;
	run_for(MODBUS_DEAD_SHARE * (it->retries + 2) * it->ceiling_ms * MS);
	for (uint8_t i = 0; i < it->dead; i++)
		bus.slaves[i].present = false;
	for (uint8_t i = 0; i < it->dead; i++)
		run_until_dead(i, 200 * SECOND);
}

/* At any time for ten minutes it is less than the share of the time since the death. */
static void assert_share_holds(uint8_t dead)
{
	for (int64_t end_ns = bus.now_ns + 600 * SECOND; bus.now_ns < end_ns; run_for(10 * MS))
		for (uint8_t i = 0; i < dead; i++)
			assert_true((bus.lost_ns[i] - bus.lost_by_death_ns[i]) * MODBUS_DEAD_SHARE <=
				    bus.now_ns - bus.died_ns[i]);
}

static void test_a_dead_device_costs_its_share_at_most(void **state)
{
	static const struct dead_case cases[] = {
	    {100, 500, 9600, 1, 0, 1, false},        {100, 500, 19200, 1, 0, 2, false},
	    {100, 500, 9600, 1, 250, 1, false},      {500, 500, 9600, 1, 0, 1, false},
	    {100, 500, 9600, 1, 0, 2, false},        {20, 20, 115200, 0, 0, 1, false},
	    {20, 10000, 19200, 5, 100, 2, false},    {10000, 10000, 9600, 5, 0, 1, false},
	    {10000, 10000, 9600, 5, 1000, 2, false}, {100, 500, 1200, 1, 0, 1, false},
	    {100, 500, 9600, 1, 0, 2, true},         {20, 10000, 9600, 5, 0, 2, true},
	    {20, 300, 9600, 0, 100, 2, true},
	};

	(void)state;
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		const struct dead_case *it = &cases[i];

		let_die(it);
		assert_share_holds(it->dead);
		for (uint8_t dead = 0; dead < it->dead; dead++) {
			assert_false(bus.devices[dead].alive);
			assert_true(bus.lost_ns[dead] > bus.lost_by_death_ns[dead]);
			bus.slaves[dead].present = true;
		}
		run_for(500 * SECOND);
		for (uint8_t dead = 0; dead < it->dead; dead++)
			assert_true(bus.devices[dead].alive);
	}
}

/* Where nobody else waits, the pauses only double: a line that was cut is found again soon. */
static void test_a_line_without_a_living_device_loses_nothing(void **state)
{
	const struct dead_case all = {500, 500, 9600, 1, 0, DEVICES_MAX, false};
	bool found = false;

	(void)state;
	let_die(&all);
	for (uint8_t i = 0; i < DEVICES_MAX; i++)
		bus.slaves[i].present = true;
	run_for(1500 * MS);
	for (uint8_t i = 0; i < DEVICES_MAX; i++)
		found |= bus.devices[i].alive;
	assert_true(found);
	run_for(10 * SECOND);
	for (uint8_t i = 0; i < DEVICES_MAX; i++)
		assert_true(bus.devices[i].alive);
}

/* The second dead device of three has no such limit, and keeps its share. */
static void test_a_pause_before_a_probe_has_the_limit_that_is_given(void **state)
{
	static const int64_t limits_s[] = {1, 2, 7, 255};
	const struct dead_case two = {100, 500, 9600, 1, 0, 2, false};

	(void)state;
	for (size_t i = 0; i < sizeof(limits_s) / sizeof(limits_s[0]); i++) {
		int64_t longest_ns = 0;

		start_to_die(&two);
		bus.devices[0].probe_max_ns = limits_s[i] * SECOND;
		run_for(MODBUS_DEAD_SHARE * 3 * two.ceiling_ms * MS);
		bus.slaves[0].present = bus.slaves[1].present = false;
		run_until_dead(0, 200 * SECOND);
		run_until_dead(1, 200 * SECOND);
		for (int64_t end_ns = bus.now_ns + 1200 * SECOND; bus.now_ns < end_ns; run_for(10 * MS)) {
			longest_ns =
			    bus.devices[0].backoff_ns > longest_ns ? bus.devices[0].backoff_ns : longest_ns;
			assert_true((bus.lost_ns[1] - bus.lost_by_death_ns[1]) * MODBUS_DEAD_SHARE <=
				    bus.now_ns - bus.died_ns[1]);
		}
		assert_int_equal(longest_ns, limits_s[i] * SECOND);
		bus.slaves[0].present = true;
		run_for(limits_s[i] * SECOND + 600 * MS);
		assert_true(bus.devices[0].alive);
		assert_false(bus.devices[1].alive);
	}
}

/* It answers for a second, then not until it was probed in vain so often, and so on. */
static void test_a_device_that_comes_and_goes_costs_its_share_too(void **state)
{
	(void)state;
	for (uint32_t in_vain = 0; in_vain < 3; in_vain++) {
		unsigned deaths = 0;

		let_die(&(const struct dead_case){100, 500, 9600, 1, 0, 1, false});
		int64_t begin_ns = bus.now_ns, lost_ns = bus.lost_ns[0];
		for (; bus.now_ns < begin_ns + 600 * SECOND; deaths++) {
			for (; !bus.devices[0].alive; run_for(MS))
				bus.slaves[0].present = bus.devices[0].failures >= in_vain;
			run_for(SECOND);
			bus.slaves[0].present = false;
			run_until_dead(0, 2 * SECOND);
		}
		assert_true(deaths > 10);
		/* the last death is not paid for yet */
		assert_true((bus.lost_ns[0] - lost_ns) * MODBUS_DEAD_SHARE <=
			    bus.now_ns - begin_ns + MODBUS_DEAD_SHARE * 700 * MS);
	}
}

/* The answer to the first probe is late then, and shows how long the second must wait. */
static void test_a_device_that_returns_slower_is_found(void **state)
{
	static const struct {
		int64_t reaction_ms, within_s;
	} cases[] = {{5, 1}, {40, 3}, {90, 3}, {98, 3}};

	(void)state;
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		start_learned(1);
		run_for(30 * SECOND);
		bus.slaves[0].present = false;
		run_until_dead(0, SECOND);
		bus.slaves[0].present = true;
		bus.slaves[0].reaction_ns = cases[i].reaction_ms * MS;
		run_for(cases[i].within_s * SECOND + 500 * MS);
		assert_true(bus.devices[0].alive);
	}
}

/* It does not answer a process that does not run: that is not billed to it. */
static void test_a_stopped_process_does_not_make_a_device_rest(void **state)
{
	(void)state;
	start_learned(0);
	bus.slaves[0].present = false;
	run_for(50 * MS);
	bus.now_ns += 3600 * SECOND;
	run_until_dead(0, SECOND);
	assert_true(bus.devices[0].backoff_ns <= 3 * SECOND);
}

/* Commands reach a dead device as they come; that it lives and dies by them again and again is not held against it. */
static void test_commands_do_not_make_a_device_rest(void **state)
{
	(void)state;
	start_learned(1);
	for (uint32_t tag = 1; tag < 100; tag++) {
		bus.slaves[0].present = false;
		run_until_dead(0, SECOND);
		bus.slaves[0].present = true;
		command(0, MODBUS_WRITE_REGISTER, 3, 1, tag);
		run_for(200 * MS);
		assert_int_equal(bus.last_tag, tag);
		assert_int_equal(bus.last_result, MODBUS_DONE);
	}
	bus.slaves[0].present = false;
	run_until_dead(0, SECOND);
	assert_true(bus.devices[0].backoff_ns <= MODBUS_DEAD_SHARE * 3 * TIMEOUT_NS);
}

/* A configuration was loaded, and the process before read it: nobody has told yet that it is silent. */
static void test_a_device_that_a_former_process_read_dies_as_one_that_lives(void **state)
{
	(void)state;
	set_up();
	for (uint32_t i = 0; i < 2; i++) {
		add_device((uint8_t)(17 + i), 2);
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	}
	bus.slaves[1].present = false;
	bus.devices[1].vouched = true;
	start();
	run_for(SECOND);
	assert_int_equal(bus.deaths[1], 1);
	assert_true(bus.devices[1].backoff_ns > 0);
	run_for(60 * SECOND);
	assert_int_equal(bus.deaths[1], 1);
	assert_int_equal(bus.deaths[0], 0);
}

static void test_nothing_is_vouched_for_when_the_port_is_lost(void **state)
{
	(void)state;
	set_up();
	add_device(17, 2);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	bus.devices[0].vouched = true;
	start();
	modbus_line_close(&bus.line, bus.now_ns);
	assert_int_equal(bus.deaths[0], 1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_nothing_is_known_of_a_device_that_never_answered),
	    cmocka_unit_test(test_a_lost_answer_costs_what_was_learned),
	    cmocka_unit_test(test_less_than_the_floor_is_never_waited),
	    cmocka_unit_test(test_only_its_answers_are_learned_from),
	    cmocka_unit_test(test_a_command_has_the_whole_response_time),
	    cmocka_unit_test(test_a_slow_answer_is_remembered_for_thousands),
	    cmocka_unit_test(test_a_device_at_the_end_of_its_time_never_dies),
	    cmocka_unit_test(test_a_device_that_gets_slower_does_not_die),
	    cmocka_unit_test(test_a_read_that_takes_longer_than_others_is_not_refused),
	    cmocka_unit_test(test_a_device_that_never_answers_right_dies),
	    cmocka_unit_test(test_a_command_behind_a_slow_read_is_confirmed),
	    cmocka_unit_test(test_an_early_time_out_mistakes_no_late_answer),
	    cmocka_unit_test(test_a_dead_device_costs_its_share_at_most),
	    cmocka_unit_test(test_a_line_without_a_living_device_loses_nothing),
	    cmocka_unit_test(test_a_pause_before_a_probe_has_the_limit_that_is_given),
	    cmocka_unit_test(test_a_device_that_comes_and_goes_costs_its_share_too),
	    cmocka_unit_test(test_a_device_that_returns_slower_is_found),
	    cmocka_unit_test(test_a_stopped_process_does_not_make_a_device_rest),
	    cmocka_unit_test(test_commands_do_not_make_a_device_rest),
	    cmocka_unit_test(test_a_device_that_a_former_process_read_dies_as_one_that_lives),
	    cmocka_unit_test(test_nothing_is_vouched_for_when_the_port_is_lost),
	};
	return cmocka_run_group_tests_name("modbus line timeouts", tests, NULL, NULL);
}
