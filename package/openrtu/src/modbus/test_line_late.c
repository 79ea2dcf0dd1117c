/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Late answers: none is ever taken for another's. */
#include "modbus/test_bus.h"

/* Two reads of one length: the answer to the first comes while the second would be under way. */
static void test_a_late_answer_is_never_anothers(void **state)
{
	(void)state;
	set_up();
	add_device(17, 2);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 4);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 40, 4);
	start();
	run_for(SECOND);
	assert_int_equal(bus.devices[0].read_count, 2);
	for (int64_t late = 80; late < 400; late += 3) {
		forget_trace();
		bus.slaves[0].late = 1;
		bus.slaves[0].late_ns = late * MS;
		run_for(10 * SECOND);
		assert_true(bus.devices[0].alive);
		assert_true(bus.reads_done[0] > 20);
	}
}

static void test_a_late_answer_is_counted(void **state)
{
	(void)state;
	start_simple(2);
	bus.slaves[0].late = 1;
	bus.slaves[0].late_ns = 105 * MS;
	run_for(2 * SECOND);
	assert_int_equal(bus.line.counters.late_answers, 1);
	assert_int_equal(bus.line.counters.timeouts, 1);
	assert_int_equal(bus.line.counters.wrong_answers, 0);
}

/* A device that takes longer than the time-out: each of its answers is late, and tells how long it took. */
static void tells_how_late(bool tcp)
{
	set_up();
	if (tcp)
		use_tcp();
	add_device(17, 2);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 4);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 40, 1);
	bus.slaves[0].reaction_ns = 130 * MS;
	start();
	for (unsigned seen = 0; seen < 6; seen = bus.lates[0]) {
		while (bus.lates[0] == seen)
			run_for(MS);
		assert_in_range(bus.late_ns[0], 128 * MS, 142 * MS);
	}
	assert_int_equal(bus.line.counters.late_answers, 6);
	assert_int_equal(bus.reads_done[0], 0);
	assert_int_equal(bus.strangers[0], 0);
}

static void test_a_late_answer_tells_how_late_it_is(void **state)
{
	(void)state;
	tells_how_late(false);
	tells_how_late(true);
}

/* What comes within the response time, behind a time-out that was learned, is not late. */
static void test_an_answer_behind_a_learned_time_out_is_told_as_it_is(void **state)
{
	(void)state;
	start_simple(2);
	bus.devices[0].response_timeout_ns = SECOND;
	bus.devices[0].response_timeout_min_ns = TIMEOUT_NS;
	run_for(SECOND);
	bus.slaves[0].late = 1;
	bus.slaves[0].late_ns = 150 * MS;
	run_for(2 * SECOND);
	assert_int_equal(bus.lates[0], 1);
	assert_in_range(bus.late_ns[0], 150 * MS, 170 * MS);
}

/* A process that was stopped reads late what came in time. */
static void reads_late(bool tcp)
{
	set_up();
	if (tcp)
		use_tcp();
	add_device(17, 2);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 4);
	start();
	run_for(SECOND);
	while (bus.line.state != MODBUS_WAITING || bus.wire_count == 0)
		run_for(MS);
	bus.now_ns += 3 * SECOND;
	deliver();
	run_for(SECOND);
	assert_int_equal(bus.line.counters.timeouts, 1);
	assert_int_equal(bus.lates[0], 0);
	assert_int_equal(bus.devices[0].counters.too_late, 0);
	assert_int_equal(bus.devices[0].latest_ns, 0);
}

static void test_who_reads_late_does_not_say_that_the_device_is_late(void **state)
{
	(void)state;
	reads_late(false);
	reads_late(true);
}

/* A device that was busy answers all that it was asked meanwhile at once: each of these answers is one. */
static void test_late_answers_that_come_at_once_are_told_apart(void **state)
{
	(void)state;
	start_simple(2);
	bus.slaves[0].late = 1;
	bus.slaves[0].late_ns = 300 * MS;
	run_for(2 * SECOND);
	assert_int_equal(bus.line.counters.late_answers, 2);
	assert_int_equal(bus.lates[0], 1); /* how long it took for the second nobody knows */
	assert_in_range(bus.late_ns[0], 300 * MS, 325 * MS);
	assert_int_equal(bus.line.counters.noise_bytes, 0);
	assert_int_equal(bus.line.counters.timeouts, 2);
	assert_true(bus.reads_done[0] > 20);
}

/* The process was killed with a request under way; the next one has the port before the answer comes. */
static void test_a_killed_processs_answer_is_nobodys(void **state)
{
	(void)state;
	set_up();
	add_device(17, 2);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 40, 1);
	start();
	run_for(3 * SECOND);
	assert_int_equal(bus.devices[0].read_count, 2);
	for (int64_t late = 0; late < 300; late++) {
		bus.slaves[0].late = 1;
		bus.slaves[0].late_ns = late * MS;
		run_for(25 * MS);
		modbus_line_close(&bus.line, bus.now_ns);
		bus.devices[0].unanswered_count = 0; /* a new process knows nothing */
		bus.devices[0].trust_ns = bus.devices[0].paid_ns = 0;
		forget_trace();
		modbus_line_open(&bus.line, bus.now_ns);
		run_for(5 * SECOND);
		assert_true(bus.devices[0].alive);
		assert_true(bus.reads_done[0] > 20);
	}
}

/* It may still come when nothing but another device's silence was waited for since. */
static void test_a_killed_processs_confirmation_is_nobodys(void **state)
{
	(void)state;
	start_simple(0);
	add_device(18, 0);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 1);
	bus.slaves[1].present = false;
	bus.devices[0].response_timeout_ns = bus.devices[1].response_timeout_ns = 2 * SECOND;
	start();
	run_for(3 * SECOND);
	bus.slaves[0].late = 1;
	bus.slaves[0].late_ns = 2500 * MS;
	command(0, MODBUS_WRITE_REGISTER, 3, 7, 1);
	while (sent_with(17, MODBUS_WRITE_REGISTER) == 0)
		run_for(MS);
	modbus_line_close(&bus.line, bus.now_ns);
	for (int i = 0; i < 2; i++) {
		bus.devices[i].unanswered_count = 0; /* a new process knows nothing */
		bus.devices[i].trust_ns = 0;
	}
	bus.slaves[0].exception = 4;
	modbus_line_open(&bus.line, bus.now_ns);
	bus.devices[0].next_probe_ns += 5 * SECOND; /* the other one is probed first */
	command(0, MODBUS_WRITE_REGISTER, 3, 7, 2);
	run_for(6 * SECOND);
	assert_int_equal(bus.last_tag, 2);
	assert_int_equal(bus.last_result, MODBUS_REFUSED);
}

/* A process that was stopped finds an answer, and cannot know how old its values are. */
static void test_an_old_answer_is_no_news(void **state)
{
	(void)state;
	start_simple(3);
	while (bus.sent_count == 0)
		run_for(MS);
	bus.slaves[0].registers[4] = 1; /* on_read knows the new value only */
	bus.now_ns += 2 * SECOND;
	deliver();
	run_for(SECOND);
	assert_int_equal(bus.line.counters.timeouts, 1);
	assert_int_equal(bus.line.counters.late_answers, 1);
	assert_true(bus.reads_done[0] > 10);
}

/*
 * Nothing that could be asked has an unmistakable answer, and an object that was refused comes due: time
 * must pass all the same (run_until).
 */
static void test_a_device_that_rests_is_at_rest(void **state)
{
	(void)state;
	set_up();
	add_device(17, 9);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 40, 1);
	bus.slaves[0].missing = 40;
	start();
	run_for(700 * MS);
	assert_int_equal(bus.refused_addresses[0], 1ULL << 40);
	bus.slaves[0].fault = MUTE;
	bus.slaves[0].faults = 1;
	while (bus.slaves[0].faults > 0)
		run_for(MS);
	bus.slaves[0].exception = 2;
	run_for(500 * MS);
	bus.slaves[0].exception = 0;
	bus.slaves[0].missing = -1;
	run_for(5 * SECOND);
	assert_int_equal(bus.devices[0].read_count, 2);
	assert_true(bus.devices[0].alive);
}

/*
 * Where all objects are one register, something longer is read; a device that refuses that rests until
 * nothing can come.
 */
static void test_a_device_with_one_object_rests(void **state)
{
	(void)state;
	set_up();
	add_device(17, 2);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 1);
	bus.slaves[0].missing = 1;
	start();
	run_for(SECOND);
	forget_trace();
	bus.slaves[0].late = 1;
	bus.slaves[0].late_ns = 130 * MS;
	run_for(3 * SECOND);
	assert_int_equal(bus.sent[1].request.count, 2);
	assert_in_range(bus.sent[2].time_ns - bus.sent[1].time_ns, MODBUS_LATE_NS,
			MODBUS_LATE_NS + TIMEOUT_NS + 10 * MS);
	assert_int_equal(bus.deaths[0], 0);
	assert_true(bus.reads_done[0] > 10);
}

/*
 * The refusal of the read comes while its probe is under way, and looks like that of the probe: the probe's answer may come
 * as late as any, and the read that is due first then looks like the probe.
 */
static void test_a_probe_behind_a_late_refusal_is_not_forgotten(void **state)
{
	(void)state;
	for (int64_t late = 0; late < 1060; late += 5) {
		set_up();
		add_device(17, 5);
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 4);
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 40, 1);
		bus.objects[0][4].period_ms = 1000;
		start();
		run_for(2500 * MS);
		bus.slaves[0].exception = 2;
		bus.slaves[0].late = 1;
		bus.slaves[0].late_ns = TIMEOUT_NS + 20 * MS;
		while (bus.slaves[0].late > 0)
			run_for(MS);
		bus.slaves[0].exception = 0;
		bus.slaves[0].late = 1;
		bus.slaves[0].late_ns = late * MS;
		run_for(5 * SECOND);
		assert_int_equal(bus.slaves[0].late, 0);
		assert_true(bus.devices[0].alive);
	}
}

static void test_a_late_confirmation_is_not_another_commands(void **state)
{
	(void)state;
	start_simple(2);
	bus.slaves[0].late = 1;
	bus.slaves[0].late_ns = 150 * MS;
	bus.slaves[0].exception = 4;
	command(0, MODBUS_WRITE_REGISTER, 3, 7, 1);
	command(0, MODBUS_WRITE_REGISTER, 3, 7, 2);
	run_for(60 * MS);
	bus.slaves[0].exception = 0;
	run_for(SECOND);
	assert_int_equal(bus.commands_done, 2);
	assert_int_equal(bus.tags[0], 1);
	assert_int_equal(bus.last_tag, 2);
	assert_int_equal(bus.last_result, MODBUS_DONE);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_late_answer_is_never_anothers),
	    cmocka_unit_test(test_a_late_answer_is_counted),
	    cmocka_unit_test(test_a_late_answer_tells_how_late_it_is),
	    cmocka_unit_test(test_who_reads_late_does_not_say_that_the_device_is_late),
	    cmocka_unit_test(test_late_answers_that_come_at_once_are_told_apart),
	    cmocka_unit_test(test_an_answer_behind_a_learned_time_out_is_told_as_it_is),
	    cmocka_unit_test(test_a_killed_processs_answer_is_nobodys),
	    cmocka_unit_test(test_a_killed_processs_confirmation_is_nobodys),
	    cmocka_unit_test(test_an_old_answer_is_no_news),
	    cmocka_unit_test(test_a_device_that_rests_is_at_rest),
	    cmocka_unit_test(test_a_device_with_one_object_rests),
	    cmocka_unit_test(test_a_probe_behind_a_late_refusal_is_not_forgotten),
	    cmocka_unit_test(test_a_late_confirmation_is_not_another_commands),
	};
	return cmocka_run_group_tests_name("modbus line late", tests, NULL, NULL);
}
