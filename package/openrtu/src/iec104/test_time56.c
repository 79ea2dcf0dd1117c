/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "iec104/time56.h"
#include "map/time_ns.h"

static const struct map_zone utc;

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

		iec104_time56_encode(octets, wall_ns, false, &utc);
		assert_memory_equal(octets, borders[i].octets, sizeof(octets));
		assert_true(iec104_time56_decode(octets, &utc, &decoded));
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

		iec104_time56_encode(octets, ms * NS_PER_MS, false, &utc);
		assert_true(iec104_time56_decode(octets, &utc, &decoded));
		assert_true(decoded == ms * NS_PER_MS);
	}
}

static void test_invalid_bit(void **state)
{
	uint8_t octets[7];
	int64_t wall_ns;

	(void)state;
	iec104_time56_encode(octets, 1739971488152 * NS_PER_MS, true, &utc);
	assert_int_equal(octets[2], 0x80 | 24);
	assert_false(iec104_time56_decode(octets, &utc, &wall_ns));
}

static void test_outside_the_century(void **state)
{
	static const uint8_t first[] = {0, 0, 0x80, 0, 1, 1, 0};
	static const uint8_t last[] = {0x5f, 0xea, 0x80 | 59, 23, 31, 12, 99};
	uint8_t octets[7];

	(void)state;
	iec104_time56_encode(octets, 0, false, &utc);
	assert_memory_equal(octets, first, 7);
	iec104_time56_encode(octets, -1, false, &utc);
	assert_memory_equal(octets, first, 7);
	iec104_time56_encode(octets, 4102444800LL * 1000000000LL, false, &utc);
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
		assert_false(iec104_time56_decode(wrong[i], &utc, &wall_ns));
}

/* Day of week and reserved bits carry nothing. */
static void test_bits_that_do_not_count(void **state)
{
	static const uint8_t octets[] = {0x18, 0xbc, 0x40 | 24, 0x60 | 13, 3 << 5 | 19, 0xf0 | 2, 0x80 | 25};
	int64_t wall_ns;

	(void)state;
	assert_true(iec104_time56_decode(octets, &utc, &wall_ns));
	assert_true(wall_ns == 1739971488152 * NS_PER_MS);
}

static const struct map_zone berlin = {
    3600, 7200, {3, 5, 0, 0, 2 * 3600}, {10, 5, 0, 0, 3 * 3600}}; /* CET-1CEST,M3.5.0,M10.5.0/3 */
static const struct map_zone hobart = {
    36000, 39600, {10, 1, 0, 0, 2 * 3600}, {4, 1, 0, 0, 3 * 3600}}; /* AEST-10AEDT,M10.1.0,M4.1.0/3 */
static const struct map_zone nuuk = {
    -7200, -3600, {3, 5, 0, 0, -3600}, {10, 5, 0, 0, 0}};          /* <-02>2<-01>,M3.5.0/-1,M10.5.0/0 */
static const struct map_zone kathmandu = {20700, 20700, {0}, {0}}; /* <+0545>-5:45 */

/* Unix times and local times as `TZ=... date -d @N` gives them. */
static const struct {
	const struct map_zone *zone;
	int64_t seconds;
	uint8_t octets[7];
} zone_borders[] = {
    {&berlin, 1767222000, {0, 0, 0, 0, 1, 1, 26}},                 /* 2026-01-01 00:00, 2025 in UTC */
    {&berlin, 1767221999, {0x78, 0xe6, 59, 23, 31, 12, 25}},       /* the second before */
    {&berlin, 1774745999, {0x78, 0xe6, 59, 1, 29, 3, 26}},         /* 2026-03-29 01:59:59 */
    {&berlin, 1774746000, {0, 0, 0, 0x80 | 3, 29, 3, 26}},         /* 03:00 summer time */
    {&berlin, 1792889999, {0x78, 0xe6, 59, 0x80 | 2, 25, 10, 26}}, /* 2026-10-25 02:59:59 summer time */
    {&berlin, 1792890000, {0, 0, 0, 2, 25, 10, 26}},               /* 02:00 again */
    {&berlin, 1793487600, {0, 0, 0, 0, 1, 11, 26}},                /* 2026-11-01 */
    {&hobart, 1767189600, {0, 0, 0, 0x80 | 1, 1, 1, 26}},          /* 2026-01-01 01:00, in summer */
    {&hobart, 1775318399, {0x78, 0xe6, 59, 0x80 | 2, 5, 4, 26}},   /* 2026-04-05 02:59:59 */
    {&hobart, 1775318400, {0, 0, 0, 2, 5, 4, 26}},                 /* 02:00 again */
    {&hobart, 1791043199, {0x78, 0xe6, 59, 1, 4, 10, 26}},         /* 2026-10-04 01:59:59 */
    {&hobart, 1791043200, {0, 0, 0, 0x80 | 3, 4, 10, 26}},         /* 03:00 */
    {&nuuk, 1774745999, {0x78, 0xe6, 59, 22, 28, 3, 26}},          /* 2026-03-28 22:59:59 */
    {&nuuk, 1774746000, {0, 0, 0, 0x80 | 0, 29, 3, 26}},           /* 00:00 of the Sunday */
    {&kathmandu, 1772302500, {0, 0, 0, 0, 1, 3, 26}},              /* 2026-03-01 00:00 */
};

static void test_zone_borders(void **state)
{
	(void)state;
	for (size_t i = 0; i < sizeof(zone_borders) / sizeof(zone_borders[0]); i++) {
		int64_t wall_ns = zone_borders[i].seconds * 1000 * NS_PER_MS, decoded;
		uint8_t octets[7];

		iec104_time56_encode(octets, wall_ns, false, zone_borders[i].zone);
		assert_memory_equal(octets, zone_borders[i].octets, sizeof(octets));
		assert_true(iec104_time56_decode(octets, zone_borders[i].zone, &decoded));
		assert_true(decoded == wall_ns);
	}
}

/* Each half hour of a century comes back as it went, the hour that comes twice by its SU bit. */
static void test_every_half_hour_in_zones(void **state)
{
	static const struct map_zone *const zones[] = {&berlin, &hobart, &nuuk, &kathmandu};

	(void)state;
	for (size_t i = 0; i < sizeof(zones) / sizeof(zones[0]); i++) {
		for (int64_t half = 526056; half < 2279000; half++) {
			int64_t wall_ns = half * 1800 * 1000 * NS_PER_MS, decoded = 0;
			uint8_t octets[7];

			iec104_time56_encode(octets, wall_ns, false, zones[i]);
			assert_true(iec104_time56_decode(octets, zones[i], &decoded));
			assert_true(decoded == wall_ns);
		}
	}
}

static void test_wrong_summer_bit(void **state)
{
	static const uint8_t wrong[][7] = {
	    {0, 0, 0, 0x80 | 13, 19, 2, 25}, /* summer time in February */
	    {0, 0, 0, 13, 19, 7, 25},        /* winter time in July */
	    {0, 0, 30, 2, 29, 3, 26},        /* the hour that is left out, either way */
	    {0, 0, 30, 0x80 | 2, 29, 3, 26},
	    {0, 0, 30, 0x80 | 3, 25, 10, 26}, /* after both hours that are called 2 */
	    {0, 0, 30, 1, 25, 10, 26},        /* before them */
	};
	int64_t wall_ns;

	(void)state;
	for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++)
		assert_false(iec104_time56_decode(wrong[i], &berlin, &wall_ns));
	assert_true(iec104_time56_lacks_season(wrong[0], &berlin));
	assert_true(iec104_time56_lacks_season(wrong[1], &berlin));
	assert_false(iec104_time56_lacks_season(wrong[2], &berlin)); /* there is no such time */
	assert_false(iec104_time56_decode(wrong[0], &utc, &wall_ns));
	assert_false(iec104_time56_decode(wrong[0], &kathmandu, &wall_ns));
}

/* 2026-10-25 02:30 is 00:30 UTC in summer time and 01:30 UTC behind it. */
static void test_without_the_summer_bit(void **state)
{
	static const uint8_t july[7] = {0, 0, 0, 13, 19, 7, 25}, twice[7] = {0, 0, 30, 2, 25, 10, 26};
	static const uint8_t never[7] = {0, 0, 30, 2, 29, 3, 26},
			     february[7] = {0, 0, 0, 0x80 | 13, 19, 2, 25};
	const int64_t s = 1000 * NS_PER_MS, summer = 1792888200 * s, winter = summer + 3600 * s;
	int64_t wall_ns;

	(void)state;
	assert_true(iec104_time56_decode_nearest(july, &berlin, 0, &wall_ns));
	assert_true(wall_ns == 1752922800 * s); /* 11:00 UTC */
	assert_true(iec104_time56_decode_nearest(february, &berlin, 0, &wall_ns));
	assert_true(wall_ns == 1739966400 * s); /* 12:00 UTC */
	assert_true(iec104_time56_decode_nearest(twice, &berlin, summer + 2 * s, &wall_ns));
	assert_true(wall_ns == summer);
	assert_true(iec104_time56_decode_nearest(twice, &berlin, winter - 2 * s, &wall_ns));
	assert_true(wall_ns == winter);
	assert_true(iec104_time56_decode_nearest(twice, &berlin, INT64_MAX / 2, &wall_ns));
	assert_true(wall_ns == winter);
	assert_false(iec104_time56_decode_nearest(never, &berlin, summer, &wall_ns));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_borders),          cmocka_unit_test(test_every_day),
	    cmocka_unit_test(test_invalid_bit),      cmocka_unit_test(test_outside_the_century),
	    cmocka_unit_test(test_no_such_time),     cmocka_unit_test(test_bits_that_do_not_count),
	    cmocka_unit_test(test_zone_borders),     cmocka_unit_test(test_every_half_hour_in_zones),
	    cmocka_unit_test(test_wrong_summer_bit), cmocka_unit_test(test_without_the_summer_bit),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
