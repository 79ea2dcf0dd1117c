/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Commands of points, carried to the outstation whose they are. One that was sent is never sent again: what is not confirmed
 * and terminated is negative, and of unknown fate if its connection has ended. The outstation ends pulses itself.
 */
#ifndef OPENRTU_MODULES_IEC104M_COMMANDS_H
#define OPENRTU_MODULES_IEC104M_COMMANDS_H

#include "iec104/controlling.h"
#include "modules/iec104m/values.h"

struct command {
	uint32_t request; /* of the connection; 0: none */
	uint32_t point;
	uint8_t cause; /* enum map_cause, of what comes of it */
	bool confirmed;
	int64_t deadline_ns; /* it is not executed later */
};

struct commands {
	struct map *map;
	const struct values *values;
	struct iec104_outstation_stats *stats;
	struct command open[IEC104_CONTROLLING_REQUESTS_MAX];
};

void commands_init(struct commands *commands, struct map *map, const struct values *values,
		   struct iec104_outstation_stats *stats);

/* Carries out a request that the map's state machine has let through. controlling: NULL without data transfer. */
void commands_execute(struct commands *commands, struct iec104_controlling *controlling,
		      const struct map_request *request, struct iec104_moment now);
/* A request of the connection has gone on. */
void commands_progress(struct commands *commands, struct iec104_controlling *controlling,
		       const struct iec104_controlling_request *request, struct iec104_moment now);
/* Whose command an object's return information comes of: as it says itself, unless one is under way here. */
enum map_cause commands_cause(const struct commands *commands, uint32_t point, uint8_t cause);

#endif
