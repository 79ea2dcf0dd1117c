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
#include "map/time_ns.h"

#define GPSD_WATCH    "?WATCH={\"enable\":true,\"json\":true};\n"
#define GPSD_LINE_MAX 40960 /* four times GPS_JSON_RESPONSE_MAX: what gpsd 3.27 writes at most */

#define GPSD_DEVICE_SIZE 128 /* GPS_PATH_MAX of gpsd */
#define GPSD_OTHER_NS    (10 * NS_PER_S)

struct gpsd_reader {
	const char *wanted;            /* the receiver, as gpsd names it; empty: the first with a fix */
	char device[GPSD_DEVICE_SIZE]; /* the one that counts, once one was heard */
	char other[GPSD_DEVICE_SIZE];  /* one that does not; empty: there was none */
	bool heard;
	int64_t fixed_ns; /* when it had a fix last, 0: never */
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

/*
 * built_days: of struct gps_calendar; gpsd says the dates of receivers that it does not correct. wanted is of the reader's whole life.
 * Of several receivers one counts, so that a place does not go to and fro: unless one is wanted, another one takes over that has a
 * fix when this one has had none for GPSD_OTHER_NS.
 */
void gpsd_reader_init(struct gpsd_reader *reader, const char *wanted, int32_t built_days);

/* As gps_receiver_take: up to the first TPV. A line that is no JSON is counted as damaged, another class as unknown. */
bool gpsd_reader_take(struct gpsd_reader *reader, const uint8_t **bytes, size_t *size, int64_t now_ns,
		      struct gps_fix *fix);

#endif
