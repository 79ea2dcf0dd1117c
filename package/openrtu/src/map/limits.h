/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Limits of measured values that the configuration has: crossing one is an event, within the deadband too. */
#ifndef OPENRTU_MAP_LIMITS_H
#define OPENRTU_MAP_LIMITS_H

#include "map/config.h"
#include "map/value.h"

/* Of the points with MAP_POINT_LIMITS, in their order. */
#define MAP_LIMITS MAP_SECTION_ID('L', 'I', 'M', 'T')
struct map_limits {
	uint32_t point;
	float high_high, high, low, low_low; /* in the unit of the value sent */
};

/* Where a value is among its limits, as IEC 61850-7-3 numbers it (RangeKind). */
enum map_range { MAP_RANGE_NORMAL, MAP_RANGE_HIGH, MAP_RANGE_LOW, MAP_RANGE_HIGH_HIGH, MAP_RANGE_LOW_LOW };

/* NULL: the point has none, or they are of another version. */
static inline const struct map_limits *map_limits_of(const struct map_config *config, uint32_t point)
{
	const struct map_limits *limits = map_records(config, MAP_LIMITS, sizeof(*limits));
	uint32_t low = 0, high = limits == NULL ? 0 : map_record_count(config, MAP_LIMITS);

	while (low + 1 < high) {
		const uint32_t middle = low + (high - low) / 2;

		if (limits[middle].point <= point)
			low = middle;
		else
			high = middle;
	}
	return limits != NULL && limits[low].point == point ? &limits[low] : NULL;
}

/* A value on a limit has not crossed it, and one that is not a number has crossed none. */
static inline enum map_range map_range_of(const struct map_config *config, uint32_t point,
					  union map_value value)
{
	const struct map_limits *limits;
	double number;

	if (!(config->points[point].flags & MAP_POINT_LIMITS))
		return MAP_RANGE_NORMAL;
	limits = map_limits_of(config, point);
	if (limits == NULL)
		return MAP_RANGE_NORMAL;
	number = map_number((enum map_type)config->points[point].type, value);
	if (number > (double)limits->high)
		return number > (double)limits->high_high ? MAP_RANGE_HIGH_HIGH : MAP_RANGE_HIGH;
	if (number < (double)limits->low)
		return number < (double)limits->low_low ? MAP_RANGE_LOW_LOW : MAP_RANGE_LOW;
	return MAP_RANGE_NORMAL;
}

#endif
