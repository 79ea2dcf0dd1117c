/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "gps/date.h"

#include <stddef.h>

#define YEAR_MIN     1970
#define YEAR_MAX     2199
#define DAYS_OF_WEEK 7

static bool is_leap(int year)
{
	return year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
}

static int days_in_month(int year, int month)
{
	static const uint8_t days[] = {31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31};

	return days[month - 1] + (month == 2 && is_leap(year));
}

bool gps_days(int year, int month, int day, int32_t *out)
{
	int past = year - 1;

	if (year < YEAR_MIN || year > YEAR_MAX || month < 1 || month > 12 || day < 1 ||
	    day > days_in_month(year, month))
		return false;
	*out = (year - YEAR_MIN) * 365 + (past / 4 - past / 100 + past / 400) -
	       (1969 / 4 - 1969 / 100 + 1969 / 400);
	for (int m = 1; m < month; m++)
		*out += days_in_month(year, m);
	*out += day - 1;
	return true;
}

/*
 * Near a day with which clocks begin: of GPS's, the day of the week and the time of day may be right, and the week not known yet; the
 * evening before, its leap seconds are.
 */
static bool is_where_clocks_begin(int32_t days)
{
	static const int32_t starts[] = {
	    0,     /* 1970-01-01: of Unix */
	    3652,  /* 1980-01-01: of the first PC, */
	    3657,  /* 1980-01-06: and of GPS: its week 0, */
	    10825, /* 1999-08-22: again */
	    17993, /* 2019-04-07: and again; the next, 2038-11-21, will be too late for the two digits of a year */
	    10957, /* 2000-01-01: of clocks with two digits for the year */
	};

	for (size_t i = 0; i < sizeof(starts) / sizeof(starts[0]); i++)
		if (days >= starts[i] - 1 && days < starts[i] + DAYS_OF_WEEK)
			return true;
	return false;
}

static bool believe(int32_t *days, int32_t built_days)
{
	const int32_t early = built_days - *days;

	if (early <= 0)
		return early > -GPS_DAYS_OF_ERA;
	if (is_where_clocks_begin(*days))
		return false;
	*days += (early + GPS_DAYS_OF_ERA - 1) / GPS_DAYS_OF_ERA * GPS_DAYS_OF_ERA;
	return *days - built_days < GPS_DAYS_OF_ERA / 2;
}

bool gps_calendar_believe(struct gps_calendar *calendar, int32_t *days)
{
	const int32_t said = *days;
	const bool believed = believe(days, calendar->built_days);

	calendar->refused += !believed;
	calendar->corrected += believed && *days != said;
	return believed;
}
