/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Reads that a device refuses, or does not answer, for one of their objects. */
#include "modbus/test_bus.h"

static void test_a_refused_read_is_halved_down_to_the_object(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].missing = 5;
	run_for(2 * SECOND);
	assert_int_equal(bus.refused_addresses[0], 1u << 5);
	assert_int_equal(bus.last_exception, 2);
	assert_int_equal(bus.devices[0].read_count, 4); /* 0-3, 4, 5, 6-7 */
	assert_int_equal(bus.deaths[0], 0);
	run_for(200 * SECOND);
	forget_trace();
	bus.refused_addresses[0] = 0;
	run_for(120 * SECOND);
	assert_int_equal(bus.line.counters.exceptions, 2); /* asked again, rarely */
	assert_int_equal(bus.refused_addresses[0], 0);     /* which is not news */
	assert_true(bus.objects_read[0] > 7 * 1000);
	bus.slaves[0].missing = -1;
	run_for(61 * SECOND);
	assert_int_equal(bus.devices[0].read_count, 1); /* given at last: whole again */
}

static void test_all_objects_refused_leaves_a_living_device(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].exception = 1;
	run_for(200 * SECOND);
	assert_int_equal(bus.refused_addresses[0], 0xFF);
	assert_true(bus.devices[0].alive);
	forget_trace();
	run_for(60 * SECOND);
	assert_int_equal(bus.sent_count, 8);
	bus.slaves[0].exception = 0;
	run_for(61 * SECOND);
	assert_int_equal(bus.devices[0].read_count, 1);
	assert_true(bus.reads_done[0] > 100);
}

static void test_a_busy_device_is_not_split(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].exception = 6;
	run_for(4 * SECOND);
	assert_int_equal(bus.devices[0].read_count, 1);
	assert_int_equal(bus.refused_addresses[0], 0xFF);
	assert_int_equal(bus.last_exception, 6);
	assert_in_range(bus.line.counters.exceptions, 3, 4);
	bus.slaves[0].exception = 0;
	run_for(5 * SECOND);
	assert_true(bus.reads_done[0] > 10);
}

/* Of all others one object may be to blame, also of those that the standard does not know. */
static void test_only_exceptions_of_the_moment_leave_a_read_whole(void **state)
{
	static const uint8_t of_the_moment[] = {5, 6, 10, 11};
	size_t next = 0;

	(void)state;
	for (unsigned exception = 1; exception <= 255; exception++) {
		bool momentary = next < sizeof(of_the_moment) && of_the_moment[next] == exception;

		next += momentary;
		start_simple(0);
		bus.slaves[0].exception = (uint8_t)exception;
		run_for(4 * SECOND);
		assert_int_equal(modbus_is_of_the_moment((uint8_t)exception), momentary);
		assert_int_equal(bus.devices[0].read_count, momentary ? 1 : 8);
		assert_int_equal(bus.refused_addresses[0], 0xFF);
		assert_int_equal(bus.last_exception, exception);
		assert_true(bus.devices[0].alive);
	}
}

/* What a busy device holds is old; what it then says it does not have is wrong. */
static void test_a_refusal_for_another_reason_is_told(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].exception = 6;
	run_for(4 * SECOND);
	assert_int_equal(bus.last_exception, 6);
	bus.refused_addresses[0] = 0;
	bus.slaves[0].exception = 11;
	run_for(8 * SECOND);
	assert_int_equal(bus.last_exception, 11);
	assert_int_equal(bus.refused_addresses[0], 0xFF);
	bus.refused_addresses[0] = 0;
	run_for(60 * SECOND);
	assert_int_equal(bus.refused_addresses[0], 0); /* no news */
	bus.slaves[0].exception = 2;
	run_for(120 * SECOND);
	assert_int_equal(bus.last_exception, 2);
	assert_int_equal(bus.refused_addresses[0], 0xFF);
}

static void test_a_device_that_was_gone_is_planned_anew(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].missing = 5;
	run_for(130 * SECOND); /* it is asked for what it refused each minute only */
	assert_int_equal(bus.devices[0].read_count, 4);
	bus.slaves[0].present = false;
	run_for(2 * SECOND);
	bus.slaves[0].present = true;
	bus.slaves[0].missing = -1;
	run_for(3 * SECOND);
	assert_true(bus.devices[0].alive);
	assert_int_equal(bus.devices[0].read_count, 1);
}

static void test_one_lost_answer_does_not_split_a_read(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].fault = MUTE;
	bus.slaves[0].faults = 1;
	run_for(3 * SECOND);
	assert_int_equal(bus.deaths[0], 1);
	assert_true(bus.devices[0].alive);
	assert_int_equal(bus.devices[0].read_count, 1);
}

/* Some devices do not answer a read over an address they do not have. They are not dead. */
static void test_a_silent_read_is_halved_too(void **state)
{
	(void)state;
	for (uint8_t retries = 0; retries < 5; retries++) {
		start_simple(retries);
		bus.slaves[0].deaf = 5;
		run_for(20 * SECOND);
		assert_true(bus.devices[0].alive);
		assert_int_equal(bus.devices[0].read_count, 4);
		forget_trace();
		run_for(SECOND);
		assert_int_equal(bus.line.counters.timeouts, 0);
		assert_true(bus.objects_read[0] > 8 * 5);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_refused_read_is_halved_down_to_the_object),
	    cmocka_unit_test(test_all_objects_refused_leaves_a_living_device),
	    cmocka_unit_test(test_a_busy_device_is_not_split),
	    cmocka_unit_test(test_only_exceptions_of_the_moment_leave_a_read_whole),
	    cmocka_unit_test(test_a_refusal_for_another_reason_is_told),
	    cmocka_unit_test(test_a_device_that_was_gone_is_planned_anew),
	    cmocka_unit_test(test_one_lost_answer_does_not_split_a_read),
	    cmocka_unit_test(test_a_silent_read_is_halved_too),
	};
	return cmocka_run_group_tests_name("modbus line refused", tests, NULL, NULL);
}
