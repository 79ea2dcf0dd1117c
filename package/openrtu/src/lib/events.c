/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Events of the points that the module reads: each once, in order, with a cursor of its own. */
#include "lib/handle.h"

/* Whoever writes faster than this has gone wild, and shall not hold this module up. */
#define RECORDS_A_SCAN 65536u

void events_begin(struct openrtu *rtu)
{
	map_cursor_to_end(rtu->map, &rtu->cursor);
	rtu->ended_next = rtu->input_count;
}

static void count_losses(struct openrtu *rtu)
{
	if (rtu->cursor.lost == rtu->events_lost)
		return;
	map_count_lost_events(rtu->map, rtu->cursor.lost - rtu->events_lost);
	rtu->events_lost = rtu->cursor.lost;
}

/* Inputs are in the order of the map. -1: it reads no such point. */
static int input_of(const struct openrtu *rtu, uint32_t map_point)
{
	uint32_t low = 0, high = rtu->input_count;

	while (low < high) {
		uint32_t middle = low + (high - low) / 2;

		if (rtu->points[middle] < map_point)
			low = middle + 1;
		else
			high = middle;
	}
	return low < rtu->input_count && rtu->points[low] == map_point ? (int)low : -1;
}

static struct openrtu_event event_of(const struct openrtu *rtu, int point, const struct map_sample *sample)
{
	return (struct openrtu_event){
	    .point = point,
	    .sample = {.value = value_number(type_of(rtu, point), sample->value),
		       .time_ns = sample->time_ns,
		       .quality = sample->quality},
	};
}

/* When a module ends, each of its points has an event that says so, with the value that it had when this scan began. */
static bool next_of_ended(struct openrtu *rtu, struct openrtu_event *out)
{
	while (rtu->ended_next < rtu->input_count) {
		const uint32_t input = rtu->ended_next++;
		struct map_sample sample = rtu->samples[input];

		if (map_owner(rtu->map, rtu->points[input]) != rtu->ended)
			continue;
		sample.quality |= MAP_INVALID;
		sample.time_ns = rtu->ended_ns;
		*out = event_of(rtu, (int)input, &sample);
		return true;
	}
	return false;
}

static bool take(struct openrtu *rtu, struct map_event *out)
{
	if (rtu->events_taken >= RECORDS_A_SCAN || !map_event_next(rtu->map, &rtu->cursor, out))
		return false;
	rtu->events_taken++;
	return true;
}

bool openrtu_event_next(struct openrtu *rtu, struct openrtu_event *out)
{
	struct map_event event;

	if (next_of_ended(rtu, out))
		return true;
	while (take(rtu, &event)) {
		int point = event.kind == MAP_EVENT_CHANGE && event.time == MAP_TIME_MONOTONIC
				? input_of(rtu, event.point)
				: -1;

		if (event.kind == MAP_EVENT_MODULE_DOWN) {
			rtu->ended = event.point;
			rtu->ended_ns = event.sample.time_ns;
			rtu->ended_next = 0;
			if (next_of_ended(rtu, out))
				return true;
		}
		if (point < 0)
			continue;
		*out = event_of(rtu, point, &event.sample);
		out->past = event.past;
		return true;
	}
	count_losses(rtu);
	return false;
}

uint32_t openrtu_events_lost(const struct openrtu *rtu)
{
	return rtu->events_lost;
}
