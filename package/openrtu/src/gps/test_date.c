/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "gps/date.h"

static int32_t day(int year, int month, int day_of_month)
{
	int32_t days;

	assert_true(gps_days(year, month, day_of_month, &days));
	return days;
}

#define BUILT day(2026, 11, 29)

static void test_days(void **state)
{
	int32_t days;

	(void)state;
	assert_int_equal(day(1970, 1, 1), 0);
	assert_int_equal(day(2000, 2, 29), 11016);
	assert_int_equal(day(2026, 11, 29), 20786);
	assert_int_equal(day(2199, 12, 31), 84005);
	assert_false(gps_days(2100, 2, 29, &days));
	assert_false(gps_days(1969, 12, 31, &days));
}

static void refused(int32_t said, int32_t built)
{
	struct gps_calendar calendar = {.built_days = built};
	int32_t days = said;

	assert_false(gps_calendar_believe(&calendar, &days));
	assert_int_equal(calendar.refused, 1);
	assert_int_equal(calendar.corrected, 0);
}

static void believed(int32_t said, int32_t built, int32_t expected)
{
	struct gps_calendar calendar = {.built_days = built};
	int32_t days = said;

	assert_true(gps_calendar_believe(&calendar, &days));
	assert_int_equal(days, expected);
	assert_int_equal(calendar.refused, 0);
	assert_int_equal(calendar.corrected, expected != said);
}

static void test_as_said(void **state)
{
	(void)state;
	believed(BUILT, BUILT, BUILT);
	believed(BUILT + 1024 * 7 - 1, BUILT, BUILT + 1024 * 7 - 1);
	refused(BUILT + 1024 * 7, BUILT);
	refused(day(2079, 1, 1), BUILT);
}

static void test_a_week_that_rolled_over(void **state)
{
	(void)state;
	believed(day(2007, 4, 15), BUILT, BUILT); /* one era before */
	believed(day(1987, 8, 30), BUILT, BUILT); /* two */
	refused(day(2007, 4, 14), BUILT);         /* 2026-11-28, or 2046 */
	believed(BUILT - 512 * 7 - 1, BUILT, BUILT + 512 * 7 - 1);
	refused(BUILT - 512 * 7, BUILT);
	refused(BUILT - 1, BUILT);
}

static void test_where_clocks_begin(void **state)
{
	const int32_t starts[] = {day(1970, 1, 1),  day(1980, 1, 1), day(1980, 1, 6),
				  day(1999, 8, 22), day(2000, 1, 1), day(2019, 4, 7)};

	(void)state;
	/* Whenever the program was built: a few days after one of them a corrected date would be near. */
	for (size_t i = 0; i < sizeof(starts) / sizeof(starts[0]); i++)
		for (int32_t built = starts[i] + 14; built < day(2079, 12, 31); built += 100) {
			if (i == 3 ||
			    i == 5) /* the others are less than a week after another, or the first day */
				refused(starts[i] - 1, built);
			refused(starts[i], built);
			refused(starts[i] + 6, built);
		}
	believed(day(1980, 1, 13), day(2038, 11, 1), day(2038, 11, 28));
	believed(day(1999, 8, 29), day(2019, 4, 1), day(2019, 4, 14));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_days),
	    cmocka_unit_test(test_as_said),
	    cmocka_unit_test(test_a_week_that_rolled_over),
	    cmocka_unit_test(test_where_clocks_begin),
	};
	return cmocka_run_group_tests_name("gps date", tests, NULL, NULL);
}
