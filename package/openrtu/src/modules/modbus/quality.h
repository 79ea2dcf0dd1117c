/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The quality of a process's points: what their own reading says, and what status bits of the device say of other
 * points of the same device. A status bit comes with another request than what it is about, so what is published of
 * one read may concern points beyond it.
 *
 * A bit that is ON makes its BL, SB or NT; a bit that is itself not good makes NT, since nobody knows. An invalid
 * value is invalid, and nothing else is said of it.
 */
#ifndef OPENRTU_MODULES_MODBUS_QUALITY_H
#define OPENRTU_MODULES_MODBUS_QUALITY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "map/map.h"
#include "modbus/config.h"

struct quality_of_point {
	uint8_t own;       /* enum map_quality: what its own reading gave it */
	uint8_t published; /* the last one published */
	bool on;           /* of a single point */
	bool updated;      /* among the updates being completed */
};

struct quality {
	struct map *map;
	const struct modbus_point *wire;
	struct quality_of_point *points; /* all of the configuration's */
	bool with_status;                /* some point names a status bit: most configurations have none */
};

/* No point has been read yet. points: room for all of the configuration's, the caller's. */
void quality_init(struct quality *quality, struct map *map, struct quality_of_point *points);

/*
 * The update that leaves a point the value it has, which is no longer read: how is MAP_INVALID, or MAP_NOT_TOPICAL for
 * one that is still true as far as is known. What is invalid stays so.
 */
struct map_update quality_lost(const struct quality *quality, uint32_t point, enum map_quality how,
			       int64_t now_ns);

/*
 * Completes updates of one device before they are published together: adds what status bits say to their quality, and
 * behind them an update of each other point of which status bits now say something else. updates: room for all of the
 * device's points. Returns how many there are then.
 */
size_t quality_complete(struct quality *quality, const struct map_set *device, struct map_update *updates,
			size_t count, int64_t now_ns);

#endif
