/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "modules/convert.h"

static struct map_point point_of(enum map_type type, uint8_t flags)
{
	return (struct map_point){.type = (uint8_t)type, .flags = flags, .scale = 1};
}

static struct map_sample sample_of(struct map_point point, uint16_t first, uint16_t second)
{
	struct map_sample sample = {.quality = 0xFF, .detail = 0xFF};

	convert_to_sample(&point, (const uint16_t[]){first, second}, &sample);
	return sample;
}

static void assert_integer(struct map_point point, uint16_t first, uint16_t second, int32_t value,
			   uint8_t quality)
{
	struct map_sample sample = sample_of(point, first, second);

	assert_int_equal(sample.value.i, value);
	assert_int_equal(sample.quality, quality);
}

static void assert_raw(struct map_point point, union map_value value, uint16_t first, uint16_t second)
{
	uint16_t raw[2] = {0, 0};

	assert_true(convert_to_raw(&point, value, 0, raw));
	assert_int_equal(raw[0], first);
	assert_int_equal(raw[1], second);
}

static void assert_out_of_range(struct map_point point, union map_value value)
{
	uint16_t raw[2];

	assert_false(convert_to_raw(&point, value, 0, raw));
}

static union map_value integer(int32_t i)
{
	return (union map_value){.i = i};
}

static union map_value number(float f)
{
	return (union map_value){.f = f};
}

static void single_point(void **state)
{
	(void)state;
	struct map_point point = point_of(MAP_SINGLE, 0);

	assert_integer(point, 0, 0, 0, MAP_GOOD);
	assert_integer(point, 1, 0, 1, MAP_GOOD);
	assert_raw(point, integer(1), 1, 0);
	assert_raw(point, integer(0), 0, 0);
	assert_out_of_range(point, integer(2));
}

/* 0 intermediate, 1 off, 2 on, 3 indeterminate. */
static void double_point(void **state)
{
	(void)state;
	struct map_point point = point_of(MAP_DOUBLE, 0),
			 swapped = point_of(MAP_DOUBLE, MAP_POINT_BITS_SWAPPED);

	assert_integer(point, 0, 0, 0, MAP_GOOD);
	assert_integer(point, 1, 0, 1, MAP_GOOD);
	assert_integer(point, 0, 1, 2, MAP_GOOD);
	assert_integer(point, 1, 1, 3, MAP_GOOD);
	assert_integer(swapped, 1, 0, 2, MAP_GOOD);
	assert_raw(point, integer(1), 1, 0);
	assert_raw(point, integer(2), 0, 1);
	assert_raw(swapped, integer(2), 1, 0);
	assert_out_of_range(point, integer(0));
	assert_out_of_range(point, integer(3));
}

static void step_position(void **state)
{
	(void)state;
	struct map_point point = point_of(MAP_STEP, 0), swapped = point_of(MAP_STEP, MAP_POINT_BYTES_SWAPPED);
	uint16_t raw[2];

	assert_integer(point, 0x003F, 0, 63, MAP_GOOD);
	assert_integer(point, 0x0040, 0, -64, MAP_GOOD);
	assert_integer(point, 0xAB7F, 0, -1, MAP_GOOD); /* the high octet is nothing */
	assert_integer(swapped, 0x0500, 0, 5, MAP_GOOD);
	assert_int_equal(sample_of(point, 0x0085, 0).value.i, 5);
	assert_int_equal(sample_of(point, 0x0085, 0).detail, 1);
	assert_int_equal(sample_of(point, 0x0005, 0).detail, 0);
	assert_raw(point, integer(-64), 0x40, 0);
	assert_raw(point, integer(63), 0x3F, 0);
	assert_raw(swapped, integer(5), 0x0500, 0);
	assert_true(convert_to_raw(&point, integer(-1), 1, raw));
	assert_int_equal(raw[0], 0xFF);
	assert_out_of_range(point, integer(64));
	assert_out_of_range(point, integer(-65));
}

static void bitstring(void **state)
{
	(void)state;
	assert_int_equal(sample_of(point_of(MAP_BITSTRING, 0), 0x1234, 0xABCD).value.u, 0x1234ABCD);
	assert_int_equal(sample_of(point_of(MAP_BITSTRING, MAP_POINT_WORDS_SWAPPED), 0x1234, 0xABCD).value.u,
			 0xABCD1234);
	assert_int_equal(sample_of(point_of(MAP_BITSTRING, MAP_POINT_BYTES_SWAPPED), 0x1234, 0xABCD).value.u,
			 0x3412CDAB);
	assert_raw(point_of(MAP_BITSTRING, 0), (union map_value){.u = 0xFFFF0001}, 0xFFFF, 1);
	assert_raw(point_of(MAP_BITSTRING, MAP_POINT_WORDS_SWAPPED | MAP_POINT_BYTES_SWAPPED),
		   (union map_value){.u = 0x12345678}, 0x7856, 0x3412);
}

static void sixteen_bits(enum map_type type)
{
	struct map_point is_signed = point_of(type, MAP_POINT_SIGNED), is_unsigned = point_of(type, 0);

	assert_integer(is_signed, 0x8000, 0, -32768, MAP_GOOD);
	assert_integer(is_signed, 0xFFFF, 0, -1, MAP_GOOD);
	assert_integer(is_signed, 0x7FFF, 0, 32767, MAP_GOOD);
	assert_integer(is_unsigned, 0x7FFF, 0, 32767, MAP_GOOD);
	assert_integer(is_unsigned, 0x8000, 0, 32767, MAP_OVERFLOW);
	assert_integer(is_unsigned, 0xFFFF, 0, 32767, MAP_OVERFLOW);
	assert_integer(point_of(type, MAP_POINT_SIGNED | MAP_POINT_BYTES_SWAPPED), 0x0100, 0, 1, MAP_GOOD);
	assert_raw(is_signed, integer(-1), 0xFFFF, 0);
	assert_raw(is_signed, integer(-32768), 0x8000, 0);
	assert_raw(is_unsigned, integer(32767), 0x7FFF, 0);
	assert_raw(point_of(type, MAP_POINT_SIGNED | MAP_POINT_BYTES_SWAPPED), integer(255), 0xFF00, 0);
	assert_out_of_range(is_unsigned, integer(-1));
	assert_out_of_range(is_signed, integer(32768));
	assert_out_of_range(is_signed, integer(-32769));
}

static void scaled_and_normalized(void **state)
{
	(void)state;
	sixteen_bits(MAP_SCALED);
	sixteen_bits(MAP_NORMALIZED);
}

static void scale_and_offset(void **state)
{
	(void)state;
	struct map_point tenth = point_of(MAP_SCALED, 0), coarse = point_of(MAP_SCALED, MAP_POINT_SIGNED);

	tenth.scale = 0.5F;
	tenth.offset = -100;
	assert_integer(tenth, 60000, 0, 29900, MAP_GOOD); /* beyond 32767 before it was scaled */
	assert_integer(tenth, 0, 0, -100, MAP_GOOD);
	assert_raw(tenth, integer(29900), 60000, 0);
	assert_raw(tenth, integer(-100), 0, 0);
	assert_out_of_range(tenth, integer(-101));
	coarse.scale = 10;
	assert_integer(coarse, 0x7FFF, 0, 32767, MAP_OVERFLOW);
	assert_integer(coarse, 0x8000, 0, -32768, MAP_OVERFLOW);
	assert_raw(coarse, integer(1004), 100, 0); /* the nearest the register can hold */
	coarse.scale = 0;
	assert_out_of_range(coarse, integer(1));
}

static void assert_float(struct map_point point, uint16_t first, uint16_t second, float value,
			 uint8_t quality)
{
	struct map_sample sample = sample_of(point, first, second);

	assert_memory_equal(&sample.value.f, &value, sizeof(value));
	assert_int_equal(sample.quality, quality);
}

static void short_float(void **state)
{
	(void)state;
	struct map_point point = point_of(MAP_FLOAT, 0);

	/* 123.456 is 0x42F6E979 */
	assert_float(point, 0x42F6, 0xE979, 123.456F, MAP_GOOD);
	assert_float(point_of(MAP_FLOAT, MAP_POINT_WORDS_SWAPPED), 0xE979, 0x42F6, 123.456F, MAP_GOOD);
	assert_float(point_of(MAP_FLOAT, MAP_POINT_BYTES_SWAPPED), 0xF642, 0x79E9, 123.456F, MAP_GOOD);
	assert_float(point, 0x7FC0, 0, 0, MAP_INVALID); /* NaN */
	assert_float(point, 0xFF80, 0, 0, MAP_INVALID); /* -infinity */
	assert_raw(point, number(123.456F), 0x42F6, 0xE979);
	assert_raw(point_of(MAP_FLOAT, MAP_POINT_WORDS_SWAPPED | MAP_POINT_BYTES_SWAPPED), number(123.456F),
		   0x79E9, 0xF642);
	assert_out_of_range(point, number(NAN));
	assert_out_of_range(point, number(INFINITY));
	point.scale = 2;
	point.offset = 1;
	assert_float(point, 0x3F80, 0, 3, MAP_GOOD);
	assert_raw(point, number(3), 0x3F80, 0);
	assert_float(point, 0xFF7F, 0xFFFF, -FLT_MAX, MAP_OVERFLOW);
	point.scale = 0.5F;
	assert_out_of_range(point, number(FLT_MAX));
}

static void counter(void **state)
{
	(void)state;
	struct map_point point = point_of(MAP_COUNTER, 0);

	assert_integer(point, 0x7FFF, 0xFFFF, INT32_MAX, MAP_GOOD);
	assert_integer(point, 0x8000, 0x0000, INT32_MIN, MAP_GOOD);
	assert_integer(point_of(MAP_COUNTER, MAP_POINT_WORDS_SWAPPED), 2, 1, 0x10002, MAP_GOOD);
	assert_integer(point_of(MAP_COUNTER, MAP_POINT_BYTES_SWAPPED), 0x0100, 0x0200, 0x10002, MAP_GOOD);
	assert_raw(point, integer(-2), 0xFFFF, 0xFFFE);
	assert_raw(point, integer(INT32_MAX), 0x7FFF, 0xFFFF);
	point.scale = 1000;
	assert_integer(point, 0x7FFF, 0xFFFF, INT32_MAX, MAP_OVERFLOW);
	assert_integer(point, 0, 7, 7000, MAP_GOOD);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(single_point),          cmocka_unit_test(double_point),
	    cmocka_unit_test(step_position),         cmocka_unit_test(bitstring),
	    cmocka_unit_test(scaled_and_normalized), cmocka_unit_test(scale_and_offset),
	    cmocka_unit_test(short_float),           cmocka_unit_test(counter),
	};
	return cmocka_run_group_tests_name("convert", tests, NULL, NULL);
}
