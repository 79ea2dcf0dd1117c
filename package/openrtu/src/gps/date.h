/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Days of the calendar, and the week that GPS counts in ten bits. */
#ifndef OPENRTU_GPS_DATE_H
#define OPENRTU_GPS_DATE_H

#include <stdbool.h>
#include <stdint.h>

#define GPS_DAYS_OF_ERA (1024 * 7) /* then the week number begins again at 0 */

/* Days from 1970-01-01 to a date of 1970..2199. False: there is no such date. */
bool gps_days(int year, int month, int day, int32_t *out);

/*
 * A receiver whose week number has rolled over says a date that is 1 024 weeks, or a multiple, too early. A date before
 * built_days cannot be: the program that reads it did not exist. Returns the first date from there on that is a multiple
 * of 1 024 weeks later, and by how many in *eras.
 */
int32_t gps_correct_era(int32_t days, int32_t built_days, unsigned *eras);

#endif
