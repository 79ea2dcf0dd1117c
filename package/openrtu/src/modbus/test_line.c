/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Whose turn it is on a line: the scan of devices that answer, and the probes of those that do not. */
#include "modbus/test_bus.h"

static void test_devices_are_scanned_in_turn(void **state)
{
	(void)state;
	set_up();
	add_device(1, 1);
	add_objects(MODBUS_READ_COILS, 0, 10);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 3);
	add_device(2, 1);
	add_objects(MODBUS_READ_INPUT_REGISTERS, 4, 2);
	start();
	run_for(10 * SECOND);
	assert_true(bus.reads_done[0] > 200);
	assert_in_range(bus.reads_done[0], 2 * bus.reads_done[1] - 2, 2 * bus.reads_done[1] + 2);
	assert_int_equal(bus.births[0], 1);
	assert_int_equal(bus.deaths[0] + bus.deaths[1], 0);
	assert_int_equal(bus.devices[0].read_count, 2);
	assert_int_equal(bus.line.counters.timeouts + bus.line.counters.crc_errors, 0);
	/* 19200 8E1: 24 + 7 + 11 + 9 characters of 573 us, 3 reactions of 5 ms, 2 silences of 2 ms between */
	assert_in_range(bus.line.counters.scan_us, 48200, 48300);
	assert_in_range(bus.devices[0].counters.latency_us, 5000, 6000);
}

/* take_output asserts the silence before every request; here: that it is not longer than needed either. */
static void test_silence_is_three_and_a_half_characters(void **state)
{
	(void)state;
	start_simple(0);
	run_for(SECOND);
	int64_t period = bus.sent[1].time_ns - bus.sent[0].time_ns;
	int64_t characters = 8 + 5 + 2 * 8;
	assert_int_equal(period, characters * bus.line.wire.char_ns + REACTION_NS + bus.line.wire.silence_ns);
}

/* The first character and the last one, however many come between. */
static void test_an_answer_is_listened_to_in_two_pieces(void **state)
{
	(void)state;
	start_simple(0);
	run_for(SECOND);
	uint32_t answers = bus.line.counters.answers;
	bus.deliveries = 0;
	run_for(10 * SECOND);
	assert_in_range(bus.deliveries, 2 * (bus.line.counters.answers - answers) - 2,
			2 * (bus.line.counters.answers - answers) + 2);
}

static uint32_t longest_transaction_us(void)
{
	bus.line.counters.transactions.longest_us = 0;
	run_for(30 * SECOND);
	return bus.line.counters.transactions.longest_us;
}

/* The first exception is taken when the answer would be complete at the latest, the next with their five characters. */
static void test_an_exception_is_looked_for_where_one_came(void **state)
{
	(void)state;
	start_simple(0);
	int64_t before_ns = 8 * bus.line.wire.char_ns + REACTION_NS;

	bus.slaves[0].exception = 6;
	assert_int_equal(longest_transaction_us(), (before_ns + (5 + 2 * 8) * bus.line.wire.char_ns) / 1000);
	assert_int_equal(longest_transaction_us(), (before_ns + 5 * bus.line.wire.char_ns) / 1000);
}

/* The time-out begins when the request has left: a port that switches the direction first sends it later. */
static void test_the_time_out_begins_behind_the_turn_of_the_direction(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].present = false;
	run_for(50 * MS);
	int64_t due_ns = bus.line.deadline_ns - bus.sent[bus.sent_count - 1].time_ns;
	start_simple(0);
	bus.line.wire.before_ns = 20 * MS;
	run_for(100 * MS);
	bus.slaves[0].present = false;
	run_for(50 * MS);
	int64_t later_ns = bus.line.deadline_ns - bus.sent[bus.sent_count - 1].time_ns;
	assert_int_equal(later_ns, due_ns + 20 * MS);
	assert_int_equal(modbus_read_ns(&bus.line.wire, MODBUS_READ_HOLDING_REGISTERS, 8, REACTION_NS),
			 29 * bus.line.wire.char_ns + 2 * bus.line.wire.silence_ns + 25 * MS);
}

static void test_a_broadcast_device_is_never_read(void **state)
{
	(void)state;
	set_up();
	add_device(MODBUS_BROADCAST, 0);
	add_objects(MODBUS_READ_COILS, 0, 4);
	start();
	run_for(10 * SECOND);
	assert_int_equal(bus.sent_count, 0);
}

static void test_nothing_is_sent_before_open_or_after_close(void **state)
{
	(void)state;
	start_simple(0);
	modbus_line_close(&bus.line, bus.now_ns);
	assert_int_equal(bus.deaths[0], 1);
	run_for(10 * SECOND);
	assert_int_equal(bus.sent_count, 0);
	assert_false(modbus_line_command(&bus.line, &(struct modbus_command){0}));
	modbus_line_open(&bus.line, bus.now_ns);
	run_for(SECOND);
	assert_int_equal(bus.births[0], 2);
	assert_true(bus.reads_done[0] > 10);
}

/* ---- dead devices ------------------------------------------------------------------------------- */

static void test_a_dead_device_is_probed_ever_more_rarely(void **state)
{
	(void)state;
	start_simple(1);
	bus.devices[0].response_timeout_min_ns = TIMEOUT_NS / 4;
	run_for(SECOND);
	forget_trace();
	bus.slaves[0].present = false;
	int64_t unplugged = bus.now_ns;
	run_for(400 * SECOND);
	assert_int_equal(bus.deaths[0], 1);
	/* at most an answer under way, then a read and one repetition */
	assert_true(bus.died_ns[0] - unplugged < 2 * TIMEOUT_NS + 60 * MS);
	const int64_t seconds[] = {1, 2, 4, 8, 16, 32, 60, 60, 60, 60};
	size_t probe = 0;
	while (bus.sent[probe].time_ns <= bus.died_ns[0])
		probe++;
	int64_t before = bus.died_ns[0];
	for (size_t i = 0; i < sizeof(seconds) / sizeof(seconds[0]); i++, probe++) {
		int64_t pause = bus.sent[probe].time_ns - before;

		assert_in_range(pause, seconds[i] * SECOND, seconds[i] * SECOND + 130 * MS);
		/* an answer to the requests before the death may still follow the first */
		assert_int_equal(bus.sent[probe].request.count, i == 0 ? 2 : 1);
		before = bus.sent[probe].time_ns;
	}
	assert_int_equal(bus.devices[0].backoff_ns, 60 * SECOND);
}

static void test_a_device_that_returns_is_scanned_at_once(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].present = false;
	run_for(10 * SECOND);
	bus.slaves[0].present = true;
	forget_trace();
	run_for(10 * SECOND);
	assert_int_equal(bus.births[0], 2);
	assert_int_equal(bus.devices[0].backoff_ns, 0);
	assert_int_equal(bus.sent[0].request.count, 1);
	assert_int_equal(bus.sent[1].request.count, 8);
	assert_true(bus.sent[1].time_ns - bus.sent[0].time_ns < 30 * MS);
}

static void test_a_dead_device_delays_its_line_by_its_probes_only(void **state)
{
	(void)state;
	set_up();
	add_device(1, 3);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	add_device(2, 3);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	start();
	run_for(SECOND);
	bus.slaves[0].present = false;
	run_for(60 * SECOND);
	forget_trace();
	run_for(60 * SECOND);
	assert_in_range(sent_with(1, MODBUS_READ_HOLDING_REGISTERS), 1, 2);
	/* two seconds' worth less than a line of its own would give */
	assert_true(bus.reads_done[1] > 58 * 1000 / 25);
	assert_int_equal(bus.deaths[1], 0);
}

/* Of many dead devices one at a time is probed: between two probes without an answer, the others are read. */
static void test_dead_devices_are_probed_one_a_scan(void **state)
{
	(void)state;
	set_up();
	for (uint8_t unit = 1; unit <= DEVICES_MAX; unit++) {
		add_device(unit, 0);
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
		bus.slaves[unit - 1].present = unit == 3;
	}
	start();
	run_for(30 * SECOND);
	assert_int_equal(bus.line.counters.timeouts, 2 * 4); /* 0, 2, 6, 14 seconds after the start */
	assert_in_range(bus.longest_ns[2], TIMEOUT_NS, TIMEOUT_NS + 50 * MS);
	bus.slaves[0].present = bus.slaves[1].present = true;
	run_for(33 * SECOND);
	assert_true(bus.devices[0].alive && bus.devices[1].alive);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_devices_are_scanned_in_turn),
	    cmocka_unit_test(test_silence_is_three_and_a_half_characters),
	    cmocka_unit_test(test_an_answer_is_listened_to_in_two_pieces),
	    cmocka_unit_test(test_an_exception_is_looked_for_where_one_came),
	    cmocka_unit_test(test_the_time_out_begins_behind_the_turn_of_the_direction),
	    cmocka_unit_test(test_a_broadcast_device_is_never_read),
	    cmocka_unit_test(test_nothing_is_sent_before_open_or_after_close),
	    cmocka_unit_test(test_a_dead_device_is_probed_ever_more_rarely),
	    cmocka_unit_test(test_a_device_that_returns_is_scanned_at_once),
	    cmocka_unit_test(test_a_dead_device_delays_its_line_by_its_probes_only),
	    cmocka_unit_test(test_dead_devices_are_probed_one_a_scan),
	};
	return cmocka_run_group_tests_name("modbus line", tests, NULL, NULL);
}
