/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "modbus/convert.h"

static struct modbus_point of_format(enum map_type type, enum modbus_format format, uint16_t flags)
{
	return (struct modbus_point){.table = MODBUS_HOLDING_REGISTERS,
				     .type = type & 31u,
				     .format = format & 31u,
				     .width = modbus_formats[format].registers & 7u,
				     .flags = flags & 255u,
				     .scale = 1};
}

/* Of the format that a file without one gives it. */
static struct modbus_point point_of(enum map_type type, uint16_t flags)
{
	static const enum modbus_format formats[] = {
	    [MAP_SINGLE] = MODBUS_FORMAT_BIT,       [MAP_DOUBLE] = MODBUS_FORMAT_BIT,
	    [MAP_STEP] = MODBUS_FORMAT_VTI,         [MAP_BITSTRING] = MODBUS_FORMAT_UINT32,
	    [MAP_NORMALIZED] = MODBUS_FORMAT_INT16, [MAP_SCALED] = MODBUS_FORMAT_INT16,
	    [MAP_FLOAT] = MODBUS_FORMAT_FLOAT32,    [MAP_COUNTER] = MODBUS_FORMAT_INT32,
	};
	struct modbus_point point = of_format(type, formats[type], flags);

	if (formats[type] == MODBUS_FORMAT_BIT)
		point.table = MODBUS_COILS;
	return point;
}

static struct map_sample sample_of(struct modbus_point point, uint16_t first, uint16_t second)
{
	struct map_sample sample = {.quality = 0xFF, .detail = 0xFF};

	convert_to_sample(&point, NULL, 0, (const uint16_t[CONVERT_WIDTH_MAX]){first, second}, &sample);
	return sample;
}

static void assert_integer(struct modbus_point point, uint16_t first, uint16_t second, int32_t value,
			   uint8_t quality)
{
	struct map_sample sample = sample_of(point, first, second);

	assert_int_equal(sample.value.i, value);
	assert_int_equal(sample.quality, quality);
}

static void assert_raw(struct modbus_point point, union map_value value, uint16_t first, uint16_t second)
{
	uint16_t raw[CONVERT_WIDTH_MAX] = {0};

	assert_true(convert_to_raw(&point, NULL, 0, value, 0, raw));
	assert_int_equal(raw[0], first);
	assert_int_equal(raw[1], second);
}

static void assert_out_of_range(struct modbus_point point, union map_value value)
{
	uint16_t raw[CONVERT_WIDTH_MAX];

	assert_false(convert_to_raw(&point, NULL, 0, value, 0, raw));
}

static union map_value integer(int32_t i)
{
	return (union map_value){.i = i};
}

static union map_value number(float f)
{
	return (union map_value){.f = f};
}

static void test_single_point(void **state)
{
	(void)state;
	struct modbus_point point = point_of(MAP_SINGLE, 0);

	assert_integer(point, 0, 0, 0, MAP_GOOD);
	assert_integer(point, 1, 0, 1, MAP_GOOD);
	assert_raw(point, integer(1), 1, 0);
	assert_raw(point, integer(0), 0, 0);
	assert_out_of_range(point, integer(2));
}

/* 0 intermediate, 1 off, 2 on, 3 indeterminate. */
static void test_double_point(void **state)
{
	(void)state;
	struct modbus_point point = point_of(MAP_DOUBLE, 0),
			    swapped = point_of(MAP_DOUBLE, MODBUS_BITS_SWAPPED);

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

static void test_step_position(void **state)
{
	(void)state;
	struct modbus_point point = point_of(MAP_STEP, 0), swapped = point_of(MAP_STEP, MODBUS_BYTES_SWAPPED);
	uint16_t raw[CONVERT_WIDTH_MAX];

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
	assert_true(convert_to_raw(&point, NULL, 0, integer(-1), 1, raw));
	assert_int_equal(raw[0], 0xFF);
	assert_out_of_range(point, integer(64));
	assert_out_of_range(point, integer(-65));
}

static void test_bitstring(void **state)
{
	(void)state;
	assert_int_equal(sample_of(point_of(MAP_BITSTRING, 0), 0x1234, 0xABCD).value.u, 0x1234ABCD);
	assert_int_equal(sample_of(point_of(MAP_BITSTRING, MODBUS_WORDS_SWAPPED), 0x1234, 0xABCD).value.u,
			 0xABCD1234);
	assert_int_equal(sample_of(point_of(MAP_BITSTRING, MODBUS_BYTES_SWAPPED), 0x1234, 0xABCD).value.u,
			 0x3412CDAB);
	assert_raw(point_of(MAP_BITSTRING, 0), (union map_value){.u = 0xFFFF0001}, 0xFFFF, 1);
	assert_raw(point_of(MAP_BITSTRING, MODBUS_WORDS_SWAPPED | MODBUS_BYTES_SWAPPED),
		   (union map_value){.u = 0x12345678}, 0x7856, 0x3412);
}

static void sixteen_bits(enum map_type type)
{
	struct modbus_point is_signed = point_of(type, 0),
			    is_unsigned = of_format(type, MODBUS_FORMAT_UINT16, 0);

	assert_integer(is_signed, 0x8000, 0, -32768, MAP_GOOD);
	assert_integer(is_signed, 0xFFFF, 0, -1, MAP_GOOD);
	assert_integer(is_signed, 0x7FFF, 0, 32767, MAP_GOOD);
	assert_integer(is_unsigned, 0x7FFF, 0, 32767, MAP_GOOD);
	assert_integer(is_unsigned, 0x8000, 0, 32767, MAP_OVERFLOW);
	assert_integer(is_unsigned, 0xFFFF, 0, 32767, MAP_OVERFLOW);
	assert_integer(point_of(type, MODBUS_BYTES_SWAPPED), 0x0100, 0, 1, MAP_GOOD);
	assert_raw(is_signed, integer(-1), 0xFFFF, 0);
	assert_raw(is_signed, integer(-32768), 0x8000, 0);
	assert_raw(is_unsigned, integer(32767), 0x7FFF, 0);
	assert_raw(point_of(type, MODBUS_BYTES_SWAPPED), integer(255), 0xFF00, 0);
	assert_out_of_range(is_unsigned, integer(-1));
	assert_out_of_range(is_signed, integer(32768));
	assert_out_of_range(is_signed, integer(-32769));
}

static void test_scaled_and_normalized(void **state)
{
	(void)state;
	sixteen_bits(MAP_SCALED);
	sixteen_bits(MAP_NORMALIZED);
}

static void test_scale_and_offset(void **state)
{
	(void)state;
	struct modbus_point tenth = of_format(MAP_SCALED, MODBUS_FORMAT_UINT16, 0),
			    coarse = point_of(MAP_SCALED, 0);

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

static void assert_float(struct modbus_point point, uint16_t first, uint16_t second, float value,
			 uint8_t quality)
{
	struct map_sample sample = sample_of(point, first, second);

	assert_memory_equal(&sample.value.f, &value, sizeof(value));
	assert_int_equal(sample.quality, quality);
}

static void test_short_float(void **state)
{
	(void)state;
	struct modbus_point point = point_of(MAP_FLOAT, 0);

	/* 123.456 is 0x42F6E979 */
	assert_float(point, 0x42F6, 0xE979, 123.456F, MAP_GOOD);
	assert_float(point_of(MAP_FLOAT, MODBUS_WORDS_SWAPPED), 0xE979, 0x42F6, 123.456F, MAP_GOOD);
	assert_float(point_of(MAP_FLOAT, MODBUS_BYTES_SWAPPED), 0xF642, 0x79E9, 123.456F, MAP_GOOD);
	assert_float(point, 0x7FC0, 0, 0, MAP_INVALID); /* NaN */
	assert_float(point, 0xFF80, 0, 0, MAP_INVALID); /* -infinity */
	assert_raw(point, number(123.456F), 0x42F6, 0xE979);
	assert_raw(point_of(MAP_FLOAT, MODBUS_WORDS_SWAPPED | MODBUS_BYTES_SWAPPED), number(123.456F), 0x79E9,
		   0xF642);
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

static void test_counter(void **state)
{
	(void)state;
	struct modbus_point point = point_of(MAP_COUNTER, 0);

	assert_integer(point, 0x7FFF, 0xFFFF, INT32_MAX, MAP_GOOD);
	assert_integer(point, 0x8000, 0x0000, INT32_MIN, MAP_GOOD);
	assert_integer(point_of(MAP_COUNTER, MODBUS_WORDS_SWAPPED), 2, 1, 0x10002, MAP_GOOD);
	assert_integer(point_of(MAP_COUNTER, MODBUS_BYTES_SWAPPED), 0x0100, 0x0200, 0x10002, MAP_GOOD);
	assert_raw(point, integer(-2), 0xFFFF, 0xFFFE);
	assert_raw(point, integer(INT32_MAX), 0x7FFF, 0xFFFF);
	assert_integer(of_format(MAP_COUNTER, MODBUS_FORMAT_UINT16, 0), 0xFFFF, 0, 0xFFFF, MAP_GOOD);
	assert_integer(of_format(MAP_COUNTER, MODBUS_FORMAT_UINT32, 0), 0xFFFF, 0xFFFF, -1, MAP_GOOD);
}

static struct map_sample sample_of_four(struct modbus_point point, const struct modbus_knot *knots,
					uint16_t a, uint16_t b, uint16_t c, uint16_t d)
{
	struct map_sample sample = {.quality = 0xFF, .detail = 0xFF};

	convert_to_sample(&point, knots, 0, (const uint16_t[CONVERT_WIDTH_MAX]){a, b, c, d}, &sample);
	return sample;
}

static void assert_number(struct map_sample sample, float value, uint8_t quality)
{
	assert_memory_equal(&sample.value.f, &value, sizeof(value));
	assert_int_equal(sample.quality, quality);
}

static void assert_four(struct modbus_point point, union map_value value, uint16_t a, uint16_t b, uint16_t c,
			uint16_t d)
{
	uint16_t raw[CONVERT_WIDTH_MAX] = {0};

	assert_true(convert_to_raw(&point, NULL, 0, value, 0, raw));
	assert_memory_equal(raw, ((const uint16_t[CONVERT_WIDTH_MAX]){a, b, c, d}), sizeof(raw));
}

static void test_inverted(void **state)
{
	(void)state;
	struct modbus_point point = point_of(MAP_SINGLE, MODBUS_INVERTED),
			    both = point_of(MAP_DOUBLE, MODBUS_INVERTED);

	assert_integer(point, 0, 0, 1, MAP_GOOD);
	assert_integer(point, 1, 0, 0, MAP_GOOD);
	assert_raw(point, integer(1), 0, 0);
	assert_raw(point, integer(0), 1, 0);
	assert_out_of_range(point, integer(2));
	assert_integer(both, 1, 1, 0, MAP_GOOD);
	assert_integer(both, 0, 1, 1, MAP_GOOD);
	assert_integer(both, 0, 0, 3, MAP_GOOD);
	assert_raw(both, integer(1), 0, 1);
	assert_raw(both, integer(2), 1, 0);
}

static void test_bits_of_a_register(void **state)
{
	(void)state;
	struct modbus_point point = of_format(MAP_SINGLE, MODBUS_FORMAT_BIT, 0),
			    two = of_format(MAP_DOUBLE, MODBUS_FORMAT_BIT, 0);

	point.bit = 15;
	assert_integer(point, 0x8000, 0, 1, MAP_GOOD);
	assert_integer(point, 0x7FFF, 0xFFFF, 0, MAP_GOOD);
	assert_raw(point, integer(1), 0x8000, 0);
	assert_raw(point, integer(0), 0, 0);
	assert_int_equal(convert_register_mask(&point), 0x8000);
	point.flags = MODBUS_BYTES_SWAPPED | MODBUS_INVERTED;
	assert_integer(point, 0x0080, 0, 0, MAP_GOOD);
	assert_raw(point, integer(0), 0x0080, 0);
	assert_int_equal(convert_register_mask(&point), 0x0080);
	two.bit = 4;
	assert_integer(two, 0x0010, 0, 1, MAP_GOOD);
	assert_integer(two, 0x0020, 0, 2, MAP_GOOD);
	assert_integer(two, 0xFFCF, 0, 0, MAP_GOOD);
	assert_raw(two, integer(2), 0x0020, 0);
	assert_int_equal(convert_register_mask(&two), 0x0030);
}

static void test_integers_of_32_bits(void **state)
{
	(void)state;
	struct modbus_point word = of_format(MAP_FLOAT, MODBUS_FORMAT_INT32, 0),
			    natural = of_format(MAP_FLOAT, MODBUS_FORMAT_UINT32, MODBUS_WORDS_SWAPPED),
			    narrow = of_format(MAP_SCALED, MODBUS_FORMAT_INT32, 0);

	assert_float(word, 0xFFFF, 0xFFFE, -2, MAP_GOOD);
	assert_float(word, 0x0001, 0x0000, 65536, MAP_GOOD);
	assert_float(word, 0x0100, 0x0001, 16777216, MAP_GOOD); /* 2^24 + 1: a short float has 24 bits */
	assert_raw(word, number(-2), 0xFFFF, 0xFFFE);
	assert_out_of_range(word, number(0x1p31F));
	assert_raw(word, number(-0x1p31F), 0x8000, 0);
	assert_float(natural, 0xFFFE, 0xFFFF, 0x1p32F, MAP_GOOD); /* 2^32 - 2, rounded */
	assert_raw(natural, number(65536), 0, 1);
	assert_out_of_range(natural, number(-1));
	assert_out_of_range(natural, number(0x1p32F));
	assert_integer(narrow, 0, 0x8000, 32767, MAP_OVERFLOW);
	assert_integer(narrow, 0xFFFF, 0, -32768, MAP_OVERFLOW);
	narrow.scale = 0.001;
	assert_integer(narrow, 0x0001, 0xE240, 123, MAP_GOOD); /* 123 456 */
	assert_raw(narrow, integer(123), 0x0001, 0xE078);
}

static void test_numbers_of_64_bits(void **state)
{
	(void)state;
	struct modbus_point whole = of_format(MAP_FLOAT, MODBUS_FORMAT_INT64, 0),
			    natural = of_format(MAP_FLOAT, MODBUS_FORMAT_UINT64, MODBUS_WORDS_SWAPPED),
			    real = of_format(MAP_FLOAT, MODBUS_FORMAT_FLOAT64, 0),
			    total = of_format(MAP_COUNTER, MODBUS_FORMAT_UINT64, 0);

	assert_number(sample_of_four(whole, NULL, 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFB), -5, MAP_GOOD);
	assert_four(whole, number(-5), 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFB);
	assert_four(whole, number(-0x1p63F), 0x8000, 0, 0, 0);
	assert_out_of_range(whole, number(0x1p63F));
	assert_number(sample_of_four(natural, NULL, 5, 0, 0, 0x8000), 0x1p63F, MAP_GOOD);
	assert_four(natural, number(0x1p63F), 0, 0, 0, 0x8000);
	assert_out_of_range(natural, number(0x1p64F));
	/* 123.456 is 0x405EDD2F1A9FBE77 */
	assert_number(sample_of_four(real, NULL, 0x405E, 0xDD2F, 0x1A9F, 0xBE77), 123.456F, MAP_GOOD);
	assert_four(real, number(0.5F), 0x3FE0, 0, 0, 0);
	assert_number(sample_of_four(real, NULL, 0x7FE0, 0, 0, 0), FLT_MAX, MAP_OVERFLOW); /* 2^1023 */
	assert_number(sample_of_four(real, NULL, 0xFFE0, 0, 0, 0), -FLT_MAX, MAP_OVERFLOW);
	assert_number(sample_of_four(real, NULL, 0x7FF8, 0, 0, 0), 0, MAP_INVALID);
	assert_int_equal(sample_of_four(total, NULL, 0xFFFF, 0xFFFF, 0x1234, 0x5679).value.u, 0x12345679);
	total.scale = 0.001;
	assert_int_equal(sample_of_four(total, NULL, 0, 1, 0, 0).value.u, 4294967);
	total.format = MODBUS_FORMAT_FLOAT64;
	assert_int_equal(sample_of_four(total, NULL, 0x7FE0, 0, 0, 0).quality, MAP_INVALID);
}

static void test_unimplemented(void **state)
{
	(void)state;
	const uint16_t flag = MODBUS_UNIMPLEMENTED;

	assert_float(of_format(MAP_FLOAT, MODBUS_FORMAT_INT16, flag), 0x8000, 0, 0, MAP_INVALID);
	assert_float(of_format(MAP_FLOAT, MODBUS_FORMAT_INT16, flag), 0xFFFF, 0, -1, MAP_GOOD);
	assert_float(of_format(MAP_FLOAT, MODBUS_FORMAT_UINT16, flag), 0xFFFF, 0, 0, MAP_INVALID);
	assert_float(of_format(MAP_FLOAT, MODBUS_FORMAT_UINT32, flag), 0xFFFF, 0xFFFF, 0, MAP_INVALID);
	assert_float(of_format(MAP_FLOAT, MODBUS_FORMAT_UINT16, 0), 0xFFFF, 0, 65535, MAP_GOOD);
	assert_number(sample_of_four(of_format(MAP_FLOAT, MODBUS_FORMAT_INT64, flag), NULL, 0x8000, 0, 0, 0),
		      0, MAP_INVALID);
}

static struct modbus_point field(enum map_type type, enum modbus_format format, unsigned first, unsigned bits)
{
	struct modbus_point point = of_format(type, format, 0);

	point.bit = first & 15u;
	point.field = bits & 15u;
	return point;
}

static void test_fields_of_a_register(void **state)
{
	(void)state;
	struct modbus_point high = field(MAP_SCALED, MODBUS_FORMAT_UINT16, 8, 8),
			    low = field(MAP_SCALED, MODBUS_FORMAT_INT16, 0, 8),
			    middle = field(MAP_FLOAT, MODBUS_FORMAT_UINT16, 4, 4),
			    pattern = field(MAP_BITSTRING, MODBUS_FORMAT_UINT16, 4, 4),
			    seconds = field(MAP_SCALED, MODBUS_FORMAT_BCD16, 0, 7);

	assert_integer(high, 0xABCD, 0, 0xAB, MAP_GOOD);
	assert_integer(low, 0xABCD, 0, 0xCD - 256, MAP_GOOD);
	assert_float(middle, 0xABCD, 0, 0xC, MAP_GOOD);
	assert_integer(pattern, 0xABCD, 0, 0xC, MAP_GOOD);
	assert_integer(seconds, 0xFFD9, 0, 59, MAP_GOOD); /* 0x59 */
	assert_raw(high, integer(0xAB), 0xAB00, 0);
	assert_raw(low, integer(-1), 0x00FF, 0);
	assert_raw(low, integer(-128), 0x0080, 0);
	assert_raw(middle, number(15), 0x00F0, 0);
	assert_raw(pattern, integer(9), 0x0090, 0);
	assert_raw(seconds, integer(59), 0x0059, 0);
	assert_out_of_range(high, integer(256));
	assert_out_of_range(high, integer(-1));
	assert_out_of_range(low, integer(128));
	assert_out_of_range(low, integer(-129));
	assert_out_of_range(middle, number(16));
	assert_out_of_range(pattern, integer(16));
	assert_out_of_range(seconds, integer(80)); /* has no room for its bit 7 */
	assert_int_equal(convert_register_mask(&high), 0xFF00);
	assert_int_equal(convert_register_mask(&middle), 0x00F0);
	high.flags = MODBUS_BYTES_SWAPPED;
	assert_integer(high, 0xABCD, 0, 0xCD, MAP_GOOD);
	assert_raw(high, integer(0xCD), 0x00CD, 0);
	assert_int_equal(convert_register_mask(&high), 0x00FF);
	low.flags = MODBUS_UNIMPLEMENTED;
	assert_integer(low, 0xAB80, 0, 0, MAP_INVALID);
	assert_integer(low, 0x8000, 0, 0, MAP_GOOD);
}

static void test_numbers_of_48_bits(void **state)
{
	(void)state;
	struct modbus_point whole = of_format(MAP_FLOAT, MODBUS_FORMAT_INT48, 0),
			    natural = of_format(MAP_FLOAT, MODBUS_FORMAT_UINT48, MODBUS_WORDS_SWAPPED),
			    total = of_format(MAP_COUNTER, MODBUS_FORMAT_UINT48, 0);

	assert_number(sample_of_four(whole, NULL, 0xFFFF, 0xFFFF, 0xFFFB, 0), -5, MAP_GOOD);
	assert_number(sample_of_four(whole, NULL, 1, 0, 0, 0xFFFF), 0x1p32F, MAP_GOOD);
	assert_four(whole, number(-5), 0xFFFF, 0xFFFF, 0xFFFB, 0);
	assert_four(whole, number(-0x1p47F), 0x8000, 0, 0, 0);
	assert_out_of_range(whole, number(0x1p47F));
	assert_number(sample_of_four(natural, NULL, 5, 0, 0x8000, 0), 0x1p47F, MAP_GOOD);
	assert_four(natural, number(0x1p47F), 0, 0, 0x8000, 0);
	assert_out_of_range(natural, number(0x1p48F));
	assert_out_of_range(natural, number(-1));
	assert_int_equal(sample_of_four(total, NULL, 0xFFFF, 0x1234, 0x5679, 0).value.u, 0x12345679);
	total.scale = 0.001;
	assert_int_equal(sample_of_four(total, NULL, 1, 0, 0, 0).value.u, 4294967);
}

/* Decimal digits; what is none makes no number. */
static void test_bcd(void **state)
{
	(void)state;
	struct modbus_point one = of_format(MAP_SCALED, MODBUS_FORMAT_BCD16, 0),
			    two = of_format(MAP_FLOAT, MODBUS_FORMAT_BCD32, MODBUS_WORDS_SWAPPED),
			    four = of_format(MAP_COUNTER, MODBUS_FORMAT_BCD64, 0);

	assert_integer(one, 0x1234, 0, 1234, MAP_GOOD);
	assert_integer(one, 0x9999, 0, 9999, MAP_GOOD);
	assert_integer(one, 0x123A, 0, 0, MAP_INVALID);
	assert_integer(one, 0xFFFF, 0, 0, MAP_INVALID);
	assert_raw(one, integer(1234), 0x1234, 0);
	assert_raw(one, integer(9999), 0x9999, 0);
	assert_out_of_range(one, integer(10000));
	assert_out_of_range(one, integer(-1));
	assert_float(two, 0x5678, 0x0012, 125678, MAP_GOOD);
	assert_raw(two, number(125678), 0x5678, 0x0012);
	two.scale = 0.1;
	assert_float(two, 0x5678, 0x0012, 12567.8F, MAP_GOOD);
	/* 2^32 + 1, which the reading has modulo 2^32; beyond 2^53 to the last digit */
	assert_int_equal(sample_of_four(four, NULL, 0, 0x0042, 0x9496, 0x7297).value.u, 1);
	assert_int_equal(sample_of_four(four, NULL, 0x9999, 0x9999, 0x9999, 0x9999).value.u,
			 (uint32_t)9999999999999999ull);
	assert_int_equal(sample_of_four(four, NULL, 0xA000, 0, 0, 0).quality, MAP_INVALID);
	assert_four(four, integer(INT32_MAX), 0, 0x0021, 0x4748, 0x3647);
}

/* Each register is a digit to the base of 10 000. */
static void test_mod10(void **state)
{
	(void)state;
	struct modbus_point two = of_format(MAP_FLOAT, MODBUS_FORMAT_MOD10_32, 0),
			    three = of_format(MAP_FLOAT, MODBUS_FORMAT_MOD10_48, MODBUS_WORDS_SWAPPED),
			    four = of_format(MAP_COUNTER, MODBUS_FORMAT_MOD10_64, 0);

	assert_float(two, 12, 3456, 123456, MAP_GOOD);
	assert_float(two, (uint16_t)-12, (uint16_t)-3456, -123456, MAP_GOOD);
	assert_float(two, 10000, 0, 0, MAP_INVALID);
	assert_float(two, 0, 0x8000, 0, MAP_INVALID);
	assert_float(two, 0, (uint16_t)-10000, 0, MAP_INVALID);
	assert_raw(two, number(123456), 12, 3456);
	assert_raw(two, number(-123456), (uint16_t)-12, (uint16_t)-3456);
	assert_out_of_range(two, number(1e8F));
	assert_out_of_range(two, number(-1e8F));
	assert_number(sample_of_four(three, NULL, 0, 2, 1, 0), 100020000.0F, MAP_GOOD);
	assert_four(three, number(100000), 0, 10, 0, 0);
	assert_out_of_range(three, number(1.1e12F));
	assert_int_equal(sample_of_four(four, NULL, 9999, 9999, 9999, 9999).value.u,
			 (uint32_t)9999999999999999ull);
	four.type = MAP_FLOAT;
	assert_out_of_range(four, number(1e16F));
	assert_out_of_range(four, number(-1e16F));
}

static void test_fixed_point(void **state)
{
	(void)state;
	struct modbus_point point = of_format(MAP_FLOAT, MODBUS_FORMAT_FIXED24_8, 0);

	assert_float(point, 0x0001, 0x2380, 291.5F, MAP_GOOD);
	assert_float(point, 0xFFFF, 0xFF40, -0.75F, MAP_GOOD);
	assert_raw(point, number(291.5F), 0x0001, 0x2380);
	assert_raw(point, number(-0.75F), 0xFFFF, 0xFF40);
	assert_raw(point, number(-0x1p23F), 0x8000, 0);
	assert_out_of_range(point, number(0x1p23F));
	point.scale = 2;
	assert_float(point, 0x0001, 0x2380, 583, MAP_GOOD);
	assert_raw(point, number(583), 0x0001, 0x2380);
}

static void test_scaling_table(void **state)
{
	(void)state;
	const struct modbus_knot knots[] = {{0, 0}, {100, -10}, {1000, 0}, {2000, 50}};
	struct modbus_point point = of_format(MAP_FLOAT, MODBUS_FORMAT_UINT16, 0);
	uint16_t raw[CONVERT_WIDTH_MAX];

	point.first_knot = 1;
	point.knot_count = 3;
	assert_number(sample_of_four(point, knots, 100, 0, 0, 0), -10, MAP_GOOD);
	assert_number(sample_of_four(point, knots, 550, 0, 0, 0), -5, MAP_GOOD);
	assert_number(sample_of_four(point, knots, 1000, 0, 0, 0), 0, MAP_GOOD);
	assert_number(sample_of_four(point, knots, 1500, 0, 0, 0), 25, MAP_GOOD);
	assert_number(sample_of_four(point, knots, 2000, 0, 0, 0), 50, MAP_GOOD);
	assert_number(sample_of_four(point, knots, 99, 0, 0, 0), -10, MAP_OVERFLOW);
	assert_number(sample_of_four(point, knots, 2001, 0, 0, 0), 50, MAP_OVERFLOW);
	assert_true(convert_to_raw(&point, knots, 0, number(25), 0, raw));
	assert_int_equal(raw[0], 1500);
	assert_true(convert_to_raw(&point, knots, 0, number(-10), 0, raw));
	assert_int_equal(raw[0], 100);
	assert_false(convert_to_raw(&point, knots, 0, number(50.5F), 0, raw));
	assert_false(convert_to_raw(&point, knots, 0, number(-11), 0, raw));
}

/* ---- scale registers ------------------------------------------------------------------------- */

static struct modbus_point with_scale_register(enum map_type type, enum modbus_format format)
{
	return of_format(type, format, MODBUS_SCALE_REGISTER);
}

static struct map_sample sample_with(struct modbus_point point, const struct modbus_knot *knots,
				     uint16_t word, int8_t exponent)
{
	struct map_sample sample = {.quality = 0xFF, .detail = 0xFF};

	convert_to_sample(&point, knots, exponent, (const uint16_t[CONVERT_WIDTH_MAX]){word}, &sample);
	return sample;
}

static void test_powers_of_ten(void **state)
{
	(void)state;
	struct modbus_point point = with_scale_register(MAP_FLOAT, MODBUS_FORMAT_INT16);
	const struct modbus_point swapped =
	    of_format(MAP_FLOAT, MODBUS_FORMAT_INT16, MODBUS_SCALE_REGISTER | MODBUS_BYTES_SWAPPED);
	const struct modbus_point fixed = of_format(MAP_FLOAT, MODBUS_FORMAT_INT16, 0);

	assert_int_equal(convert_exponent(&point, 0), 0);
	assert_int_equal(convert_exponent(&point, 10), 10);
	assert_int_equal(convert_exponent(&point, (uint16_t)-10), -10);
	assert_int_equal(convert_exponent(&point, 11), CONVERT_NO_EXPONENT);
	assert_int_equal(convert_exponent(&point, (uint16_t)-11), CONVERT_NO_EXPONENT);
	assert_int_equal(convert_exponent(&point, 0x8000), CONVERT_NO_EXPONENT);
	assert_int_equal(convert_exponent(&point, 0x7FFF), CONVERT_NO_EXPONENT);
	assert_int_equal(convert_exponent(&point, 0xFF00),
			 CONVERT_NO_EXPONENT); /* -256: its octet would be 0 */
	assert_int_equal(convert_exponent(&swapped, 0xFEFF), -2);
	assert_int_equal(convert_first_exponent(&point), CONVERT_NO_EXPONENT);
	assert_int_equal(convert_first_exponent(&fixed), 0);
	assert_number(sample_with(point, NULL, 2288, -1), 228.8F, MAP_GOOD);
	assert_number(sample_with(point, NULL, (uint16_t)-7, 3), -7000, MAP_GOOD);
	assert_number(sample_with(point, NULL, 1, -10), 1e-10F, MAP_GOOD);
	assert_number(sample_with(point, NULL, 1, 10), 1e10F, MAP_GOOD);
	assert_number(sample_with(point, NULL, 5, CONVERT_NO_EXPONENT), 0, MAP_INVALID);
	point.scale = 0.001; /* in kW, say */
	assert_number(sample_with(point, NULL, 25, 2), 2.5F, MAP_GOOD);
	point.flags |= MODBUS_UNIMPLEMENTED;
	assert_number(sample_with(point, NULL, 0x8000, 2), 0, MAP_INVALID);
}

static void test_powers_of_ten_of_other_types(void **state)
{
	(void)state;
	const struct modbus_knot knots[] = {{0, 0}, {10, 100}};
	struct modbus_point table = with_scale_register(MAP_FLOAT, MODBUS_FORMAT_UINT16);
	const struct modbus_point scaled = with_scale_register(MAP_SCALED, MODBUS_FORMAT_INT16);
	struct modbus_point energy = with_scale_register(MAP_COUNTER, MODBUS_FORMAT_UINT64);
	struct map_sample sample = {.quality = 0xFF};

	table.knot_count = 2;
	assert_number(sample_with(table, knots, 55, -1), 55, MAP_GOOD);
	assert_int_equal(sample_with(scaled, NULL, 12345, -2).value.i, 123);
	assert_int_equal(sample_with(scaled, NULL, 12345, 1).value.i, INT16_MAX);
	assert_int_equal(sample_with(scaled, NULL, 12345, 1).quality, MAP_OVERFLOW);
	convert_to_sample(&energy, NULL, 1, (const uint16_t[CONVERT_WIDTH_MAX]){0, 0, 0, 1234}, &sample);
	assert_int_equal(sample.value.i, 12340);
}

static void test_commands_with_a_power_of_ten(void **state)
{
	(void)state;
	const struct modbus_knot knots[] = {{0, 0}, {10, 100}};
	struct modbus_point point = with_scale_register(MAP_FLOAT, MODBUS_FORMAT_INT16);
	uint16_t raw[CONVERT_WIDTH_MAX];

	assert_true(convert_to_raw(&point, NULL, -2, number(12.34F), 0, raw));
	assert_int_equal(raw[0], 1234);
	assert_true(convert_to_raw(&point, NULL, 2, number(-12340), 0, raw));
	assert_int_equal(raw[0], (uint16_t)-123);
	assert_false(convert_to_raw(&point, NULL, -10, number(1), 0, raw));
	point.scale = 0.001;
	assert_true(convert_to_raw(&point, NULL, 2, number(2.5F), 0, raw));
	assert_int_equal(raw[0], 25);
	point.knot_count = 2;
	assert_true(convert_to_raw(&point, knots, -1, number(55), 0, raw));
	assert_int_equal(raw[0], 55);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_single_point),
	    cmocka_unit_test(test_double_point),
	    cmocka_unit_test(test_step_position),
	    cmocka_unit_test(test_bitstring),
	    cmocka_unit_test(test_scaled_and_normalized),
	    cmocka_unit_test(test_scale_and_offset),
	    cmocka_unit_test(test_short_float),
	    cmocka_unit_test(test_counter),
	    cmocka_unit_test(test_inverted),
	    cmocka_unit_test(test_bits_of_a_register),
	    cmocka_unit_test(test_integers_of_32_bits),
	    cmocka_unit_test(test_numbers_of_64_bits),
	    cmocka_unit_test(test_unimplemented),
	    cmocka_unit_test(test_fields_of_a_register),
	    cmocka_unit_test(test_numbers_of_48_bits),
	    cmocka_unit_test(test_bcd),
	    cmocka_unit_test(test_mod10),
	    cmocka_unit_test(test_fixed_point),
	    cmocka_unit_test(test_scaling_table),
	    cmocka_unit_test(test_powers_of_ten),
	    cmocka_unit_test(test_powers_of_ten_of_other_types),
	    cmocka_unit_test(test_commands_with_a_power_of_ten),
	};
	return cmocka_run_group_tests_name("convert", tests, NULL, NULL);
}
