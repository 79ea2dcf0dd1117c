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

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_pause_of_the_configuration_is_kept),
	    cmocka_unit_test(test_a_pause_costs_the_neighbour_nothing),
	    cmocka_unit_test(test_a_scan_ends_with_the_slowest),
	    cmocka_unit_test(test_a_command_and_its_read_back_wait_for_the_pause),
	    cmocka_unit_test(test_a_pause_is_kept_on_tcp),
	};
	return cmocka_run_group_tests_name("modbus line pauses", tests, NULL, NULL);
}
