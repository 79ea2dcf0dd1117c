/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "centre/deadlines.h"

#include <stdlib.h>

bool centre_deadlines_init(struct centre_deadlines *deadlines, uint32_t count)
{
	deadlines->count = count;
	deadlines->due_ns = calloc(count, sizeof(*deadlines->due_ns));
	deadlines->order = calloc(count, sizeof(*deadlines->order));
	deadlines->place = calloc(count, sizeof(*deadlines->place));
	if (deadlines->due_ns == NULL || deadlines->order == NULL || deadlines->place == NULL)
		return false;
	for (uint32_t i = 0; i < count; i++) {
		deadlines->due_ns[i] = INT64_MAX;
		deadlines->order[i] = deadlines->place[i] = i;
	}
	return true;
}

void centre_deadlines_free(struct centre_deadlines *deadlines)
{
	free(deadlines->due_ns);
	free(deadlines->order);
	free(deadlines->place);
}

static void put(struct centre_deadlines *deadlines, uint32_t place, uint32_t station)
{
	deadlines->order[place] = station;
	deadlines->place[station] = place;
}

static int64_t due_at(const struct centre_deadlines *deadlines, uint32_t place)
{
	return deadlines->due_ns[deadlines->order[place]];
}

static uint32_t rise(struct centre_deadlines *deadlines, uint32_t place, int64_t due_ns)
{
	for (uint32_t above; place > 0; place = above) {
		above = (place - 1) / 2;
		if (due_at(deadlines, above) <= due_ns)
			break;
		put(deadlines, place, deadlines->order[above]);
	}
	return place;
}

static uint32_t sink(struct centre_deadlines *deadlines, uint32_t place, int64_t due_ns)
{
	for (uint32_t below; (below = 2 * place + 1) < deadlines->count; place = below) {
		if (below + 1 < deadlines->count && due_at(deadlines, below + 1) < due_at(deadlines, below))
			below++;
		if (due_at(deadlines, below) >= due_ns)
			break;
		put(deadlines, place, deadlines->order[below]);
	}
	return place;
}

void centre_deadlines_set(struct centre_deadlines *deadlines, uint32_t station, int64_t due_ns)
{
	int64_t before_ns = deadlines->due_ns[station];
	uint32_t place = deadlines->place[station];

	if (due_ns == before_ns)
		return;
	place = due_ns < before_ns ? rise(deadlines, place, due_ns) : sink(deadlines, place, due_ns);
	put(deadlines, place, station);
	deadlines->due_ns[station] = due_ns;
}

uint32_t centre_deadlines_first(const struct centre_deadlines *deadlines)
{
	return deadlines->order[0];
}
