/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "gps/date.h"

#define YEAR_MIN 1970
#define YEAR_MAX 2199

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

int32_t gps_correct_era(int32_t days, int32_t built_days, unsigned *eras)
{
	*eras = days < built_days ? (unsigned)((built_days - days - 1) / GPS_DAYS_OF_ERA + 1) : 0;
	return days + (int32_t)*eras * GPS_DAYS_OF_ERA;
}
