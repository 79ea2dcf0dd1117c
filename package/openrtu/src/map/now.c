/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What time it is, and what time it was when the caller's loop began its cycle. */
#include <time.h>

#include "map/layout.h"
#include "map/time_ns.h"

int64_t map_now_ns(void)
{
	struct timespec now;

	clock_gettime(CLOCK_MONOTONIC, &now);
	return (int64_t)now.tv_sec * NS_PER_S + now.tv_nsec;
}

static uint32_t ms_of(int64_t time_ns)
{
	return (uint32_t)(time_ns / NS_PER_MS);
}

uint32_t now_ms(void)
{
	return ms_of(map_now_ns());
}

uint32_t now_s(void)
{
	return (uint32_t)(map_now_ns() / NS_PER_S);
}

int64_t map_begin_cycle(struct map *map)
{
	map->cycle_ns = map_now_ns();
	map->cycle_ms = ms_of(map->cycle_ns);
	return map->cycle_ns;
}

/*
 * What was past when the cycle began needs no look at the clock. An outstation's event may be of before this machine's start,
 * where its clock was below 0.
 */
bool is_past(const struct map *map, int64_t time_ns)
{
	return time_ns >= -MAP_PAST_DAYS * S_PER_DAY * NS_PER_S &&
	       (time_ns <= map->cycle_ns || time_ns <= map_now_ns());
}
