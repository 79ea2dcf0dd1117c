/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <float.h>

#include "modbus/convert.h"
#include "modules/modbus/operation.h"

#define UNIT  7
#define LIMIT MAP_RESULT_OUT_OF_RANGE
#define NEVER MAP_RESULT_NOT_COMMANDABLE

/* A point, and how it stands in its slave. */
struct object {
	struct map_point point;
	struct modbus_point wire;
};

static const struct object single = {
    .wire = {.table = MODBUS_COILS, .type = MAP_SINGLE, .width = 1, .address = 300, .scale = 1},
    .point = {.type = MAP_SINGLE}};
static const struct object neighbours = {
    .wire = {.table = MODBUS_COILS, .type = MAP_DOUBLE, .width = 2, .address = 10, .second_address = 11},
    .point = {.type = MAP_DOUBLE}};
static const struct object apart = {
    .wire = {.table = MODBUS_COILS, .type = MAP_DOUBLE, .width = 2, .address = 10, .second_address = 20},
    .point = {.type = MAP_DOUBLE}};
static const struct object level = {.wire = {.table = MODBUS_HOLDING_REGISTERS,
					     .type = MAP_SCALED,
					     .format = MODBUS_FORMAT_INT16,
					     .width = 1,
					     .address = 5,
					     .scale = 1},
				    .point = {.type = MAP_SCALED, .step = 10, .min = -20, .max = 25}};
static const struct object current = {.wire = {.table = MODBUS_HOLDING_REGISTERS,
					       .type = MAP_FLOAT,
					       .format = MODBUS_FORMAT_FLOAT32,
					       .width = 2,
					       .address = 6,
					       .second_address = 7,
					       .scale = 1},
				      .point = {.type = MAP_FLOAT, .step = 0.5f, .min = 0, .max = 2}};

static struct map_request set(int32_t value)
{
	return (struct map_request){.value.i = value};
}

static struct map_request pulse(int32_t value)
{
	return (struct map_request){.value.i = value, .pulse_ms = 100};
}

static struct map_request step(int8_t direction)
{
	return (struct map_request){.step = direction};
}

static void assert_result(struct object point, struct map_request request, enum map_command_result result)
{
	const struct map_sample last = {.value.i = 0};
	struct operation operation;

	assert_int_equal(
	    operation_begin(&point.point, &point.wire, NULL, 0, UNIT, &request, &last, &operation), result);
}

static struct operation begin(struct object point, struct map_request request, struct map_sample last)
{
	struct operation operation;

	assert_int_equal(
	    operation_begin(&point.point, &point.wire, NULL, 0, UNIT, &request, &last, &operation),
	    MAP_RESULT_NONE);
	return operation;
}

static void assert_write(const struct modbus_request *write, uint8_t function, uint16_t address,
			 uint16_t first, uint16_t second)
{
	assert_int_equal(write->unit, UNIT);
	assert_int_equal(write->function, function);
	assert_int_equal(write->address, address);
	assert_int_equal(write->count,
			 function < MODBUS_WRITE_COILS || function == MODBUS_MASK_WRITE_REGISTER ? 1 : 2);
	assert_int_equal(write->values[0], first);
	assert_int_equal(write->values[1], second);
}

static void assert_one_write(struct operation operation, uint8_t function, uint16_t address, uint16_t first,
			     uint16_t second)
{
	assert_int_equal(operation.count, 1);
	assert_write(&operation.writes[0], function, address, first, second);
}

static const struct map_sample none;

static void test_one_write_of_one_object(void **state)
{
	struct object backwards = neighbours, bitstring = current;

	(void)state;
	assert_one_write(begin(single, set(1), none), MODBUS_WRITE_COIL, 300, 1, 0);
	assert_one_write(begin(single, set(0), none), MODBUS_WRITE_COIL, 300, 0, 0);
	assert_one_write(begin(level, set(-3), none), MODBUS_WRITE_REGISTER, 5, 0xFFFD, 0);
	assert_one_write(begin(neighbours, set(1), none), MODBUS_WRITE_COILS, 10, 1, 0);
	assert_one_write(begin(neighbours, set(2), none), MODBUS_WRITE_COILS, 10, 0, 1);
	backwards.wire.second_address = 9;
	assert_one_write(begin(backwards, set(2), none), MODBUS_WRITE_COILS, 9, 1, 0);
	backwards.wire.flags = MODBUS_BITS_SWAPPED;
	assert_one_write(begin(backwards, set(2), none), MODBUS_WRITE_COILS, 9, 0, 1);
	bitstring.point.type = bitstring.wire.type = MAP_BITSTRING;
	bitstring.point.step = bitstring.point.max = 0;
	assert_one_write(begin(bitstring, set(0x12345678), none), MODBUS_WRITE_REGISTERS, 6, 0x1234, 0x5678);
}

static void test_of_coils_that_lie_apart_off_goes_first(void **state)
{
	struct object swapped = apart;
	struct operation operation = begin(apart, set(2), none);

	(void)state;
	assert_int_equal(operation.count, 2);
	assert_write(&operation.writes[0], MODBUS_WRITE_COIL, 10, 0, 0);
	assert_write(&operation.writes[1], MODBUS_WRITE_COIL, 20, 1, 0);
	operation = begin(apart, set(1), none);
	assert_write(&operation.writes[0], MODBUS_WRITE_COIL, 20, 0, 0);
	assert_write(&operation.writes[1], MODBUS_WRITE_COIL, 10, 1, 0);
	swapped.wire.flags = MODBUS_BITS_SWAPPED;
	operation = begin(swapped, set(1), none);
	assert_write(&operation.writes[0], MODBUS_WRITE_COIL, 10, 0, 0);
	assert_write(&operation.writes[1], MODBUS_WRITE_COIL, 20, 1, 0);
	assert_false(operation_switches_on(&apart.wire, &operation.writes[0]));
	assert_true(operation_switches_on(&apart.wire, &operation.writes[1]));
}

static void test_two_neighbours_are_divided_and_off_goes_first(void **state)
{
	struct operation operation = begin(neighbours, set(2), none);

	(void)state;
	assert_one_write(operation, MODBUS_WRITE_COILS, 10, 0, 1);
	assert_true(operation_divide(&operation));
	assert_int_equal(operation.count, 2);
	assert_write(&operation.writes[0], MODBUS_WRITE_COIL, 10, 0, 0);
	assert_write(&operation.writes[1], MODBUS_WRITE_COIL, 11, 1, 0);
	assert_false(operation_divide(&operation));
	operation = begin(neighbours, set(1), none);
	assert_true(operation_divide(&operation));
	assert_write(&operation.writes[0], MODBUS_WRITE_COIL, 11, 0, 0);
	assert_write(&operation.writes[1], MODBUS_WRITE_COIL, 10, 1, 0);
	operation = begin(single, set(1), none);
	assert_false(operation_divide(&operation));
	operation = begin(current, set(1), none); /* half of a value is none */
	assert_false(operation_divide(&operation));
}

static void test_the_end_of_a_pulse_is_off(void **state)
{
	struct operation operation;

	(void)state;
	operation_end(&single.wire, UNIT, &operation);
	assert_one_write(operation, MODBUS_WRITE_COIL, 300, 0, 0);
	operation_end(&neighbours.wire, UNIT, &operation);
	assert_one_write(operation, MODBUS_WRITE_COILS, 10, 0, 0);
	operation_end(&apart.wire, UNIT, &operation);
	assert_int_equal(operation.count, 2);
	assert_false(operation_switches_on(&apart.wire, &operation.writes[0]) ||
		     operation_switches_on(&apart.wire, &operation.writes[1]));
}

static void test_what_takes_a_pulse(void **state)
{
	(void)state;
	assert_one_write(begin(single, pulse(1), none), MODBUS_WRITE_COIL, 300, 1, 0);
	assert_one_write(begin(neighbours, pulse(1), none), MODBUS_WRITE_COILS, 10, 1, 0);
	assert_true(operation_switches_on(&neighbours.wire, &begin(neighbours, pulse(2), none).writes[0]));
	assert_result(single, pulse(0), NEVER);
	assert_result(level, pulse(1), NEVER);
	assert_result(neighbours, pulse(3), LIMIT);
}

static void test_steps_go_from_the_last_value(void **state)
{
	(void)state;
	assert_one_write(begin(level, step(1), (struct map_sample){.value.i = 15}), MODBUS_WRITE_REGISTER, 5,
			 25, 0);
	assert_one_write(begin(level, step(-1), (struct map_sample){.value.i = -10}), MODBUS_WRITE_REGISTER,
			 5, (uint16_t)-20, 0);
	assert_one_write(begin(current, step(1), (struct map_sample){.value.f = 1.5f}),
			 MODBUS_WRITE_REGISTERS, 6, 0x4000, 0);
}

static void test_steps_stay_within_their_limits(void **state)
{
	struct object wide = level;
	const struct map_request higher = step(1), lower = step(-1);
	struct operation operation;

	(void)state;
	assert_int_equal(operation_begin(&level.point, &level.wire, NULL, 0, UNIT, &higher,
					 &(struct map_sample){.value.i = 16}, &operation),
			 LIMIT);
	assert_int_equal(operation_begin(&level.point, &level.wire, NULL, 0, UNIT, &lower,
					 &(struct map_sample){.value.i = -11}, &operation),
			 LIMIT);
	wide.point.max = wide.point.step = FLT_MAX;
	assert_result(wide, higher, LIMIT);
	assert_result(level, set(26), LIMIT); /* a set-point, too */
	assert_result(level, set(-21), LIMIT);
	assert_result(level, set(25), MAP_RESULT_NONE);
}

static void test_steps_need_a_good_value_and_a_configured_step(void **state)
{
	const uint8_t bad[] = {MAP_INVALID, MAP_OVERFLOW, MAP_NOT_TOPICAL, MAP_BLOCKED, MAP_SUBSTITUTED};
	const struct map_request higher = step(1);
	struct object stepless = level;
	struct operation operation;

	(void)state;
	for (size_t i = 0; i < sizeof(bad); i++)
		assert_int_equal(operation_begin(&level.point, &level.wire, NULL, 0, UNIT, &higher,
						 &(struct map_sample){.quality = bad[i]}, &operation),
				 NEVER);
	stepless.point.step = 0;
	assert_result(stepless, higher, NEVER);
	assert_result(stepless, set(26), LIMIT); /* its limits hold all the same */
	assert_result(stepless, set(25), MAP_RESULT_NONE);
	assert_result(single, higher, NEVER);
}

static void test_a_power_of_ten_is_that_of_the_device(void **state)
{
	const struct map_request wish = set(20);
	struct operation operation;

	(void)state;
	assert_int_equal(operation_begin(&level.point, &level.wire, NULL, 1, UNIT, &wish, &none, &operation),
			 MAP_RESULT_NONE);
	assert_one_write(operation, MODBUS_WRITE_REGISTER, 5, 2, 0);
	assert_int_equal(operation_begin(&level.point, &level.wire, NULL, CONVERT_NO_EXPONENT, UNIT, &wish,
					 &none, &operation),
			 MAP_RESULT_NO_SCALE);
	assert_int_equal(operation_begin(&level.point, &level.wire, NULL, -5, UNIT, &wish, &none, &operation),
			 LIMIT);
}

/* The register's other bits are the device's. */
static void test_bits_of_a_register_are_masked(void **state)
{
	struct object bit = {.wire = {.table = MODBUS_HOLDING_REGISTERS,
				      .type = MAP_SINGLE,
				      .width = 1,
				      .address = 9,
				      .bit = 3,
				      .flags = MODBUS_INVERTED},
			     .point = {.type = MAP_SINGLE}};
	struct object two = {.wire = {.table = MODBUS_HOLDING_REGISTERS,
				      .type = MAP_DOUBLE,
				      .width = 1,
				      .address = 9,
				      .bit = 4},
			     .point = {.type = MAP_DOUBLE}};
	struct object high = {.wire = {.table = MODBUS_HOLDING_REGISTERS,
				       .type = MAP_SCALED,
				       .format = MODBUS_FORMAT_UINT16,
				       .width = 1,
				       .address = 9,
				       .bit = 8,
				       .field = 8,
				       .scale = 1},
			      .point = {.type = MAP_SCALED, .min = 0, .max = 200}};

	(void)state;
	assert_one_write(begin(high, set(0x12), none), MODBUS_MASK_WRITE_REGISTER, 9, 0x00FF, 0x1200);
	assert_result(high, set(201), LIMIT);
	assert_one_write(begin(bit, set(1), none), MODBUS_MASK_WRITE_REGISTER, 9, 0xFFF7, 0);
	assert_one_write(begin(bit, set(0), none), MODBUS_MASK_WRITE_REGISTER, 9, 0xFFF7, 0x0008);
	assert_one_write(begin(two, set(2), none), MODBUS_MASK_WRITE_REGISTER, 9, 0xFFCF, 0x0020);
	assert_result(bit, pulse(1), NEVER);
}

/* A pulse of an inverted coil begins with 0 on the wire and ends with 1. */
static void test_a_pulse_of_an_inverted_coil(void **state)
{
	struct object inverted = single;
	struct operation operation;

	(void)state;
	inverted.wire.flags = MODBUS_INVERTED;
	operation = begin(inverted, pulse(1), none);
	assert_one_write(operation, MODBUS_WRITE_COIL, 300, 0, 0);
	assert_true(operation_switches_on(&inverted.wire, &operation.writes[0]));
	operation_end(&inverted.wire, UNIT, &operation);
	assert_int_equal(operation.writes[0].values[0], 1);
	assert_false(operation_switches_on(&inverted.wire, &operation.writes[0]));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_bits_of_a_register_are_masked),
	    cmocka_unit_test(test_a_pulse_of_an_inverted_coil),
	    cmocka_unit_test(test_one_write_of_one_object),
	    cmocka_unit_test(test_of_coils_that_lie_apart_off_goes_first),
	    cmocka_unit_test(test_two_neighbours_are_divided_and_off_goes_first),
	    cmocka_unit_test(test_the_end_of_a_pulse_is_off),
	    cmocka_unit_test(test_what_takes_a_pulse),
	    cmocka_unit_test(test_steps_go_from_the_last_value),
	    cmocka_unit_test(test_steps_stay_within_their_limits),
	    cmocka_unit_test(test_steps_need_a_good_value_and_a_configured_step),
	    cmocka_unit_test(test_a_power_of_ten_is_that_of_the_device),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
