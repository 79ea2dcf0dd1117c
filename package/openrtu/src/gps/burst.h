/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A fix out of the sentences of one moment. A receiver says a moment in several sentences, and how many is nobody's promise:
 * a burst ends when a sentence names another moment, or when the line was silent.
 */
#ifndef OPENRTU_GPS_BURST_H
#define OPENRTU_GPS_BURST_H

#include "gps/date.h"
#include "gps/sentence.h"

#define GPS_CONSTELLATIONS 6

struct gps_burst {
	struct gps_calendar calendar;
	uint32_t faults;  /* enum gps_fault, of the last PGRMT */
	bool other_datum; /* of the last PGRMM */

	bool open, timed; /* since the last fix: a sentence; one that tells the time */
	uint32_t kinds;   /* since then: of those that tell the time, a bit for each enum nmea_kind */
	bool says_fix, says_no_fix;
	bool says_fix_of_nothing; /* GGA out of 0 satellites */
	uint8_t digits;           /* of the position that counts */
	enum nmea_kind position_from, method_from;
	int32_t date;      /* of this fix; 0: not given */
	int32_t date_ms;   /* the time of day that was said with it */
	int32_t last_date; /* days since 1970, corrected; 0: never given, or not believed */
	int32_t last_day_ms;
	struct nmea_report used[GPS_CONSTELLATIONS]; /* GSA of this fix: a constellation each */
	unsigned used_count;
	struct gps_fix fix; /* in the making */
};

/* built_days: of struct gps_calendar. */
void gps_burst_init(struct gps_burst *burst, int32_t built_days);

/*
 * Takes what a sentence says. True: it belongs to the next fix, and *fix is the one before. now_ns is its arrival.
 */
bool gps_burst_take(struct gps_burst *burst, const struct nmea_report *report, int64_t now_ns,
		    struct gps_fix *fix);
/* The line was silent. True: *fix is what came before. */
bool gps_burst_end(struct gps_burst *burst, struct gps_fix *fix);

/*
 * How long a burst of so many octets takes on a serial line, start and stop bit included; what takes longer than the
 * receiver's period is lost in part. Less than 2^29 octets; the rate is not 0.
 */
int64_t gps_burst_time_ns(uint32_t octets, uint32_t baud);

#endif
