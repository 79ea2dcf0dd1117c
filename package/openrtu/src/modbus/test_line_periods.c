/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Reads with a period are begun on time, and what else there is fills the line. */
#include "modbus/test_bus.h"

/* 19200 8E1: 8 + 5 + 2 * 8 characters of 573 us, a reaction of 5 ms, a silence of 2 ms. */
#define TRANSACTION_NS (24 * MS)

static void add_periodic_device(uint8_t unit, uint32_t period_ms)
{
	add_device(unit, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	for (uint32_t i = 0; i < 8; i++)
		bus.objects[unit - 1][i].period_ms = period_ms & 0x7FFFFFFu;
}

/* Three devices of eight registers each, one request. Period 0: in turn. They run for a second. */
static void start_with_periods(uint16_t first_ms, uint16_t second_ms, uint16_t third_ms)
{
	set_up();
	add_periodic_device(1, first_ms);
	add_periodic_device(2, second_ms);
	add_periodic_device(3, third_ms);
	start();
	run_for(SECOND);
	forget_trace();
	for (uint32_t i = 0; i < 3; i++)
		bus.devices[i].counters.missed_periods = 0;
}

/*
 * There is one request to the unit for each of its periods that begins after begin_ns, at most late_ns late: that of
 * one period does not depend on how late the one before was.
 */
static void assert_periods_hold(uint8_t unit, int64_t period_ns, int64_t begin_ns, int64_t late_ns)
{
	int64_t first_ns = (begin_ns / period_ns + 1) * period_ns, due_ns = first_ns;

	for (size_t i = 0; i < bus.sent_count; i++) {
		if (bus.sent[i].request.unit != unit || bus.sent[i].time_ns < first_ns)
			continue;
		assert_in_range(bus.sent[i].time_ns, due_ns, due_ns + late_ns);
		due_ns += period_ns;
	}
	assert_true(due_ns + period_ns > bus.now_ns);
}

static void test_periods_hold_and_the_rest_fills_the_line(void **state)
{
	(void)state;
	start_with_periods(100, 250, 0);
	int64_t begin_ns = bus.now_ns;
	run_for(60 * SECOND);
	/* one request may be under way, and the other may be due at the same time */
	assert_periods_hold(1, 100 * MS, begin_ns, TRANSACTION_NS);
	assert_periods_hold(2, 250 * MS, begin_ns, 2 * TRANSACTION_NS);
	assert_int_equal(bus.devices[0].counters.missed_periods + bus.devices[1].counters.missed_periods, 0);
	/* The line is never idle: three devices together have what one alone would have. */
	assert_true(bus.sent_count > 60 * SECOND / TRANSACTION_NS);
	assert_true(bus.reads_done[2] > bus.sent_count / 2);
}

static void test_a_line_with_nothing_else_to_do_waits_for_the_period(void **state)
{
	(void)state;
	start_with_periods(1000, 1000, 1000);
	int64_t begin_ns = bus.now_ns;
	run_for(60 * SECOND);
	assert_in_range(bus.sent_count, 3 * 59, 3 * 61);
	assert_periods_hold(1, SECOND, begin_ns, 0);
	assert_periods_hold(2, SECOND, begin_ns, TRANSACTION_NS);
	assert_periods_hold(3, SECOND, begin_ns, 2 * TRANSACTION_NS);
}

/* 24 / 60 + 24 / 80 + 24 / 100 is 94 % of the line: deadlines hold all, and no fixed order would. */
static void test_deadlines_use_nearly_all_of_the_line(void **state)
{
	(void)state;
	start_with_periods(60, 80, 100);
	run_for(60 * SECOND);
	for (uint32_t i = 0; i < 3; i++)
		assert_int_equal(bus.devices[i].counters.missed_periods, 0);
	assert_in_range(bus.reads_done[0], 1000 - 1, 1000 + 1);
	assert_in_range(bus.reads_done[1], 750 - 1, 750 + 1);
	assert_in_range(bus.reads_done[2], 600 - 1, 600 + 1);
}

static void test_periods_that_cannot_be_held_starve_nobody(void **state)
{
	(void)state;
	start_with_periods(20, 20, 0);
	run_for(60 * SECOND);
	assert_true(bus.devices[0].counters.missed_periods > 1000);
	assert_in_range(bus.reads_done[0], bus.reads_done[1], bus.reads_done[1] * 102 / 100);
	/* Now and then neither is due for a moment. */
	assert_in_range(bus.reads_done[2], bus.sent_count / (MODBUS_DUE_IN_ROW + 2),
			bus.sent_count / MODBUS_DUE_IN_ROW);
}

static void test_after_a_storm_of_commands_periods_hold_again(void **state)
{
	(void)state;
	start_with_periods(100, 250, 0);
	for (int64_t end_ns = bus.now_ns + 10 * SECOND; bus.now_ns < end_ns; run_for(5 * MS))
		while (bus.line.command_count < COMMANDS_MAX)
			command(2, MODBUS_WRITE_COIL, 900, 1, 0);
	/* Eight commands, 17 ms each, for each read that is due. */
	assert_in_range(bus.sent_count - sent_with(3, MODBUS_WRITE_COIL), 10 * SECOND / (200 * MS),
			10 * SECOND / (150 * MS));
	assert_true(sent_with(1, MODBUS_READ_HOLDING_REGISTERS) > 20);
	assert_true(sent_with(2, MODBUS_READ_HOLDING_REGISTERS) > 10);
	assert_true(bus.devices[0].counters.missed_periods > 10);
	run_for(SECOND);
	int64_t begin_ns = bus.now_ns;
	uint32_t missed = bus.devices[0].counters.missed_periods;
	forget_trace();
	run_for(10 * SECOND);
	assert_periods_hold(1, 100 * MS, begin_ns, TRANSACTION_NS);
	assert_periods_hold(2, 250 * MS, begin_ns, 2 * TRANSACTION_NS);
	assert_int_equal(bus.devices[0].counters.missed_periods, missed);
}

/* Once only a time-out, then its probes: the others' periods slip by these and by nothing more. */
static void test_a_dead_device_costs_the_periods_of_others_its_time_outs(void **state)
{
	(void)state;
	start_with_periods(200, 200, 0);
	bus.slaves[0].present = false;
	int64_t begin_ns = bus.now_ns;
	run_for(30 * SECOND);
	assert_false(bus.devices[0].alive);
	assert_periods_hold(2, 200 * MS, begin_ns, TIMEOUT_NS + 2 * TRANSACTION_NS);
	assert_true(bus.reads_done[2] > 500);
	bus.slaves[0].present = true;
	run_for(40 * SECOND);
	begin_ns = bus.now_ns;
	forget_trace();
	run_for(10 * SECOND);
	assert_periods_hold(1, 200 * MS, begin_ns, TRANSACTION_NS);
}

/* Within the period that it belongs to: the time-out, then a probe, which shows that nothing late comes. */
static void test_a_read_without_an_answer_is_repeated_in_its_period(void **state)
{
	(void)state;
	start_with_periods(1000, 0, 0);
	run_for(SECOND);
	forget_trace();
	bus.slaves[0].fault = MUTE;
	bus.slaves[0].faults = 1;
	run_for(SECOND);
	assert_int_equal(sent_with(1, MODBUS_READ_HOLDING_REGISTERS), 3);
	assert_int_equal(bus.reads_done[0], 1);
	assert_int_equal(bus.devices[0].counters.missed_periods, 0);
}

static void test_what_is_refused_is_asked_for_ever_more_rarely(void **state)
{
	(void)state;
	set_up();
	add_periodic_device(1, 100);
	bus.slaves[0].missing = 3;
	start();
	run_for(SECOND);
	forget_trace();
	run_for(30 * SECOND);
	assert_int_equal(bus.refused_addresses[0], 1u << 3);
	/* 0 and 1, 2, 4 to 7, ten times a second; 3 after 1, 2, 4, 8, 16 s */
	assert_in_range(bus.sent_count, 3 * 300 + 4, 3 * 300 + 8);
	bus.slaves[0].missing = -1;
	run_for(60 * SECOND);
	forget_trace();
	run_for(10 * SECOND);
	assert_in_range(bus.sent_count, 99, 101);
}

#define DAY_MS 86400000

static unsigned asked_for(uint16_t address)
{
	unsigned count = 0;

	for (size_t i = 0; i < bus.sent_count; i++)
		count += bus.sent[i].request.address == address;
	return count;
}

/* Four registers ten times a second, and one once a day; all are read once. */
static void start_with_a_rare_read(void)
{
	set_up();
	add_device(1, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 4);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 20, 1);
	for (uint32_t i = 0; i < 4; i++)
		bus.objects[0][i].period_ms = 100;
	bus.objects[0][4].period_ms = DAY_MS;
	start();
	run_for(SECOND);
}

static void test_a_read_once_a_day(void **state)
{
	(void)state;
	start_with_a_rare_read();
	assert_int_equal(asked_for(20), 1);
	forget_trace();
	run_for(60 * SECOND);
	assert_int_equal(asked_for(20), 0);
	assert_true(asked_for(0) > 500);
	/* On its day; what happens between is not simulated. */
	bus.now_ns = DAY_MS * MS;
	forget_trace();
	run_for(SECOND);
	assert_int_equal(asked_for(20), 1);
}

/* Its points are invalid, the rare ones too: nobody waits a day for them. */
static void test_of_a_device_that_is_back_all_is_read(void **state)
{
	(void)state;
	start_with_a_rare_read();
	bus.slaves[0].fault = MUTE;
	bus.slaves[0].faults = 2;
	run_until_dead(0, 5 * SECOND);
	forget_trace();
	run_for(10 * SECOND);
	assert_true(bus.devices[0].alive);
	assert_int_equal(asked_for(20), 1);
}

/* What is of the moment is over before the period is. */
static void test_what_a_busy_device_did_not_give_is_asked_for_again(void **state)
{
	(void)state;
	set_up();
	add_periodic_device(1, DAY_MS);
	bus.slaves[0].exception = MODBUS_BUSY;
	start();
	run_for(5 * SECOND);
	assert_int_equal(bus.reads_done[0], 0);
	bus.slaves[0].exception = 0;
	run_for(10 * SECOND);
	assert_true(bus.reads_done[0] > 0);
	forget_trace();
	run_for(60 * SECOND);
	assert_int_equal(bus.sent_count, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_periods_hold_and_the_rest_fills_the_line),
	    cmocka_unit_test(test_a_line_with_nothing_else_to_do_waits_for_the_period),
	    cmocka_unit_test(test_deadlines_use_nearly_all_of_the_line),
	    cmocka_unit_test(test_periods_that_cannot_be_held_starve_nobody),
	    cmocka_unit_test(test_after_a_storm_of_commands_periods_hold_again),
	    cmocka_unit_test(test_a_dead_device_costs_the_periods_of_others_its_time_outs),
	    cmocka_unit_test(test_a_read_without_an_answer_is_repeated_in_its_period),
	    cmocka_unit_test(test_what_is_refused_is_asked_for_ever_more_rarely),
	    cmocka_unit_test(test_a_read_once_a_day),
	    cmocka_unit_test(test_of_a_device_that_is_back_all_is_read),
	    cmocka_unit_test(test_what_a_busy_device_did_not_give_is_asked_for_again),
	};
	return cmocka_run_group_tests_name("modbus line periods", tests, NULL, NULL);
}
