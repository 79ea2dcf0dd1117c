/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Commands and broadcasts: ahead of polling, in order, once. */
#include "modbus/test_bus.h"

static void test_commands_go_ahead_of_polling_in_order(void **state)
{
	(void)state;
	start_simple(0);
	for (uint16_t i = 0; i < 4; i++)
		command(0, MODBUS_WRITE_REGISTER, i, (uint16_t)(900 + i), 10u + i);
	run_for(300 * MS);
	assert_int_equal(bus.commands_done, 4);
	/* the read under way ends first */
	for (size_t i = 0; i < 4; i++) {
		assert_int_equal(bus.tags[i], 10 + i);
		assert_int_equal(bus.sent[i].request.function, MODBUS_WRITE_REGISTER);
	}
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 903);
}

static void test_a_flood_of_commands_stops_no_polling(void **state)
{
	(void)state;
	set_up();
	for (uint8_t unit = 1; unit <= 2; unit++) {
		add_device(unit, 0);
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	}
	start();
	run_for(SECOND);
	forget_trace();
	for (int i = 0; i < 300; i++) {
		while (bus.line.command_count < 3)
			command(0, MODBUS_WRITE_REGISTER, 3, (uint16_t)i, 1);
		run_for(10 * MS);
	}
	assert_true(bus.commands_done > 90);
	assert_true(bus.reads_done[1] > 4);
	assert_true(bus.longest_ns[1] < SECOND);
}

static void test_what_was_written_is_read_back_next(void **state)
{
	(void)state;
	set_up();
	add_device(1, 0);
	add_objects(MODBUS_READ_COILS, 0, 4);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 2);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 30, 2);
	add_device(2, 0);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	start();
	run_for(SECOND);
	for (int round = 0; round < 5; round++) {
		run_for(7 * MS);
		forget_trace();
		command(0, MODBUS_WRITE_REGISTER, 31, 7, 1);
		run_for(200 * MS);
		size_t i = 0;
		while (bus.sent[i].request.function != MODBUS_WRITE_REGISTER)
			i++;
		assert_int_equal(bus.sent[i + 1].request.unit, 1);
		assert_int_equal(bus.sent[i + 1].request.address, 30);
	}
}

/* Three devices that are read in turn: what was written waits for its device's turn. */
static void test_what_is_not_to_be_read_back_waits_for_its_turn(void **state)
{
	(void)state;
	set_up();
	for (uint8_t unit = 1; unit <= 3; unit++) {
		add_device(unit, 0);
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	}
	start();
	run_for(SECOND);
	while (bus.line.turn != 1)
		run_for(MS);
	forget_trace();
	struct modbus_command order = {.deadline_ns = bus.now_ns + SECOND,
				       .request = {1, MODBUS_WRITE_REGISTER, 3, 1, {7}}};
	assert_true(modbus_line_command(&bus.line, &order));
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	size_t i = 0;
	while (bus.sent[i].request.function != MODBUS_WRITE_REGISTER)
		i++;
	assert_int_not_equal(bus.sent[i + 1].request.unit, 1);
	assert_true(sent_with(1, MODBUS_READ_HOLDING_REGISTERS) > 0);
}

/* What is written at one address shows at another, of another table. */
static void test_what_is_read_elsewhere_is_read_back_there(void **state)
{
	size_t i = 0;

	(void)state;
	set_up();
	add_device(1, 0);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	add_objects(MODBUS_READ_INPUT_REGISTERS, 500, 1);
	for (uint16_t far = 0; far < 3; far++)
		add_objects(MODBUS_READ_DISCRETE_INPUTS, (uint16_t)(300 * far), 1);
	start();
	run_for(SECOND);
	while (bus.line.state != MODBUS_IDLE || bus.devices[0].reads[bus.devices[0].cursor].address == 500)
		run_for(MS);
	forget_trace();
	struct modbus_command order = {.deadline_ns = bus.now_ns + SECOND,
				       .read_function = MODBUS_READ_INPUT_REGISTERS,
				       .read_address = 500,
				       .request = {1, MODBUS_WRITE_REGISTER, 3, 1, {7}}};
	assert_true(modbus_line_command(&bus.line, &order));
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	while (bus.sent[i].request.function != MODBUS_WRITE_REGISTER)
		i++;
	assert_int_equal(bus.sent[i + 1].request.function, MODBUS_READ_INPUT_REGISTERS);
	assert_int_equal(bus.sent[i + 1].request.address, 500);
}

static void test_a_refused_command_tells_why(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].missing = 60;
	command(0, MODBUS_WRITE_REGISTER, 60, 1, 1);
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_REFUSED);
	assert_int_equal(bus.last_exception, 2);
}

static void test_a_command_past_its_deadline_is_not_sent(void **state)
{
	(void)state;
	start_simple(0);
	struct modbus_command old = {.deadline_ns = bus.now_ns - 1,
				     .request = {17, MODBUS_WRITE_REGISTER, 0, 1, {1}}};
	assert_true(modbus_line_command(&bus.line, &old));
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_TOO_OLD);
	assert_int_equal(bus.commands_done, 1);
	assert_int_equal(sent_with(17, MODBUS_WRITE_REGISTER), 0);
}

static void test_the_queue_has_an_end(void **state)
{
	(void)state;
	start_simple(0);
	struct modbus_command order = {.deadline_ns = bus.now_ns + SECOND,
				       .request = {17, MODBUS_WRITE_REGISTER, 0, 1, {1}}};
	for (int i = 0; i < COMMANDS_MAX; i++)
		assert_true(modbus_line_command(&bus.line, &order));
	assert_false(modbus_line_command(&bus.line, &order));
	modbus_line_close(&bus.line, bus.now_ns);
	assert_int_equal(bus.commands_done, COMMANDS_MAX);
	assert_int_equal(bus.last_result, MODBUS_NOT_SENT);
}

static void test_writes_are_never_repeated(void **state)
{
	(void)state;
	start_simple(3);
	bus.slaves[0].present = false;
	command(0, MODBUS_WRITE_REGISTER, 3, 7, 1);
	run_for(30 * SECOND);
	assert_int_equal(sent_with(17, MODBUS_WRITE_REGISTER), 1);
	assert_int_equal(bus.commands_done, 1);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
	/* a dead device is tried, once */
	assert_false(bus.devices[0].alive);
	bus.slaves[0].present = true;
	command(0, MODBUS_WRITE_REGISTER, 3, 8, 2);
	run_for(SECOND);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_true(bus.devices[0].alive);
	assert_int_equal(bus.slaves[0].registers[3], 8);
}

static void test_a_broadcast_is_done_after_its_turnaround(void **state)
{
	(void)state;
	start_simple(0);
	add_device(MODBUS_BROADCAST, 0);
	command(1, MODBUS_WRITE_REGISTER, 6, 4321, 9);
	run_for(100 * MS);
	assert_int_equal(bus.commands_done, 0);
	run_for(130 * MS);
	assert_int_equal(bus.commands_done, 1);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[6], 4321);
	size_t i = 0;
	while (bus.sent[i].request.unit != MODBUS_BROADCAST)
		i++;
	assert_int_equal(bus.sent[i + 1].time_ns - bus.sent[i].time_ns,
			 8 * bus.line.wire.char_ns + MODBUS_BROADCAST_NS);
	assert_int_equal(bus.line.counters.timeouts, 0);
}

/* Nobody answers a broadcast: it need not wait for anybody's missing answer. */
static void test_a_broadcast_goes_out_at_once(void **state)
{
	(void)state;
	set_up();
	add_device(MODBUS_BROADCAST, 0);
	add_objects(MODBUS_READ_COILS, 0, 4);
	start();
	command(0, MODBUS_WRITE_COIL, 0, 1, 1);
	run_for(200 * MS);
	assert_int_equal(bus.commands_done, 1);
	assert_int_equal(bus.last_result, MODBUS_DONE);
}

/* Whoever commands a device that never answered gets an answer all the same. */
static void test_a_device_that_never_answered_is_commanded(void **state)
{
	(void)state;
	set_up();
	add_device(17, 0);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 1);
	bus.slaves[0].present = false;
	start();
	command(0, MODBUS_WRITE_REGISTER, 0, 1, 1);
	run_for(3 * SECOND);
	assert_int_equal(sent_with(17, MODBUS_WRITE_REGISTER), 1);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
	assert_int_equal(bus.commands_done, 1);
}

static void test_two_registers_are_written_in_one_request(void **state)
{
	(void)state;
	start_simple(0);
	struct modbus_command order = {.deadline_ns = bus.now_ns + SECOND,
				       .request = {17, MODBUS_WRITE_REGISTERS, 4, 2, {0x4148, 0x1234}}};
	assert_true(modbus_line_command(&bus.line, &order));
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[4], 0x4148);
	assert_int_equal(bus.slaves[0].registers[5], 0x1234);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_commands_go_ahead_of_polling_in_order),
	    cmocka_unit_test(test_a_flood_of_commands_stops_no_polling),
	    cmocka_unit_test(test_what_was_written_is_read_back_next),
	    cmocka_unit_test(test_what_is_not_to_be_read_back_waits_for_its_turn),
	    cmocka_unit_test(test_what_is_read_elsewhere_is_read_back_there),
	    cmocka_unit_test(test_a_refused_command_tells_why),
	    cmocka_unit_test(test_a_command_past_its_deadline_is_not_sent),
	    cmocka_unit_test(test_the_queue_has_an_end),
	    cmocka_unit_test(test_writes_are_never_repeated),
	    cmocka_unit_test(test_a_broadcast_is_done_after_its_turnaround),
	    cmocka_unit_test(test_a_broadcast_goes_out_at_once),
	    cmocka_unit_test(test_a_device_that_never_answered_is_commanded),
	    cmocka_unit_test(test_two_registers_are_written_in_one_request),
	};
	return cmocka_run_group_tests_name("modbus line commands", tests, NULL, NULL);
}
