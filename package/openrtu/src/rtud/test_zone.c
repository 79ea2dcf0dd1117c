/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Time zones as the configuration has them and as the wire shows them, beside the C library's own idea of them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <time.h>

#include <cmocka.h>

#include "config/zone.h"
#include "iec104/time56.h"
#include "map/time_ns.h"

#define BEGIN_S 946944000LL  /* 2000-01-04 */
#define END_S   4102185600LL /* 2099-12-29 */
#define STEP_S  43201        /* drifts through the hours of the day */
#define NEAR_S  299          /* around a border */
#define SU_BIT  0x80

static const char *const zones[] = {
    "UTC0",
    "CET-1CEST,M3.5.0,M10.5.0/3",
    "CET-1CEST-2,M3.5.0/2:00:00,M10.5.0/03:00",
    "AEST-10AEDT,M10.1.0,M4.1.0/3",
    "EST5EDT,M3.2.0,M11.1.0",
    "<-03>3<-02>,M3.5.0/-2,M10.5.0/-1",
    "<+1030>-10:30<+11>-11,M10.1.0,M4.1.0",
    "<+0545>-5:45",
    "IST-1GMT0,M10.5.0,M3.5.0/1",
    "EET-2EEST,M3.4.4/50,M10.4.4/50",
    "<+1245>-12:45<+1345>,M9.5.0/2:45,M4.1.0/3:45",
};

static void assert_like_the_library(const struct map_zone *zone, int64_t second)
{
	time_t when = (time_t)second;
	uint8_t octets[IEC104_TIME56_SIZE];
	struct tm local;

	localtime_r(&when, &local);
	iec104_time56_encode(octets, second * NS_PER_S, false, zone);
	assert_int_equal((octets[0] | octets[1] << 8) / 1000, local.tm_sec);
	assert_int_equal(octets[2], local.tm_min);
	assert_int_equal(octets[3], local.tm_hour | (local.tm_isdst > 0 ? SU_BIT : 0));
	assert_int_equal(octets[4], local.tm_mday);
	assert_int_equal(octets[5], local.tm_mon + 1);
	assert_int_equal(octets[6], local.tm_year - 100);
}

static bool is_summer(int64_t second)
{
	time_t when = (time_t)second;
	struct tm local;

	return localtime_r(&when, &local)->tm_isdst > 0;
}

static void assert_around_a_border(const struct map_zone *zone, int64_t second)
{
	for (int64_t near = second - STEP_S; near < second + 2 * STEP_S; near += NEAR_S)
		assert_like_the_library(zone, near);
}

static void test_zones_are_the_librarys(void **state)
{
	(void)state;
	for (size_t i = 0; i < sizeof(zones) / sizeof(zones[0]); i++) {
		struct map_zone zone;

		assert_true(config_read_zone(zones[i], &zone));
		setenv("TZ", zones[i], 1);
		tzset();
		for (int64_t second = BEGIN_S; second < END_S; second += STEP_S) {
			assert_like_the_library(&zone, second);
			if (is_summer(second) != is_summer(second + STEP_S))
				assert_around_a_border(&zone, second);
		}
	}
}

static void test_what_is_no_zone(void **state)
{
	static const char *const wrong[] = {
	    "",
	    "UTC",
	    "UT0",
	    "0",
	    "UTC0 ",
	    ":UTC0",
	    "<UT>0",
	    "<UTC0",
	    "UTC25",
	    "UTC1:60",
	    "UTC1:",
	    "UTC--1",
	    "CET-1CEST",
	    "CET-1CEST,",
	    "CET-1CEST,M3.5.0",
	    "CET-1CEST,M3.5.0,M10.5.0/168",
	    "CET-1CEST,M3.5.0,M10.5.7",
	    "CET-1CEST,M3.0.0,M10.5.0",
	    "CET-1CEST,M3.6.0,M10.5.0",
	    "CET-1CEST,M0.5.0,M10.5.0",
	    "CET-1CEST,J80,J300",
	    "CET-1CEST,M3.5.0,M10.5.0,",
	    "CET-1,M3.5.0,M10.5.0",
	};
	struct map_zone zone = {.offset_s = 1};

	(void)state;
	for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++)
		assert_false(config_read_zone(wrong[i], &zone));
	assert_int_equal(zone.offset_s, 1); /* and nothing is read half */
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_zones_are_the_librarys),
	    cmocka_unit_test(test_what_is_no_zone),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
