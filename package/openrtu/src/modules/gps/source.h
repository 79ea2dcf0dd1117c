/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Where a receiver is: on a serial port, or behind gpsd. It is opened, read and, when it is lost, tried again; what comes out is
 * fixes. Nothing here blocks.
 */
#ifndef OPENRTU_MODULES_GPS_SOURCE_H
#define OPENRTU_MODULES_GPS_SOURCE_H

#include "channel/attempts.h"
#include "gps/config.h"
#include "gps/gpsd.h"
#include "gps/receiver.h"
#include "gps/stats.h"

#define SOURCE_PATH_SIZE (2 * MAP_FILE_SIZE)

struct source {
	struct map *map;
	const struct gps_settings *settings;
	struct gps_stats *stats;
	char path[SOURCE_PATH_SIZE];
	int fd;          /* -1: closed */
	bool connecting; /* to gpsd */
	bool told;       /* a position, since it was opened */
	bool several;    /* gpsd has told of several receivers */
	int64_t due_ns;  /* when it is opened again, or the connection given up */
	struct attempts attempts;
	struct gps_receiver nmea;
	struct gpsd_reader gpsd;
};

typedef void source_fix(void *context, struct gps_fix *fix);

/* directory: of serial devices that have no absolute path. The rest must outlive it. built_days: of struct gps_calendar. */
void source_init(struct source *source, struct map *map, const struct gps_settings *settings,
		 struct gps_stats *stats, const char *directory, int32_t built_days);

/*
 * Does all there is to do at now_ns: opens, reads, ends a burst after its silence. take is called for each fix, whose
 * arrival is CLOCK_MONOTONIC.
 */
void source_run(struct source *source, int64_t now_ns, source_fix *take, void *context);

/* What to wait for on fd: events of poll. 0: nothing, fd is -1. */
short source_events(const struct source *source);
/* When source_run is due without them. */
int64_t source_deadline(const struct source *source);

void source_close(struct source *source);

#endif
