/* SPDX-License-Identifier: GPL-3.0-or-later */
/* An NMEA 0183 receiver on a line: octets and time in, fixes out. */
#ifndef OPENRTU_GPS_RECEIVER_H
#define OPENRTU_GPS_RECEIVER_H

#include "gps/burst.h"

struct gps_receiver {
	int64_t silence_ns; /* that ends a burst */
	int64_t heard_ns;   /* the last octet */
	struct nmea_line line;
	struct gps_burst burst;
};

/*
 * silence_ns: longer than the receiver pauses within a burst, shorter than between bursts. built_days: the day that the
 * program was built, since 1970 (struct gps_calendar).
 */
void gps_receiver_init(struct gps_receiver *receiver, int64_t silence_ns, int32_t built_days);

/*
 * Takes octets that arrived until now, up to the first that ends a burst, and moves *bytes and *size behind what it took.
 * True: *fix is that burst; the rest waits for the next call. False: all octets were taken.
 */
bool gps_receiver_take(struct gps_receiver *receiver, const uint8_t **bytes, size_t *size, int64_t now_ns,
		       struct gps_fix *fix);

/* At the deadline. True: the line was silent, and *fix is the burst before. */
bool gps_receiver_run(struct gps_receiver *receiver, int64_t now_ns, struct gps_fix *fix);
/* When gps_receiver_run is due; INT64_MAX: no burst is open. */
int64_t gps_receiver_deadline(const struct gps_receiver *receiver);

#endif
