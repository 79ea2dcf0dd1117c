/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Positions, each one object of four points. Whatever is sent of one is of one fix: what was published in one step is read in one
 * step, and of an event the latitude, longitude and altitude are those that stand behind it in its owner's ring.
 */
#include "iec104/station_parts.h"
#include "map/value.h"

enum { POSITION, LATITUDE, LONGITUDE, ALTITUDE };

#define NIBBLE       0x0f
#define DM_PER_M     10.0f
#define ALTITUDE_ANY 1e6f /* m: more than can be sent */

bool iec104_read_position(const struct iec104_station *station, uint32_t point,
			  struct map_sample samples[IEC104_SAMPLES])
{
	const uint32_t together[IEC104_SAMPLES] = {point, point + LATITUDE, point + LONGITUDE,
						   point + ALTITUDE};

	return map_read_together(station->map, together, IEC104_SAMPLES, samples);
}

/* The same fix: one publishing has one time. */
static bool is_of(const struct map_event *event, const struct map_event *other)
{
	return other->kind == MAP_EVENT_CHANGE && other->time == event->time &&
	       other->sample.time_ns == event->sample.time_ns;
}

static bool follow_it(const struct iec104_station *station, struct map_cursor behind,
		      const struct map_event *event, struct map_sample samples[IEC104_SAMPLES])
{
	const uint32_t owner = map_owner(station->map, event->point), lost = behind.lost;

	for (uint32_t i = LATITUDE; i <= ALTITUDE; i++) {
		struct map_event other;

		if (!map_event_next_of(station->map, &behind, owner, &other) || behind.lost != lost ||
		    !is_of(event, &other) || other.point != event->point + i)
			return false;
		samples[i] = other.sample;
	}
	return true;
}

/* Its owner was stopped between the events of one publishing, which the map has whole since before them. */
static bool is_in_map(const struct iec104_station *station, const struct map_event *event,
		      struct map_sample samples[IEC104_SAMPLES])
{
	return iec104_read_position(station, event->point, samples) && event->time == MAP_TIME_MONOTONIC &&
	       samples[POSITION].time_ns == event->sample.time_ns;
}

bool iec104_complete_event(const struct iec104_station *station, const struct map_cursor *behind,
			   const struct map_event *event, struct map_sample samples[IEC104_SAMPLES])
{
	const bool whole = !iec104_is_position(station, event->point) ||
			   follow_it(station, *behind, event, samples) || is_in_map(station, event, samples);

	samples[POSITION] = event->sample;
	return whole;
}

/*
 * What is not known, or no altitude, is the least that can be sent, with overflow. So is that of an invalid place: nobody can tell
 * one that was known from one that never was.
 */
static int32_t altitude_dm(const struct map_sample samples[IEC104_SAMPLES])
{
	const float altitude_m = samples[ALTITUDE].value.f;

	if ((samples[ALTITUDE].quality & MAP_INVALID) != 0 ||
	    !(altitude_m > -ALTITUDE_ANY && altitude_m < ALTITUDE_ANY))
		return INT32_MIN;
	return map_round((double)(altitude_m * DM_PER_M));
}

struct iec104_geoposition iec104_position_of(const struct map_sample samples[IEC104_SAMPLES])
{
	return (struct iec104_geoposition){
	    .latitude = samples[LATITUDE].value.i,
	    .longitude = samples[LONGITUDE].value.i,
	    .altitude_dm = altitude_dm(samples),
	    .fix = samples[POSITION].value.u & NIBBLE,
	    .satellites = samples[POSITION].value.u >> 4 & NIBBLE,
	    .quality = samples[POSITION].quality,
	};
}
