/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "gps/fence.h"

#include "gps/sphere.h"

#define MM_PER_M    1000
#define QUARTER     900000000
#define HALF_CIRCLE 1800000000
#define CIRCLE      (2LL * HALF_CIRCLE)

static bool is_place(struct gps_place place)
{
	return place.latitude >= -QUARTER && place.latitude <= QUARTER && place.longitude >= -HALF_CIRCLE &&
	       place.longitude <= HALF_CIRCLE;
}

static struct gps_place next_corner(const struct gps_fence *fence, uint32_t corner)
{
	return fence->corners[corner + 1 < fence->corner_count ? corner + 1 : 0];
}

const char *gps_fence_fault(const struct gps_fence *fence)
{
	int64_t round = 0;

	if (fence->corner_count == 0) {
		if (!is_place(fence->centre))
			return "the coordinates of its centre are not on the Earth";
		if (fence->radius_m == 0 || fence->radius_m > GPS_FENCE_RADIUS_MAX_M)
			return "its radius is outside 1 to 10 000 000 m";
		return NULL;
	}
	if (fence->corner_count < GPS_FENCE_CORNERS_MIN || fence->corner_count > GPS_FENCE_CORNERS_MAX)
		return "it needs 3 to 64 corners";
	for (uint32_t i = 0; i < fence->corner_count; i++) {
		if (!is_place(fence->corners[i]))
			return "the coordinates of a corner are not on the Earth";
		round += gps_longitude_apart(fence->corners[i].longitude, next_corner(fence, i).longitude);
	}
	return round != 0 ? "it encloses a pole" : NULL;
}

/*
 * A side from the place's own meridian, as (x, y) to (x + dx, y + dy): does it cross the ray that leads east from the place?
 * Sides are no longer than 180 degrees, so the products below are less than 2^63.
 */
static bool crosses(int64_t x, int64_t dx, int64_t y, int64_t dy)
{
	int64_t reach;

	if ((y > 0) == (y + dy > 0))
		return false;
	if (x > 0 && x + dx > 0)
		return true;
	if (x < 0 && x + dx < 0)
		return false;
	reach = x * dy - y * dx; /* x of the crossing, times dy */
	return dy > 0 ? reach >= 0 : reach <= 0;
}

/* In the plane where the polygon's longitudes go on behind the antimeridian, with the place at that longitude. */
static bool polygon_holds(const struct gps_fence *fence, int32_t latitude, int64_t longitude)
{
	int64_t x = fence->corners[0].longitude - longitude;
	bool inside = false;

	for (uint32_t i = 0; i < fence->corner_count; i++) {
		struct gps_place from = fence->corners[i], to = next_corner(fence, i);
		int64_t dx = gps_longitude_apart(from.longitude, to.longitude);

		inside ^=
		    crosses(x, dx, (int64_t)from.latitude - latitude, (int64_t)to.latitude - from.latitude);
		x += dx;
	}
	return inside;
}

bool gps_fence_holds(const struct gps_fence *fence, struct gps_place place)
{
	if (fence->corner_count == 0)
		return gps_distance_mm(fence->centre.latitude, fence->centre.longitude, place.latitude,
				       place.longitude) <= (int64_t)fence->radius_m * MM_PER_M;
	return polygon_holds(fence, place.latitude, place.longitude) ||
	       polygon_holds(fence, place.latitude, place.longitude + CIRCLE) ||
	       polygon_holds(fence, place.latitude, place.longitude - CIRCLE);
}
