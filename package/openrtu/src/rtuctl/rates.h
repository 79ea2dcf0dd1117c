/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How fast counters of the map go, and how much of a core its processes take: from two looks at them. */
#ifndef OPENRTU_RTUCTL_RATES_H
#define OPENRTU_RTUCTL_RATES_H

#include <stdint.h>

#include "map/map.h"

struct rates_line {
	uint32_t requests, errors; /* as counted */
	double requests_s, errors_s;
};

struct rates {
	const struct map *map;
	int64_t at_ns; /* the last look; 0: none yet */
	struct map_cursor cursor;
	struct rates_line *lines; /* of each Modbus port */
	double events_s;
	struct {
		int32_t pid;
		uint64_t ticks;
		double cpu_percent; /* of one core; negative: not known */
	} modules[MAP_MODULES_MAX];
};

/* The first look: rates are known after the second. */
void rates_begin(struct rates *rates, const struct map *map);
/* Looks once more. */
void rates_look(struct rates *rates);
void rates_end(struct rates *rates);

#endif
