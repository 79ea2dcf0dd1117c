/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What one sentence says. */
#ifndef OPENRTU_GPS_SENTENCE_H
#define OPENRTU_GPS_SENTENCE_H

#include "gps/fix.h"
#include "gps/line.h"

#define NMEA_GSV_SATELLITES 4
#define NMEA_GSA_SATELLITES 12

/* Where two sentences of one moment give a position with equally many digits, the first of these counts. */
enum nmea_kind {
	NMEA_GGA,
	NMEA_GNS,
	NMEA_RMC,
	NMEA_GLL,
	NMEA_PGRMF,
	NMEA_GSA,
	NMEA_GSV,
	NMEA_VTG,
	NMEA_ZDA,
	NMEA_PGRME,
	NMEA_PGRMM,
	NMEA_PGRMT,
	NMEA_PGRMV,
	NMEA_PGRMB,
	NMEA_PGRMC,
	NMEA_KINDS
};

enum nmea_says {
	NMEA_SAYS_NOTHING, /* of whether there is a fix */
	NMEA_SAYS_FIX,
	NMEA_SAYS_NO_FIX,
	NMEA_SAYS_FIX_OF_NOTHING, /* a fix out of 0 satellites: others decide */
};

/* What PGRMT, the receiver's report of itself each minute, finds wrong. */
enum gps_fault {
	GPS_FAULT_ROM = 1u << 0,
	GPS_FAULT_RECEIVER = 1u << 1,
	GPS_FAULT_STORED_DATA = 1u << 2,
	GPS_FAULT_CLOCK = 1u << 3,
	GPS_FAULT_OSCILLATOR = 1u << 4,
};

struct nmea_report {
	enum nmea_kind kind;
	enum nmea_says says;
	bool timed;     /* a sentence that tells the time, if it has it */
	int32_t day_ms; /* -1: it has not */
	int32_t date;   /* days since 1970, as the receiver says; 0: not given */
	uint32_t known; /* enum gps_known; which of the fields below */
	uint8_t digits; /* GPS_POSITION: of the minutes, behind the point */
	int32_t latitude, longitude;
	int32_t altitude_mm, geoid_mm, speed_mm_s, climb_mm_s, error_mm, error_vertical_mm;
	uint16_t course, hdop, pdop, vdop;
	bool has_method;
	uint8_t method;     /* enum gps_method */
	uint8_t dimensions; /* 0: not given */
	uint8_t satellites;
	char constellation;  /* GSV, GSA: as struct gps_satellite has it; GSA: 0 for all */
	bool first;          /* GSV: of its row */
	unsigned seen_count; /* GSV */
	struct gps_satellite seen[NMEA_GSV_SATELLITES];
	unsigned used_count; /* GSA */
	uint16_t used[NMEA_GSA_SATELLITES];
	bool other_datum; /* PGRMM */
	uint32_t faults;  /* PGRMT: enum gps_fault */
};

/* What becomes of a sound line. */
enum nmea_verdict {
	NMEA_READ,
	NMEA_NOT_READ,   /* of another kind */
	NMEA_IMPOSSIBLE, /* a field is no number, or beyond its range: nothing of the sentence counts */
};

/* Reads a sentence. Talkers are not told apart but by GSV and GSA. *out is complete only with NMEA_READ. */
enum nmea_verdict nmea_read(const struct nmea_sentence *sentence, struct nmea_report *out);

#endif
