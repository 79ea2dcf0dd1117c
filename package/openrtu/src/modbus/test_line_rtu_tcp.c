/* SPDX-License-Identifier: GPL-3.0-or-later */
/* RTU frames on a TCP connection: no transaction says what an answer answers, and a network may be slow inside a frame. */
#include "modbus/test_bus.h"

static void set_up_device(uint16_t objects)
{
	set_up();
	use_connection(MODBUS_FRAMING_RTU);
	add_device(17, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, objects);
}

static void test_it_is_scanned_without_durations_of_a_wire(void **state)
{
	(void)state;
	set_up_device(8);
	start();
	run_for(10 * SECOND);
	assert_true(bus.devices[0].alive);
	assert_in_range(bus.reads_done[0], 900, 1000); /* one each 10 ms, behind the rest */
	assert_int_equal(bus.line.counters.noise_bytes, 0);
	assert_int_equal(bus.line.counters.crc_errors, 0);
}

static void test_a_wrong_crc_is_counted(void **state)
{
	(void)state;
	set_up_device(8);
	start();
	run_for(SECOND);
	bus.slaves[0].fault = CORRUPT;
	bus.slaves[0].faults = 1;
	run_for(SECOND);
	assert_int_equal(bus.line.counters.crc_errors, 1);
	assert_true(bus.devices[0].alive);
}

/* More than a serial line may take between two characters. */
static void test_an_answer_comes_in_pieces(void **state)
{
	(void)state;
	set_up_device(1);
	bus.spread_ns = 55 * MS;
	start();
	run_for(20 * SECOND);
	assert_true(bus.reads_done[0] > 20);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_int_equal(bus.line.counters.crc_errors, 0);
}

static void test_a_late_answer_is_never_taken_for_anothers(void **state)
{
	(void)state;
	set_up();
	use_connection(MODBUS_FRAMING_RTU);
	expect_late_answers_apart();
}

/* The peer hangs up on a read, and its answer comes on the next connection: a server of serial devices does that. */
static void test_an_answer_of_the_connection_before_is_nobodys(void **state)
{
	uint8_t late[16] = {17, MODBUS_READ_HOLDING_REGISTERS, 2, 0xAB, 0xCD};

	(void)state;
	set_up_device(1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 300, 1);
	start();
	run_for(SECOND);
	while (bus.line.state != MODBUS_WAITING)
		run_for(MS);
	bus.hang_up_ns = bus.now_ns + 1;
	run_for(MS);
	assert_true(bus.apart || bus.connections == 2);
	while (bus.connections < 2)
		run_for(MS);
	put_on_wire(bus.now_ns + MS, late, seal(late, 5));
	run_for(5 * SECOND); /* on_read looks at each value */
	assert_true(bus.devices[0].alive);
	assert_int_equal(bus.line.counters.late_answers + bus.line.counters.unasked_frames, 1);
}

/* Half an answer belongs to its connection. */
static void test_the_beginning_of_an_answer_ends_with_its_connection(void **state)
{
	const uint8_t beginning[] = {17, MODBUS_READ_HOLDING_REGISTERS, 16};

	(void)state;
	set_up_device(8);
	start();
	run_for(SECOND);
	while (bus.line.state != MODBUS_WAITING)
		run_for(MS);
	bus.wire_count = 0;
	put_on_wire(bus.now_ns, beginning, sizeof(beginning));
	deliver();
	assert_int_equal(bus.line.received_count, 3);
	bus.hang_up_ns = bus.now_ns + 1;
	run_for(SECOND);
	assert_int_equal(bus.line.counters.crc_errors, 0);
	assert_int_equal(bus.line.counters.noise_bytes, 0);
	assert_true(bus.reads_done[0] > 100);
}

/* Register 3 of each device becomes 7. */
static void command_all(void)
{
	set_up_device(8);
	add_device(MODBUS_BROADCAST, 0);
	start();
	run_for(SECOND);
	command(1, MODBUS_WRITE_REGISTER, 3, 7, 1);
}

/* As behind a server of serial devices: unit 0 is heard by all, and answered by none. */
static void test_unit_0_is_the_broadcast(void **state)
{
	(void)state;
	command_all();
	run_for(SECOND);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 7);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_true(bus.devices[0].alive);
}

/* Nobody knows whether the devices have heard it. */
static void test_a_broadcast_ends_with_its_connection(void **state)
{
	(void)state;
	command_all();
	while (bus.line.state != MODBUS_TURNAROUND)
		run_for(MS);
	bus.hang_up_ns = bus.now_ns + 1;
	run_for(MS);
	assert_int_equal(bus.commands_done, 1);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
	run_for(SECOND);
	assert_int_equal(bus.commands_done, 1);
	assert_true(bus.devices[0].alive);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_it_is_scanned_without_durations_of_a_wire),
	    cmocka_unit_test(test_a_wrong_crc_is_counted),
	    cmocka_unit_test(test_an_answer_comes_in_pieces),
	    cmocka_unit_test(test_a_late_answer_is_never_taken_for_anothers),
	    cmocka_unit_test(test_an_answer_of_the_connection_before_is_nobodys),
	    cmocka_unit_test(test_the_beginning_of_an_answer_ends_with_its_connection),
	    cmocka_unit_test(test_unit_0_is_the_broadcast),
	    cmocka_unit_test(test_a_broadcast_ends_with_its_connection),
	};
	return cmocka_run_group_tests_name("modbus line RTU over TCP", tests, NULL, NULL);
}
