/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Days of the calendar, and the week that GPS counts in ten bits. */
#ifndef OPENRTU_GPS_DATE_H
#define OPENRTU_GPS_DATE_H

#include <stdbool.h>
#include <stdint.h>

#define GPS_DAYS_OF_ERA (1024 * 7) /* then the week number begins again at 0 */

/* Days from 1970-01-01 to a date of 1970..2199. False: there is no such date. */
bool gps_days(int year, int month, int day, int32_t *out);

/* Which dates of a receiver are believed. */
struct gps_calendar {
	int32_t built_days; /* since 1970: before it, the program that reads the date did not exist */
	uint32_t corrected, refused;
};

/*
 * A receiver whose week number has rolled over says a date that is 1 024 weeks, or a multiple, too early: *days, which it says, is
 * moved by as many. False: there is no date to be believed; docs/positioning.md, "The date".
 */
bool gps_calendar_believe(struct gps_calendar *calendar, int32_t *days);

#endif
