/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * How many lines a log takes. What others do can make a line, and they may do it without end; rtud prints the lines, above the
 * priority of the Modbus lines, to where they may fill a disk.
 */
#ifndef OPENRTU_MAP_LINES_H
#define OPENRTU_MAP_LINES_H

#include <stdbool.h>
#include <stdint.h>

#include "map/time_ns.h"

struct map_pace {
	int64_t period_ns;
	int64_t at_once;
};

/* Begins with zeros. */
struct map_lines {
	int64_t paid_ns;   /* each line moves it on; far in the future, lines are left out */
	uint32_t withheld; /* lines left out; to be told, and the owner's to set to 0 */
};

/* There is room for one more line now. */
static inline bool map_lines_room(const struct map_lines *lines, struct map_pace pace, int64_t now_ns)
{
	return lines->paid_ns <= now_ns + (pace.at_once - 1) * pace.period_ns;
}

/* A line wants to be written: true, or it is counted as withheld. */
static inline bool map_lines_take(struct map_lines *lines, struct map_pace pace, int64_t now_ns)
{
	if (!map_lines_room(lines, pace, now_ns)) {
		lines->withheld++;
		return false;
	}
	lines->paid_ns = later(lines->paid_ns, now_ns) + pace.period_ns;
	return true;
}

#endif
