/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "modbus/configured.h"

static void test_characters_have_ten_to_twelve_bits(void **state)
{
	(void)state;
	struct modbus_port line = {.data_bits = 8, .stop_bits = 1, .parity = MODBUS_PARITY_NONE};

	assert_int_equal(modbus_bits_per_char(&line), 10);
	line.stop_bits = 2;
	assert_int_equal(modbus_bits_per_char(&line), 11);
	line.parity = MODBUS_PARITY_ODD;
	assert_int_equal(modbus_bits_per_char(&line), 12);
}

/* The second line of two; a double whose bits lie apart, the second below the first; a broadcast and a coil, never read. */
static void test_a_line_has_its_own_devices_and_their_reads(void **state)
{
	(void)state;
	struct modbus_port lines[] = {
	    {.baud = 9600, .data_bits = 8, .stop_bits = 1, .device_count = 1},
	    {.baud = 19200, .data_bits = 8, .stop_bits = 2, .first_device = 1, .device_count = 2},
	};
	struct modbus_slave slaves[] = {
	    {.unit = 1},
	    {.port = 1, .unit = MODBUS_BROADCAST},
	    {.port = 1,
	     .unit = 7,
	     .retries = 2,
	     .response_timeout_ms = 300,
	     .max_bits = 32,
	     .max_registers = 4,
	     .no_holes = true,
	     .response_timeout_min_ms = 60,
	     .probe_max_s = 5},
	};
	struct map_set sets[] = {
	    {.point_count = 1}, {.first_point = 1, .point_count = 1}, {.first_point = 2, .point_count = 3}};
	struct modbus_point wire[] = {
	    {.table = MODBUS_COILS, .width = 1},
	    {.table = MODBUS_COILS, .width = 1},
	    {.table = MODBUS_HOLDING_REGISTERS, .address = 4, .second_address = 5, .width = 2},
	    {.table = MODBUS_COILS, .type = MAP_DOUBLE, .address = 20, .second_address = 10, .width = 2},
	    {.table = MODBUS_COILS, .address = 12, .width = 1},
	};
	struct map_point points[] = {{.set = 0},
				     {.set = 1, .flags = MAP_POINT_COMMAND},
				     {.set = 2},
				     {.set = 2, .flags = MAP_POINT_COMMAND},
				     {.set = 2, .flags = MAP_POINT_COMMAND | MAP_POINT_NEVER_READ}};
	struct map_config config = {.set_count = 3, .point_count = 5, .sets = sets, .points = points};
	struct modbus_line line = {.device_count = 0};

	map_add_section(&config, MODBUS_PORTS, sizeof(lines[0]), sizeof(lines) / sizeof(lines[0]), lines);
	map_add_section(&config, MODBUS_POINTS, sizeof(wire[0]), 5, wire);
	map_add_section(&config, MODBUS_SLAVES, sizeof(slaves[0]), sizeof(slaves) / sizeof(slaves[0]),
			slaves);
	assert_true(modbus_line_configure(&line, &config, 1));
	assert_int_equal(line.device_count, 2);
	assert_int_equal(line.command_capacity, 3);
	assert_int_equal(line.wire.char_ns, 1000000000 * 11LL / 19200);
	assert_int_equal(line.devices[0].read_count, 0);
	assert_int_equal(line.devices[1].unit, 7);
	assert_int_equal(line.devices[1].retries, 2);
	assert_int_equal(line.devices[1].response_timeout_ns, 300000000);
	assert_int_equal(line.devices[1].limits.bits, 32);
	assert_int_equal(line.devices[1].limits.registers, 4);
	assert_true(line.devices[1].limits.no_holes);
	assert_int_equal(line.devices[1].response_timeout_min_ns, 60000000);
	assert_int_equal(line.devices[1].probe_max_ns, 5000000000);
	assert_int_equal(line.devices[1].object_count, 2);
	assert_int_equal(line.devices[1].read_count, 2);
	assert_int_equal(line.devices[1].reads[0].function, MODBUS_READ_COILS);
	assert_int_equal(line.devices[1].reads[0].address, 10);
	assert_int_equal(line.devices[1].reads[0].count, 11);
	assert_int_equal(line.devices[1].objects[0].tag, 3);
	assert_int_equal(line.devices[1].reads[1].function, MODBUS_READ_HOLDING_REGISTERS);
	assert_int_equal(line.devices[1].reads[1].count, 2);
	modbus_line_release(&line);
}

static void assert_reads(struct modbus_point wire, uint16_t address, uint16_t count)
{
	struct modbus_port lines[] = {{.baud = 9600, .data_bits = 8, .stop_bits = 1, .device_count = 1}};
	struct modbus_slave slaves[] = {{.unit = 1}};
	struct map_set sets[] = {{.point_count = 1}};
	struct map_point point = {.set = 0};
	struct map_config config = {.set_count = 1, .point_count = 1, .sets = sets, .points = &point};
	struct modbus_line line = {.device_count = 0};

	map_add_section(&config, MODBUS_PORTS, sizeof(lines[0]), sizeof(lines) / sizeof(lines[0]), lines);
	map_add_section(&config, MODBUS_POINTS, sizeof(wire), 1, &wire);
	map_add_section(&config, MODBUS_SLAVES, sizeof(slaves[0]), sizeof(slaves) / sizeof(slaves[0]),
			slaves);
	assert_true(modbus_line_configure(&line, &config, 0));
	assert_int_equal(line.devices[0].read_count, 1);
	assert_int_equal(line.devices[0].reads[0].address, address);
	assert_int_equal(line.devices[0].reads[0].count, count);
	modbus_line_release(&line);
}

/* Between two answers the device may change both. */
static void test_a_scale_register_is_read_with_its_value(void **state)
{
	(void)state;
	struct modbus_point point = {.table = MODBUS_HOLDING_REGISTERS,
				     .type = MAP_FLOAT,
				     .address = 71,
				     .second_address = 75,
				     .width = 2,
				     .flags = MODBUS_SCALE_REGISTER};

	assert_reads(point, 71, 5);
	point.second_address = 60;
	assert_reads(point, 60, 13);
	point.flags = 0;
	assert_reads(point, 71, 2);
}

static void test_a_connection_has_no_durations_of_a_wire(void **state)
{
	(void)state;
	struct modbus_port lines[] = {
	    {.port = 7, .tcp_port = 502, .framing = MODBUS_FRAMING_TCP, .device_count = 1}};
	struct modbus_slave slaves[] = {{.unit = 255, .response_timeout_ms = 500}};
	struct map_set sets[] = {{.point_count = 0}};
	struct map_config config = {.set_count = 1, .sets = sets};
	struct modbus_line line = {.device_count = 0};

	map_add_section(&config, MODBUS_PORTS, sizeof(lines[0]), sizeof(lines) / sizeof(lines[0]), lines);
	map_add_section(&config, MODBUS_SLAVES, sizeof(slaves[0]), sizeof(slaves) / sizeof(slaves[0]),
			slaves);
	assert_true(modbus_line_configure(&line, &config, 0));
	assert_true(line.wire.connection);
	assert_int_equal(line.wire.char_ns, 0);
	assert_int_equal(line.wire.silence_ns, 0);
	assert_int_equal(line.devices[0].unit, 255);
	modbus_line_release(&line);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_characters_have_ten_to_twelve_bits),
	    cmocka_unit_test(test_a_line_has_its_own_devices_and_their_reads),
	    cmocka_unit_test(test_a_scale_register_is_read_with_its_value),
	    cmocka_unit_test(test_a_connection_has_no_durations_of_a_wire),
	};
	return cmocka_run_group_tests_name("modbus configured", tests, NULL, NULL);
}
