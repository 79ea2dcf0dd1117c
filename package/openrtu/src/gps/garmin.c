/* SPDX-License-Identifier: GPL-3.0-or-later */
/* By the technical specifications of the GPS 17 and 18x receivers. */
#include "gps/garmin.h"

#define ERROR_MAX_MM    100000000 /* 100 km */
#define VELOCITY_MAX_MM 10000000

static bool millimetres(struct nmea_fields *fields, unsigned place, int64_t limit, int32_t *out)
{
	int64_t value;

	if (!nmea_number(fields, place, 3, -limit, limit, &value))
		return false;
	*out = (int32_t)value;
	return true;
}

/* $PGRMF,290,293895,160305,093802,13,5213.1439,N,02100.6511,E,A,2,0,226,2,1*11: week, its seconds, date, time, leap seconds,
 * position, mode, fix, speed in km/h, course, PDOP, TDOP */
static void position(struct nmea_fields *fields, struct nmea_report *out)
{
	int64_t dimensions = 0;

	out->kind = NMEA_PGRMF;
	out->timed = true;
	out->date = nmea_date(fields, 3);
	out->day_ms = nmea_time(fields, 4);
	nmea_position(fields, 6, out);
	if (nmea_number(fields, 11, 0, 0, 2, &dimensions))
		out->says = dimensions == 0 ? NMEA_SAYS_NO_FIX : NMEA_SAYS_FIX;
	if (dimensions > 0)
		out->dimensions = (uint8_t)(dimensions + 1);
	nmea_speed(fields, 12, NMEA_KMH_MM_S_MILLI, out);
	nmea_course(fields, 13, out);
}

/* $PGRME,1.7,M,2.4,M,3.0,M*2D: estimated error horizontal, vertical, spherical */
static void error(struct nmea_fields *fields, struct nmea_report *out)
{
	out->kind = NMEA_PGRME;
	if (nmea_is(fields, 2, "M") && millimetres(fields, 1, ERROR_MAX_MM, &out->error_mm))
		out->known |= GPS_ERROR;
	if (nmea_is(fields, 4, "M") && millimetres(fields, 3, ERROR_MAX_MM, &out->error_vertical_mm))
		out->known |= GPS_ERROR_VERTICAL;
}

/* $PGRMM,WGS 84*06: the datum of all positions. NAD83 is within two metres of it; others are off by hundreds. */
static void datum(struct nmea_fields *fields, struct nmea_report *out)
{
	out->kind = NMEA_PGRMM;
	out->other_datum =
	    nmea_size(fields, 1) > 0 && !nmea_is(fields, 1, "WGS 84") && !nmea_is(fields, 1, "NAD83");
}

/* $PGRMT,GPS 17-HVS VER 3.20,P,P,R,R,P,,23,R*08: product, tests of ROM, receiver, stored data, clock, oscillator; what is
 * collected, temperature, configuration */
static void status(const struct nmea_fields *fields, struct nmea_report *out)
{
	out->kind = NMEA_PGRMT;
	for (unsigned test = 0; test < 5; test++)
		if (nmea_is(fields, 2 + test, "F") || nmea_is(fields, 2 + test, "L"))
			out->faults |= 1u << test;
}

/* $PGRMV,0.0,0.0,0.0*5C: velocity east, north, up in m/s */
static void velocity(struct nmea_fields *fields, struct nmea_report *out)
{
	out->kind = NMEA_PGRMV;
	if (millimetres(fields, 3, VELOCITY_MAX_MM, &out->climb_mm_s))
		out->known |= GPS_CLIMB;
}

bool nmea_garmin(char letter, struct nmea_fields *fields, struct nmea_report *out)
{
	switch (letter) {
	case 'F':
		position(fields, out);
		return true;
	case 'E':
		error(fields, out);
		return true;
	case 'M':
		datum(fields, out);
		return true;
	case 'T':
		status(fields, out);
		return true;
	case 'V':
		velocity(fields, out);
		return true;
	case 'B': /* the beacon's frequency: nothing of a fix */
		out->kind = NMEA_PGRMB;
		return true;
	case 'C': /* how the receiver is set */
		out->kind = NMEA_PGRMC;
		return true;
	default:
		return false;
	}
}
