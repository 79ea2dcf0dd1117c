/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A device that hears nothing for some time behind its answer: its pause is kept, and its neighbours do not wait for it. */
#include "modbus/test_bus.h"

#define PAUSE_NS (80 * MS)

/* The device and, behind it, one that needs no pause; each with reads of two functions. */
static void set_up_pair(void)
{
	set_up();
	for (uint8_t unit = 1; unit <= 2; unit++) {
		add_device(unit, 1);
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
		add_objects(MODBUS_READ_COILS, 0, 8);
	}
}

static unsigned sent_to(uint8_t unit)
{
	return sent_with(unit, MODBUS_READ_COILS) + sent_with(unit, MODBUS_READ_HOLDING_REGISTERS);
}

/* From one of its requests to the next. */
static int64_t least_gap_ns(uint8_t unit)
{
	int64_t least_ns = INT64_MAX, last_ns = 0;

	for (size_t i = 0; i < bus.sent_count; i++) {
		if (bus.sent[i].request.unit != unit)
			continue;
		if (last_ns > 0 && bus.sent[i].time_ns - last_ns < least_ns)
			least_ns = bus.sent[i].time_ns - last_ns;
		last_ns = bus.sent[i].time_ns;
	}
	return least_ns;
}

static void test_a_pause_of_the_configuration_is_kept(void **state)
{
	(void)state;
	set_up_pair();
	bus.devices[0].pause_ns = bus.slaves[0].pause_ns = PAUSE_NS;
	start();
	run_for(10 * SECOND);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_true(least_gap_ns(1) > PAUSE_NS + REACTION_NS);
	/* It takes both its turns all the same. */
	assert_true(sent_with(1, MODBUS_READ_COILS) > 30);
	assert_true(sent_with(1, MODBUS_READ_HOLDING_REGISTERS) > 30);
}

/* As if the device were not there but for its own requests. */
static void test_a_pause_costs_the_neighbour_nothing(void **state)
{
	unsigned alone;

	(void)state;
	set_up_pair();
	bus.slaves[0].present = false;
	start();
	run_for(30 * SECOND);
	forget_trace();
	run_for(10 * SECOND);
	alone = sent_to(2);
	set_up_pair();
	bus.devices[0].pause_ns = bus.slaves[0].pause_ns = PAUSE_NS;
	start();
	run_for(10 * SECOND);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_true(sent_to(2) + sent_to(1) > alone * 95 / 100);
	assert_true(bus.longest_ns[1] < PAUSE_NS);
}

/* The scan is through when all was read once, the device with its pauses too. */
static void test_a_scan_ends_with_the_slowest(void **state)
{
	(void)state;
	set_up_pair();
	bus.devices[0].pause_ns = bus.slaves[0].pause_ns = PAUSE_NS;
	start();
	run_for(10 * SECOND);
	assert_true(bus.line.counters.scan_us > PAUSE_NS / 1000);
	assert_true(bus.line.counters.scan_us < 4 * PAUSE_NS / 1000);
	assert_in_range(bus.line.counters.scans, 10 * SECOND / (4 * PAUSE_NS), 10 * SECOND / PAUSE_NS);
}

static void test_a_command_and_its_read_back_wait_for_the_pause(void **state)
{
	(void)state;
	set_up_pair();
	bus.devices[0].pause_ns = bus.slaves[0].pause_ns = PAUSE_NS;
	start();
	run_for(SECOND);
	for (uint32_t i = 0; i < 4; i++)
		command(0, MODBUS_WRITE_REGISTER, 3, (uint16_t)(7 + i), i);
	run_for(SECOND);
	assert_int_equal(bus.commands_done, 4);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 10);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_false(bus.line.urgent);
}

/* On a connection, too, where ten milliseconds are kept anyway. */
static void test_a_pause_is_kept_on_tcp(void **state)
{
	(void)state;
	set_up();
	use_tcp();
	add_device(1, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	bus.devices[0].pause_ns = bus.slaves[0].pause_ns = PAUSE_NS;
	start();
	run_for(10 * SECOND);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_in_range(bus.reads_done[0], 10 * SECOND / (PAUSE_NS + 2 * REACTION_NS),
			10 * SECOND / PAUSE_NS);
}

/* ---- what is learned ---------------------------------------------------------------------- */

static void set_up_alone(bool tcp, int64_t pause_ns, uint8_t retries)
{
	set_up();
	if (tcp)
		use_tcp();
	add_device(1, retries);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 400, 8);
	bus.devices[0].response_timeout_ns = 500 * MS;
	bus.devices[0].response_timeout_min_ns = 100 * MS;
	bus.slaves[0].pause_ns = pause_ns;
	start();
}

/* Within so long it is known to a quarter, and said; then the device lives, and is read as often as it can be. */
static void learns(bool tcp, int64_t pause_ns, uint8_t retries, int64_t within_ns)
{
	int64_t kept_ns;

	set_up_alone(tcp, pause_ns, retries);
	run_for(within_ns);
	kept_ns = bus.devices[0].pause.kept_ns;
	assert_true(kept_ns >= pause_ns);
	if (retries > 0)
		assert_true(kept_ns <= pause_ns + pause_ns / 3 + 15 * MS);
	assert_in_range(bus.pauses[0], 1, 2);
	assert_int_equal(bus.pause_ns[0], kept_ns);
	forget_trace();
	bus.deaths[0] = 0;
	run_for(40 * SECOND);
	assert_int_equal(bus.deaths[0], 0);
	assert_true(bus.reads_done[0] > 40 * SECOND / (kept_ns + 100 * MS) * 9 / 10);
	assert_in_range(bus.line.counters.timeouts, 0, 2); /* tries of none */
	assert_int_equal(bus.devices[0].read_count, 2);    /* nothing was divided */
}

static void test_a_pause_is_learned_on_a_serial_line(void **state)
{
	(void)state;
	learns(false, 20 * MS, 1, 10 * SECOND);
	learns(false, 50 * MS, 1, 10 * SECOND);
	learns(false, 100 * MS, 1, 10 * SECOND);
	learns(false, 100 * MS, 3, 10 * SECOND);
}

static void test_a_pause_is_learned_on_tcp(void **state)
{
	(void)state;
	learns(true, 30 * MS, 1, 10 * SECOND);
	learns(true, 300 * MS, 1, 10 * SECOND);
	learns(true, 850 * MS, 1, 20 * SECOND);
	learns(true, 850 * MS, 0, 20 * SECOND);
	learns(true, 2500 * MS, 1, 60 * SECOND);
}

/* As soon as it needs none, none is kept, within a minute and some. */
static void test_a_pause_that_is_not_needed_any_more_is_forgotten(void **state)
{
	(void)state;
	set_up_alone(false, 50 * MS, 1);
	run_for(10 * SECOND);
	assert_true(bus.devices[0].pause.kept_ns > 0);
	bus.slaves[0].pause_ns = 0;
	run_for(70 * SECOND);
	assert_int_equal(bus.devices[0].pause.kept_ns, 0);
	assert_int_equal(bus.deaths[0], 0);
}

/* Its neighbours leave it alone for longer than any shorter pause that could be tried. */
static void test_a_pause_is_forgotten_beside_neighbours(void **state)
{
	(void)state;
	for (int64_t pause_ns = 20 * MS; pause_ns <= 200 * MS; pause_ns += 10 * MS) {
		set_up_pair();
		bus.slaves[0].pause_ns = pause_ns;
		start();
		run_for(30 * SECOND);
		bus.slaves[0].pause_ns = 0;
		run_for(130 * SECOND);
		assert_int_equal(bus.devices[0].pause.kept_ns, 0);
	}
}

static void be_away(void)
{
	run_for(20 * SECOND);
	bus.slaves[0].present = false;
	run_for(10 * SECOND);
	bus.slaves[0].present = true;
	run_for(20 * SECOND);
	forget_trace();
}

/* A try would kill it. It is tried when it is back: that costs it a second life at most, and rarely. */
static void test_a_device_without_retries_is_tried_when_it_is_back(void **state)
{
	(void)state;
	set_up_alone(false, 50 * MS, 0);
	run_for(20 * SECOND);
	assert_true(bus.devices[0].pause.kept_ns > 0);
	bus.deaths[0] = 0;
	for (unsigned i = 0; i < 16; i++)
		be_away();
	assert_true(bus.devices[0].pause.kept_ns > 0);
	assert_in_range(bus.deaths[0], 16, 16 + 6);
	bus.slaves[0].pause_ns = 0;
	for (unsigned i = 0; i < 16; i++)
		be_away();
	assert_int_equal(bus.devices[0].pause.kept_ns, 0);
}

/* Not below what the configuration says, and from there on. */
static void test_a_pause_is_learned_above_that_of_the_configuration(void **state)
{
	(void)state;
	set_up();
	add_device(1, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	bus.devices[0].pause_ns = 30 * MS;
	bus.slaves[0].pause_ns = 60 * MS;
	start();
	run_for(20 * SECOND);
	assert_in_range(bus.devices[0].pause.kept_ns, 60 * MS, 90 * MS);
	bus.slaves[0].pause_ns = 0;
	run_for(70 * SECOND);
	assert_int_equal(bus.devices[0].pause.kept_ns, 30 * MS);
}

/* Noise spoils answers at random: what is learned of it, if anything, is gone within minutes, and costs little. */
static void test_noise_is_no_pause(void **state)
{
	uint32_t seed = 9;
	unsigned held = 0;

	(void)state;
	set_up_alone(false, 0, 1);
	for (unsigned i = 0; i < 60000; i++) {
		if (random_next(&seed) % 10 == 0) {
			bus.slaves[0].faults = 1;
			bus.slaves[0].fault = MUTE;
		}
		run_for(30 * MS);
		held += bus.devices[0].pause.kept_ns > 20 * MS;
	}
	assert_true(held < 60000 / 50);
}

/* The request before a loss comes soonest: what is answered comes a little later, each time. */
static void test_commands_that_are_lost_are_no_pause(void **state)
{
	(void)state;
	set_up_alone(false, 0, 1);
	bus.chance = 7;
	for (uint32_t i = 0; i < 50; i++) {
		run_for(10 * SECOND);
		bus.slaves[0].fault = MUTE;
		bus.slaves[0].faults = 1;
		command(0, MODBUS_WRITE_REGISTER, 3, (uint16_t)i, i);
		run_for(SECOND);
		assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
		assert_int_equal(bus.devices[0].pause.kept_ns, 0);
	}
	assert_int_equal(bus.pauses[0], 0);
}

/* Up to so long. */
static int64_t random_ns(uint32_t *seed, int64_t most_ns)
{
	return (int64_t)(random_next(seed) % 1000 + 1) * most_ns / 1000;
}

/* A busy host, or a device that has more to do, holds up now and then: that looks like a pause, but not for long. */
static void test_stalls_are_forgotten_soon(void **state)
{
	unsigned learned = 0;

	(void)state;
	for (uint32_t run = 1; run <= 100; run++) {
		uint32_t seed = run;

		set_up_alone(false, 0, 1);
		while (bus.now_ns < 60 * SECOND) {
			run_for(random_ns(&seed, 400 * MS));
			bus.slaves[0].present = false;
			run_for(random_ns(&seed, 250 * MS));
			bus.slaves[0].present = true;
			forget_trace();
		}
		learned += bus.devices[0].pause.kept_ns > 0;
		run_for(60 * SECOND);
		assert_int_equal(bus.devices[0].pause.kept_ns, 0);
	}
	assert_true(learned > 0);
}

/* A read that is never answered, whatever the pause, is divided as before. */
static void test_a_read_that_is_not_given_is_no_pause(void **state)
{
	(void)state;
	set_up();
	add_device(1, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	bus.slaves[0].deaf = 3;
	start();
	run_for(60 * SECOND);
	assert_int_equal(bus.devices[0].pause.kept_ns, 0);
	assert_int_equal(bus.pauses[0], 0);
	assert_true(bus.devices[0].read_count > 1);
	assert_int_equal(bus.deaths[0], 0);
}

/* A device that was away for long is no device that wants to be left alone. */
static void test_a_device_that_was_away_needs_no_pause(void **state)
{
	(void)state;
	set_up_alone(true, 0, 1);
	for (unsigned i = 0; i < 20; i++) {
		run_for(SECOND);
		bus.slaves[0].present = false;
		run_for(i * SECOND);
		bus.slaves[0].present = true;
		run_for(60 * SECOND);
		assert_int_equal(bus.devices[0].pause.kept_ns, 0);
	}
	assert_int_equal(bus.pauses[0], 0);
}

/* Another of the line is read as before while the pause is being learned, and after. */
static void test_to_learn_a_pause_costs_the_neighbour_little(void **state)
{
	(void)state;
	set_up_pair();
	bus.slaves[0].pause_ns = 300 * MS;
	start();
	run_for(60 * SECOND);
	assert_in_range(bus.devices[0].pause.kept_ns, 300 * MS, 420 * MS);
	forget_trace();
	run_for(30 * SECOND);
	assert_int_equal(bus.deaths[1], 0);
	assert_true(bus.longest_ns[1] < 2 * TIMEOUT_NS);
	assert_true(sent_to(2) > 30 * SECOND / (25 * MS));
}

/* A command is not sent behind a pause that is only tried. */
static void test_no_command_is_lost_to_a_try(void **state)
{
	(void)state;
	set_up_alone(true, 300 * MS, 1);
	run_for(10 * SECOND);
	for (uint32_t i = 0; i < 300; i++) {
		command(0, MODBUS_WRITE_REGISTER, 3, (uint16_t)i, i);
		run_for(SECOND);
		assert_int_equal(bus.last_result, MODBUS_DONE);
		assert_int_equal(bus.last_tag, i);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_pause_of_the_configuration_is_kept),
	    cmocka_unit_test(test_a_pause_costs_the_neighbour_nothing),
	    cmocka_unit_test(test_a_scan_ends_with_the_slowest),
	    cmocka_unit_test(test_a_command_and_its_read_back_wait_for_the_pause),
	    cmocka_unit_test(test_a_pause_is_kept_on_tcp),
	    cmocka_unit_test(test_a_pause_is_learned_on_a_serial_line),
	    cmocka_unit_test(test_a_pause_is_learned_on_tcp),
	    cmocka_unit_test(test_a_pause_that_is_not_needed_any_more_is_forgotten),
	    cmocka_unit_test(test_a_pause_is_forgotten_beside_neighbours),
	    cmocka_unit_test(test_a_device_without_retries_is_tried_when_it_is_back),
	    cmocka_unit_test(test_a_pause_is_learned_above_that_of_the_configuration),
	    cmocka_unit_test(test_noise_is_no_pause),
	    cmocka_unit_test(test_commands_that_are_lost_are_no_pause),
	    cmocka_unit_test(test_stalls_are_forgotten_soon),
	    cmocka_unit_test(test_a_read_that_is_not_given_is_no_pause),
	    cmocka_unit_test(test_a_device_that_was_away_needs_no_pause),
	    cmocka_unit_test(test_to_learn_a_pause_costs_the_neighbour_little),
	    cmocka_unit_test(test_no_command_is_lost_to_a_try),
	};
	return cmocka_run_group_tests_name("modbus line pauses", tests, NULL, NULL);
}
