/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the fixes of a receiver say one after the other: whether they can be, and when one is worth an event. */
#ifndef OPENRTU_GPS_TRACK_H
#define OPENRTU_GPS_TRACK_H

#include "gps/fix.h"

/* What a vehicle can do. */
struct gps_limits {
	int32_t speed_mm_s; /* the greatest */
	int32_t slack_mm;   /* what positions differ by where nothing moves */
	uint32_t believed;  /* so many fixes after a jump that agree with each other are the new track */
	int64_t
	    clock_ns; /* by how much the receiver's time and ours may go on differently between two fixes */
};

/* All 0 to begin with. */
struct gps_track {
	bool known, timed;
	uint32_t agreeing;           /* fixes since a jump that follow from each other */
	int32_t latitude, longitude; /* of the last fix that was believed */
	int64_t arrival_ns;
	int32_t last_latitude, last_longitude; /* of the last one at all */
	int64_t last_arrival_ns;
	int64_t clock_time_ns, clock_arrival_ns; /* of the last one with a time */
	uint32_t jumps, too_fast, clock_steps;   /* how often */
};

/* Adds to the marks of a fix what is odd about it beside those before. One without a position changes nothing. */
void gps_track_judge(struct gps_track *track, const struct gps_limits *limits, struct gps_fix *fix);

/* When a fix is an event. 0: not for this reason. */
struct gps_rule {
	int32_t distance_mm;     /* so far from the last that was sent */
	uint16_t turn;           /* 0.01 degree from its course, */
	int32_t turn_speed_mm_s; /* while it is at least as fast: the course of one that stands is noise */
	int64_t time_ns;         /* so long after it */
};

enum gps_reason {
	GPS_NOT_DUE,
	GPS_FIRST,
	GPS_STATE, /* found, lost, another method or mark */
	GPS_BY_DISTANCE,
	GPS_BY_TURN,
	GPS_BY_TIME,
};

/* sent: the last fix that was an event; NULL: none yet. */
enum gps_reason gps_due(const struct gps_rule *rule, const struct gps_fix *sent, const struct gps_fix *fix);

/*
 * The quality of a fix's values at a time of the clock of arrival_ns, as enum map_quality: invalid without a fix or with a mark,
 * substituted where it is estimated, typed or simulated, not topical after topical_ns.
 */
uint8_t gps_quality(const struct gps_fix *fix, int64_t now_ns, int64_t topical_ns);

#endif
