/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Geofences: is a place inside a circle or a polygon. */
#ifndef OPENRTU_GPS_FENCE_H
#define OPENRTU_GPS_FENCE_H

#include <stdbool.h>
#include <stdint.h>

struct gps_place {
	int32_t latitude, longitude; /* 1e-7 degree */
};

#define GPS_FENCE_RADIUS_MAX_M 10000000 /* a quarter of the way round */
#define GPS_FENCE_CORNERS_MIN  3
#define GPS_FENCE_CORNERS_MAX  64

/*
 * Without corners a circle. The sides of a polygon are straight where latitude and longitude are a plane, and take the
 * short way round: across the antimeridian too. Where sides cross, what they enclose twice is outside.
 */
struct gps_fence {
	struct gps_place centre; /* of a circle */
	uint32_t radius_m;
	uint32_t corner_count;
	struct gps_place corners[GPS_FENCE_CORNERS_MAX];
};

/* Why a fence cannot be used, in words; NULL: it can. A polygon that encloses a pole cannot. */
const char *gps_fence_fault(const struct gps_fence *fence);

/* Of a fence without fault. A place on a side of a polygon is on either side of it. */
bool gps_fence_holds(const struct gps_fence *fence, struct gps_place place);

#endif
