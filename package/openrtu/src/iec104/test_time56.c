/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "iec104/time56.h"

#define NS_PER_MS 1000000LL

/* Unix times as `date -u +%s` gives them. */
static const struct {
	int64_t seconds;
	int ms;
	uint8_t octets[7];
} borders[] = {
    {946684800, 0, {0x00, 0x00, 0, 0, 1, 1, 0}},          /* 2000-01-01 00:00:00.000 */
    {951782399, 999, {0x5f, 0xea, 59, 23, 28, 2, 0}},     /* 2000-02-28 23:59:59.999 */
    {951782400, 0, {0x00, 0x00, 0, 0, 29, 2, 0}},         /* 2000-02-29 */
    {951868800, 0, {0x00, 0x00, 0, 0, 1, 3, 0}},          /* 2000-03-01 */
    {978307199, 999, {0x5f, 0xea, 59, 23, 31, 12, 0}},    /* 2000-12-31 23:59:59.999 */
    {978307200, 0, {0x00, 0x00, 0, 0, 1, 1, 1}},          /* 2001-01-01 */
    {983404799, 0, {0x78, 0xe6, 59, 23, 28, 2, 1}},       /* 2001-02-28 23:59:59 */
    {983404800, 0, {0x00, 0x00, 0, 0, 1, 3, 1}},          /* 2001-03-01 */
    {1709164800, 0, {0x00, 0x00, 0, 0, 29, 2, 24}},       /* 2024-02-29 */
    {1739971488, 152, {0x18, 0xbc, 24, 13, 19, 2, 25}},   /* 2025-02-19 13:24:48.152 */
    {1801439999, 1, {0x79, 0xe6, 59, 23, 31, 1, 27}},     /* 2027-01-31 23:59:59.001 */
    {2147483648, 0, {0x40, 0x1f, 14, 3, 19, 1, 38}},      /* 2038-01-19 03:14:08: no 32-bit time_t */
    {4102444799LL, 999, {0x5f, 0xea, 59, 23, 31, 12, 99}} /* 2099-12-31 23:59:59.999 */
};

static void test_borders(void **state)
{
	(void)state;
	for (size_t i = 0; i < sizeof(borders) / sizeof(borders[0]); i++) {
		int64_t wall_ns = borders[i].seconds * 1000000000LL + borders[i].ms * NS_PER_MS, decoded;
		uint8_t octets[7];

		iec104_time56_encode(octets, wall_ns, false);
		assert_memory_equal(octets, borders[i].octets, sizeof(octets));
		assert_true(iec104_time56_decode(octets, &decoded));
		assert_true(decoded == wall_ns);
	}
}

/* Each day of the century, at changing times of the day, comes back as it went. */
static void test_every_day(void **state)
{
	(void)state;
	for (int64_t day = 10957; day < 47482; day++) {
		int64_t ms = day * 86400000LL + day * 7919 % 86400000, decoded = 0;
		uint8_t octets[7];

		iec104_time56_encode(octets, ms * NS_PER_MS, false);
		assert_true(iec104_time56_decode(octets, &decoded));
		assert_true(decoded == ms * NS_PER_MS);
	}
}

static void test_invalid_bit(void **state)
{
	uint8_t octets[7];
	int64_t wall_ns;

	(void)state;
	iec104_time56_encode(octets, 1739971488152 * NS_PER_MS, true);
	assert_int_equal(octets[2], 0x80 | 24);
	assert_false(iec104_time56_decode(octets, &wall_ns));
}

static void test_outside_the_century(void **state)
{
	static const uint8_t first[] = {0, 0, 0x80, 0, 1, 1, 0};
	static const uint8_t last[] = {0x5f, 0xea, 0x80 | 59, 23, 31, 12, 99};
	uint8_t octets[7];

	(void)state;
	iec104_time56_encode(octets, 0, false);
	assert_memory_equal(octets, first, 7);
	iec104_time56_encode(octets, -1, false);
	assert_memory_equal(octets, first, 7);
	iec104_time56_encode(octets, 4102444800LL * 1000000000LL, false);
	assert_memory_equal(octets, last, 7);
}

static void test_no_such_time(void **state)
{
	static const uint8_t wrong[][7] = {
	    {0x60, 0xea, 0, 0, 1, 1, 0}, /* 60 000 ms */
	    {0, 0, 60, 0, 1, 1, 0},      {0, 0, 0, 24, 1, 1, 0},  {0, 0, 0, 0, 0, 1, 0},
	    {0, 0, 0, 0, 1, 0, 0},       {0, 0, 0, 0, 1, 13, 0},  {0, 0, 0, 0, 29, 2, 1},
	    {0, 0, 0, 0, 31, 4, 0},      {0, 0, 0, 0, 1, 1, 100}, {0, 0, 0, 0, 30, 2, 24},
	};
	int64_t wall_ns;

	(void)state;
	for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++)
		assert_false(iec104_time56_decode(wrong[i], &wall_ns));
}

/* Summer time, day of week and reserved bits carry nothing. */
static void test_bits_that_do_not_count(void **state)
{
	static const uint8_t octets[] = {0x18, 0xbc, 0x40 | 24, 0xe0 | 13, 3 << 5 | 19, 0xf0 | 2, 0x80 | 25};
	int64_t wall_ns;

	(void)state;
	assert_true(iec104_time56_decode(octets, &wall_ns));
	assert_true(wall_ns == 1739971488152 * NS_PER_MS);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_borders),      cmocka_unit_test(test_every_day),
	    cmocka_unit_test(test_invalid_bit),  cmocka_unit_test(test_outside_the_century),
	    cmocka_unit_test(test_no_such_time), cmocka_unit_test(test_bits_that_do_not_count),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
