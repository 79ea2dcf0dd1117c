/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Fixes out of what gpsd sends to its clients: an object of JSON a line, of which TPV is a fix and SKY the satellites
 * (gpsd_json(5)). gpsd says nothing before it was told to: GPSD_WATCH.
 */
#ifndef OPENRTU_GPS_GPSD_H
#define OPENRTU_GPS_GPSD_H

#include "gps/date.h"
#include "gps/fix.h"
#include "gps/line.h"

#define GPSD_WATCH    "?WATCH={\"enable\":true,\"json\":true};\n"
#define GPSD_LINE_MAX 40960 /* four times GPS_JSON_RESPONSE_MAX: what gpsd 3.27 writes at most */

struct gpsd_reader {
	struct gps_calendar calendar;
	uint32_t counters[NMEA_COUNTERS];
	struct gps_sky sky;
	uint16_t hdop, pdop, vdop; /* of the last SKY, 0.01; 0: not given */
	uint8_t satellites;        /* used, of the last SKY */
	bool has_sky;
	bool too_long; /* the line that is being read */
	uint32_t size;
	char line[GPSD_LINE_MAX];
};

/* built_days: of struct gps_calendar; gpsd says the dates of receivers that it does not correct. */
void gpsd_reader_init(struct gpsd_reader *reader, int32_t built_days);

/* As gps_receiver_take: up to the first TPV. A line that is no JSON is counted as damaged, another class as unknown. */
bool gpsd_reader_take(struct gpsd_reader *reader, const uint8_t **bytes, size_t *size, int64_t now_ns,
		      struct gps_fix *fix);

#endif
