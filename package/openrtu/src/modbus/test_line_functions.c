/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Devices that know one of two functions that write the same: only their word for it (exception 1) sends a write again. */
#include "modbus/test_bus.h"

#define BIT(function) (1u << (function))

static void start_with(uint32_t unknown)
{
	start_simple(1);
	bus.slaves[0].unknown = unknown;
}

/* The command, and what was sent for it. */
static void write_one(uint8_t function, uint16_t value, unsigned with_function, unsigned with_other)
{
	static const uint8_t others[] = {[MODBUS_WRITE_COIL] = MODBUS_WRITE_COILS,
					 [MODBUS_WRITE_COILS] = MODBUS_WRITE_COIL,
					 [MODBUS_WRITE_REGISTER] = MODBUS_WRITE_REGISTERS,
					 [MODBUS_WRITE_REGISTERS] = MODBUS_WRITE_REGISTER};

	forget_trace();
	command(0, function, 3, value, value);
	run_for(SECOND);
	assert_int_equal(bus.last_tag, value);
	assert_int_equal(sent_with(17, function), with_function);
	assert_int_equal(sent_with(17, others[function]), with_other);
}

static void test_a_device_without_function_6_is_written_with_16(void **state)
{
	(void)state;
	start_with(BIT(MODBUS_WRITE_REGISTER));
	write_one(MODBUS_WRITE_REGISTER, 7, 1, 1);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 7);
	assert_int_equal(bus.devices[0].writes.registers, MODBUS_WRITE_REGISTERS);
	/* From then on at once. */
	write_one(MODBUS_WRITE_REGISTER, 8, 0, 1);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 8);
	assert_int_equal(bus.turns, 1);
	assert_int_equal(bus.commands_done, 2);
}

static void test_a_device_without_function_16_is_written_with_6(void **state)
{
	(void)state;
	start_with(BIT(MODBUS_WRITE_REGISTERS));
	bus.devices[0].writes_multiple = true;
	write_one(MODBUS_WRITE_REGISTER, 7, 1, 1);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 7);
	write_one(MODBUS_WRITE_REGISTER, 8, 1, 0);
	assert_int_equal(bus.devices[0].writes.registers, MODBUS_WRITE_REGISTER);
}

static void test_coils_and_registers_are_learned_apart(void **state)
{
	(void)state;
	start_with(BIT(MODBUS_WRITE_COIL));
	write_one(MODBUS_WRITE_COIL, 1, 1, 1);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	write_one(MODBUS_WRITE_REGISTER, 8, 1, 0);
	write_one(MODBUS_WRITE_COIL, 0, 0, 1);
	assert_int_equal(bus.devices[0].writes.coils, MODBUS_WRITE_COILS);
	assert_int_equal(bus.devices[0].writes.registers, 0);
}

static void test_the_configuration_says_which(void **state)
{
	(void)state;
	start_with(BIT(MODBUS_WRITE_REGISTER) | BIT(MODBUS_WRITE_COIL));
	bus.devices[0].writes_multiple = true;
	write_one(MODBUS_WRITE_REGISTER, 7, 0, 1);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	write_one(MODBUS_WRITE_COIL, 1, 0, 1);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.turns, 0);
}

static void test_a_device_that_knows_neither_refuses(void **state)
{
	(void)state;
	start_with(BIT(MODBUS_WRITE_REGISTER) | BIT(MODBUS_WRITE_REGISTERS));
	for (uint16_t i = 1; i < 4; i++) {
		write_one(MODBUS_WRITE_REGISTER, i, 1, 1);
		assert_int_equal(bus.last_result, MODBUS_REFUSED);
		assert_int_equal(bus.last_exception, 1);
	}
	assert_int_equal(bus.commands_done, 3);
	assert_int_equal(bus.turns, 0); /* neither is what it is written with */
}

/* It may have done what it was told. */
static void test_silence_sends_nothing_again(void **state)
{
	(void)state;
	start_with(BIT(MODBUS_WRITE_REGISTER));
	bus.slaves[0].dumb = true;
	for (uint16_t i = 1; i < 4; i++) {
		run_for(5 * SECOND);
		write_one(MODBUS_WRITE_REGISTER, i, 1, 0);
		assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
	}
	assert_int_equal(bus.turns, 0);
	assert_int_equal(bus.devices[0].writes.registers, 0);
}

/* Nor does any other word. */
static void test_another_exception_sends_nothing_again(void **state)
{
	(void)state;
	start_with(0);
	for (uint8_t exception = 2; exception < 12; exception++) {
		bus.slaves[0].exception = exception;
		write_one(MODBUS_WRITE_REGISTER, exception, 1, 0);
		assert_int_equal(bus.last_result, MODBUS_REFUSED);
	}
	assert_int_equal(bus.turns, 0);
}

/* The second is not answered: it may have been carried out. */
static void test_the_second_is_not_sent_again(void **state)
{
	(void)state;
	start_with(BIT(MODBUS_WRITE_REGISTER) | BIT(MODBUS_WRITE_REGISTERS));
	command(0, MODBUS_WRITE_REGISTER, 3, 7, 1);
	while (bus.devices[0].writes.registers == 0)
		run_for(MS);
	bus.slaves[0].present = false;
	run_for(10 * SECOND);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
	assert_int_equal(bus.commands_done, 1);
	assert_int_equal(sent_with(17, MODBUS_WRITE_REGISTERS), 1);
	assert_int_equal(bus.turns, 0); /* nor is it known that the device knows it */
}

/* Nothing is written in order to learn. */
static void test_nothing_is_written_without_a_command(void **state)
{
	(void)state;
	start_with(BIT(MODBUS_WRITE_REGISTER));
	run_for(60 * SECOND);
	for (uint8_t function = MODBUS_WRITE_COIL; function <= MODBUS_WRITE_REGISTERS; function++)
		assert_int_equal(sent_with(17, function), 0);
}

/* The queue is full again by the time the device answers: the command that was taken first has no place any more. */
static void test_a_full_queue_refuses(void **state)
{
	(void)state;
	start_with(BIT(MODBUS_WRITE_REGISTER));
	command(0, MODBUS_WRITE_REGISTER, 3, 7, 1);
	while (bus.line.purpose != MODBUS_COMMAND)
		run_for(MS);
	for (uint32_t i = 0; i < COMMANDS_MAX; i++)
		command(0, MODBUS_WRITE_REGISTER, 4, (uint16_t)i, 100 + i);
	run_for(3 * SECOND);
	assert_int_equal(bus.commands_done, 1 + COMMANDS_MAX);
	assert_int_equal(bus.tags[0], 1);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[4], COMMANDS_MAX - 1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_device_without_function_6_is_written_with_16),
	    cmocka_unit_test(test_a_device_without_function_16_is_written_with_6),
	    cmocka_unit_test(test_coils_and_registers_are_learned_apart),
	    cmocka_unit_test(test_the_configuration_says_which),
	    cmocka_unit_test(test_a_device_that_knows_neither_refuses),
	    cmocka_unit_test(test_silence_sends_nothing_again),
	    cmocka_unit_test(test_another_exception_sends_nothing_again),
	    cmocka_unit_test(test_the_second_is_not_sent_again),
	    cmocka_unit_test(test_nothing_is_written_without_a_command),
	    cmocka_unit_test(test_a_full_queue_refuses),
	};
	return cmocka_run_group_tests_name("modbus line functions", tests, NULL, NULL);
}
