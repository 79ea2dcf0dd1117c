/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What a receiver knows at one moment: a fix, read and written as one. All numbers are integers: the board's processor has
 * no floating-point unit.
 */
#ifndef OPENRTU_GPS_FIX_H
#define OPENRTU_GPS_FIX_H

#include <stdbool.h>
#include <stdint.h>

#define GPS_SKY_MAX 64 /* four constellations, with some to spare */

/* How the position was found: the quality indicator of GGA (NMEA 0183). */
enum gps_method {
	GPS_NO_FIX,
	GPS_AUTONOMOUS,
	GPS_DIFFERENTIAL,
	GPS_PRECISE, /* PPS */
	GPS_RTK,
	GPS_RTK_FLOAT,
	GPS_ESTIMATED, /* dead reckoning */
	GPS_MANUAL,    /* somebody typed it */
	GPS_SIMULATED,
	GPS_METHODS
};

/* Which fields of a fix were given. A field that was not is 0. */
enum gps_known {
	GPS_POSITION = 1u << 0,
	GPS_TIME = 1u << 1,
	GPS_ALTITUDE = 1u << 2,
	GPS_SPEED = 1u << 3,
	GPS_COURSE = 1u << 4,
	GPS_CLIMB = 1u << 5,
	GPS_HDOP = 1u << 6,
	GPS_PDOP = 1u << 7,
	GPS_VDOP = 1u << 8,
	GPS_ERROR = 1u << 9,
	GPS_ERROR_VERTICAL = 1u << 10,
	GPS_SATELLITES = 1u << 11,
	GPS_GEOID = 1u << 12,
};

/* What is odd about a fix. It is shown by quality; a fix is never dropped for it. */
enum gps_mark {
	GPS_CONTRADICTS = 1u << 0, /* two sentences of one moment name different places */
	GPS_DATUM = 1u << 1,       /* PGRMM: the position is not of WGS 84 */
	GPS_JUMP = 1u << 2,        /* farther from the last place than the greatest speed allows */
	GPS_TOO_FAST = 1u << 3,    /* the receiver's own speed is above the greatest */
	GPS_CLOCK_STEP = 1u << 4,  /* the receiver's time and ours went on by different amounts */
};

struct gps_satellite {
	char
	    constellation; /* second letter of the talker: P GPS, L GLONASS, A Galileo, B BeiDou, Q QZSS, I NavIC */
	bool used;
	uint8_t snr; /* dB-Hz; 0: not tracked */
	int8_t elevation;
	uint16_t azimuth;
	uint16_t number; /* as its talker counts */
};

struct gps_sky {
	uint32_t count;
	struct gps_satellite satellites[GPS_SKY_MAX];
};

struct gps_fix {
	int64_t time_ns;     /* the receiver's: since 1970, UTC */
	int64_t arrival_ns;  /* the caller's clock at the fix's first octet */
	uint32_t known;      /* enum gps_known */
	uint32_t marks;      /* enum gps_mark */
	int32_t latitude;    /* 1e-7 degree, north positive */
	int32_t longitude;   /* 1e-7 degree, east positive */
	int32_t altitude_mm; /* above mean sea level */
	int32_t geoid_mm;    /* mean sea level above the ellipsoid */
	int32_t speed_mm_s;
	int32_t climb_mm_s;
	int32_t error_mm;          /* horizontal, as the receiver estimates it */
	int32_t error_vertical_mm; /* likewise */
	int32_t day_ms;            /* time of day, UTC; -1: not given */
	uint16_t course;           /* 0.01 degree, 0..35999, true */
	uint16_t hdop, pdop, vdop; /* 0.01 */
	uint8_t method;            /* enum gps_method */
	uint8_t dimensions;        /* 2 or 3; 0: not given */
	uint8_t satellites;        /* used */
	struct gps_sky sky;        /* the newest view, of this fix or of one before */
};

/* 0° N 0° E to the last digit is what receivers and converters say that do not know where they are, with `A` too. */
static inline bool gps_is_nowhere(int32_t latitude, int32_t longitude)
{
	return latitude == 0 && longitude == 0;
}

#endif
