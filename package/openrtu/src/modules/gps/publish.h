/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A receiver's fixes as the points of its set. */
#ifndef OPENRTU_MODULES_GPS_PUBLISH_H
#define OPENRTU_MODULES_GPS_PUBLISH_H

#include "gps/config.h"
#include "gps/stats.h"

struct publisher {
	struct map *map;
	const struct gps_settings *settings;
	const struct gps_fence *fences; /* of this receiver */
	struct gps_stats *stats;
	struct gps_track track;
	bool has_sent, has_last, is_stale;
	struct gps_fix sent; /* the last that was an event */
	struct gps_fix last;
	int64_t
	    taken_over_ns; /* when this process began, with a position that a former one had; 0: without */
};

/* Everything it refers to must outlive it. */
void publisher_init(struct publisher *publisher, struct map *map, const struct gps_settings *settings,
		    struct gps_stats *stats);

/* Judges a fix and publishes it in one step; with an event where it is due. */
void publisher_take(struct publisher *publisher, struct gps_fix *fix);

/* At the deadline: the last fix is not topical any more. */
void publisher_run(struct publisher *publisher, int64_t now_ns);
int64_t publisher_deadline(const struct publisher *publisher);

#endif
