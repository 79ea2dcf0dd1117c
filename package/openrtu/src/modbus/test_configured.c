/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "modbus/configured.h"

static void characters_have_ten_to_twelve_bits(void **state)
{
	(void)state;
	struct map_line line = {.stop_bits = 1, .parity = MAP_PARITY_NONE};

	assert_int_equal(modbus_bits_per_char(&line), 10);
	line.stop_bits = 2;
	assert_int_equal(modbus_bits_per_char(&line), 11);
	line.parity = MAP_PARITY_ODD;
	assert_int_equal(modbus_bits_per_char(&line), 12);
}

/* The second line of two; a double whose bits lie apart, the second below the first; a broadcast, never read. */
static void a_line_has_its_own_devices_and_their_reads(void **state)
{
	(void)state;
	struct map_line lines[] = {
	    {.baud = 9600, .stop_bits = 1, .device_count = 1},
	    {.baud = 19200, .stop_bits = 2, .first_device = 1, .device_count = 2},
	};
	struct map_device devices[] = {
	    {.unit = 1, .point_count = 1},
	    {.line = 1, .unit = MODBUS_BROADCAST, .first_point = 1, .point_count = 1},
	    {.line = 1,
	     .unit = 7,
	     .retries = 2,
	     .response_timeout_ms = 300,
	     .max_bits = 32,
	     .max_registers = 4,
	     .no_holes = true,
	     .response_timeout_min_ms = 60,
	     .probe_max_s = 5,
	     .first_point = 2,
	     .point_count = 2},
	};
	struct map_point points[] = {
	    {.table = MAP_COILS, .width = 1},
	    {.device = 1, .table = MAP_COILS, .width = 1, .flags = MAP_POINT_COMMAND},
	    {.device = 2, .table = MAP_HOLDING_REGISTERS, .address = 4, .second_address = 5, .width = 2},
	    {.device = 2,
	     .table = MAP_COILS,
	     .type = MAP_DOUBLE,
	     .address = 20,
	     .second_address = 10,
	     .width = 2,
	     .flags = MAP_POINT_COMMAND},
	};
	const struct map_config config = {.line_count = 2,
					  .device_count = 3,
					  .point_count = 4,
					  .lines = lines,
					  .devices = devices,
					  .points = points};
	struct modbus_line line = {.device_count = 0};

	assert_true(modbus_line_configure(&line, &config, 1));
	assert_int_equal(line.device_count, 2);
	assert_int_equal(line.command_capacity, 2);
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
	assert_int_equal(line.devices[1].read_count, 2);
	assert_int_equal(line.devices[1].reads[0].function, MODBUS_READ_COILS);
	assert_int_equal(line.devices[1].reads[0].address, 10);
	assert_int_equal(line.devices[1].reads[0].count, 11);
	assert_int_equal(line.devices[1].objects[0].tag, 3);
	assert_int_equal(line.devices[1].reads[1].function, MODBUS_READ_HOLDING_REGISTERS);
	assert_int_equal(line.devices[1].reads[1].count, 2);
	modbus_line_release(&line);
}

static void assert_reads(struct map_point point, uint16_t address, uint16_t count)
{
	struct map_line lines[] = {{.baud = 9600, .stop_bits = 1, .device_count = 1}};
	struct map_device devices[] = {{.unit = 1, .point_count = 1}};
	const struct map_config config = {.line_count = 1,
					  .device_count = 1,
					  .point_count = 1,
					  .lines = lines,
					  .devices = devices,
					  .points = &point};
	struct modbus_line line = {.device_count = 0};

	assert_true(modbus_line_configure(&line, &config, 0));
	assert_int_equal(line.devices[0].read_count, 1);
	assert_int_equal(line.devices[0].reads[0].address, address);
	assert_int_equal(line.devices[0].reads[0].count, count);
	modbus_line_release(&line);
}

/* Between two answers the device may change both. */
static void a_scale_register_is_read_with_its_value(void **state)
{
	(void)state;
	struct map_point point = {.table = MAP_HOLDING_REGISTERS,
				  .type = MAP_FLOAT,
				  .address = 71,
				  .second_address = 75,
				  .width = 2,
				  .flags = MAP_POINT_SCALE_REGISTER};

	assert_reads(point, 71, 5);
	point.second_address = 60;
	assert_reads(point, 60, 13);
	point.flags = 0;
	assert_reads(point, 71, 2);
}

static void a_connection_has_no_durations_of_a_wire(void **state)
{
	(void)state;
	struct map_line lines[] = {{.port = 7, .tcp_port = 502, .device_count = 1}};
	struct map_device devices[] = {{.unit = 255, .response_timeout_ms = 500}};
	const struct map_config config = {
	    .line_count = 1, .device_count = 1, .lines = lines, .devices = devices};
	struct modbus_line line = {.device_count = 0};

	assert_true(modbus_line_configure(&line, &config, 0));
	assert_true(line.wire.tcp);
	assert_int_equal(line.wire.char_ns, 0);
	assert_int_equal(line.wire.silence_ns, 0);
	assert_int_equal(line.devices[0].unit, 255);
	modbus_line_release(&line);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(characters_have_ten_to_twelve_bits),
	    cmocka_unit_test(a_line_has_its_own_devices_and_their_reads),
	    cmocka_unit_test(a_scale_register_is_read_with_its_value),
	    cmocka_unit_test(a_connection_has_no_durations_of_a_wire),
	};
	return cmocka_run_group_tests_name("modbus configured", tests, NULL, NULL);
}
