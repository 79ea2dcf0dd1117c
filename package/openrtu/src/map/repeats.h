/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What happens again and again, in the log: it is said when it happens. While it goes on, it is counted, and said with the count
 * after 10 s, 20 s and so on, at last once an hour. When it has not happened for an hour, it begins anew.
 */
#ifndef OPENRTU_MAP_REPEATS_H
#define OPENRTU_MAP_REPEATS_H

#include <stdbool.h>
#include <stdint.h>

#include "map/time_ns.h"

#define MAP_REPEATS_FIRST_NS (10 * NS_PER_S)
#define MAP_REPEATS_MOST_NS  (S_PER_HOUR * NS_PER_S)

/* Begins with zeros. */
struct map_repeats {
	int64_t due_ns;   /* the next line at the earliest */
	int64_t pause_ns; /* between the last line and that; 0: nothing is remembered */
	int64_t last_ns;  /* when it happened last */
	uint32_t unsaid;  /* how often since the last line */
};

/* It was long ago that it happened. */
static inline bool map_repeats_are_over(const struct map_repeats *repeats, int64_t now_ns)
{
	return repeats->pause_ns != 0 && now_ns - repeats->last_ns >= MAP_REPEATS_MOST_NS;
}

/* So often it happened since the last line, if there is to be one now; else 0. */
static inline uint32_t map_repeats_due(struct map_repeats *repeats, int64_t now_ns)
{
	const uint32_t times = repeats->unsaid;

	if (times == 0 || (repeats->pause_ns != 0 && now_ns < repeats->due_ns))
		return 0;
	repeats->pause_ns = repeats->pause_ns == 0 ? MAP_REPEATS_FIRST_NS
						   : earlier(2 * repeats->pause_ns, MAP_REPEATS_MOST_NS);
	repeats->due_ns = now_ns + repeats->pause_ns;
	repeats->unsaid = 0;
	return times;
}

/* It happened so often: as map_repeats_due. */
static inline uint32_t map_repeats_happened(struct map_repeats *repeats, uint32_t times, int64_t now_ns)
{
	if (map_repeats_are_over(repeats, now_ns) && repeats->unsaid == 0)
		*repeats = (struct map_repeats){.pause_ns = 0};
	repeats->last_ns = now_ns;
	repeats->unsaid += times;
	return map_repeats_due(repeats, now_ns);
}

#endif
