/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A line process that was silent for longer than readers wait for it has old values: its heartbeat would make them good. So it
 * reads them again before it beats. What it cannot read in that time is told as not topical.
 */
#ifndef OPENRTU_MODULES_MODBUS_REFRESH_H
#define OPENRTU_MODULES_MODBUS_REFRESH_H

#include <stdbool.h>
#include <stdint.h>

#include "map/map.h"
#include "modules/modbus/line_results.h"

#define REFRESH_NS (500 * NS_PER_MS) /* the longest that a heartbeat waits for reads */

/* Filled in by the caller. */
struct refresh {
	struct map *map;
	struct line_results *lines;
	uint32_t line_count;
	int64_t until_ns; /* 0: none is under way */
	int64_t back_ns;  /* when this process was last back */
};

/* Whether the heartbeat has to wait, the last one having been at beaten_ns. Asked before each. */
bool refresh_holds(struct refresh *refresh, int64_t beaten_ns, int64_t now_ns);

#endif
