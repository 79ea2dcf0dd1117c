/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Decimal numbers of a text as scaled integers. */
#ifndef OPENRTU_GPS_NUMBER_H
#define OPENRTU_GPS_NUMBER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define GPS_DECIMALS_MAX 9

/*
 * Reads the whole text as a decimal number (sign, digits, point, digits) times 10^decimals, rounded half away from zero.
 * False: it is no such number, or its magnitude is 10^9 or more.
 */
bool gps_decimal(const char *text, size_t size, unsigned decimals, int64_t *out);

/* The number of digits behind the point. */
unsigned gps_decimals_of(const char *text, size_t size);

/* numerator / denominator, rounded half away from zero; denominator > 0. */
int64_t gps_divide(int64_t numerator, int64_t denominator);

#endif
