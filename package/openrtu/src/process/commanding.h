/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A command of another module's point, from its request to its end, with the ten states and the device's real answer. */
#ifndef OPENRTU_PROCESS_COMMANDING_H
#define OPENRTU_PROCESS_COMMANDING_H

#include "map/map.h"

struct commanding {
	enum { COMMANDING_IDLE, COMMANDING_SELECTING, COMMANDING_EXECUTING, COMMANDING_ENDED } phase;
	uint8_t state;       /* enum map_command_state */
	uint8_t result;      /* enum map_command_result */
	uint8_t detail;      /* the device's exception */
	uint32_t id;         /* of the request that is open */
	uint32_t generation; /* of the owner that it went to */
	struct map_request request;
};

static inline bool commanding_is_open(const struct commanding *command)
{
	return command->phase == COMMANDING_SELECTING || command->phase == COMMANDING_EXECUTING;
}

/*
 * Posts a request for command->request.point and .value, which the caller has set with .session; with select, a selection first,
 * which the execution follows by itself. Nothing is posted to an owner that does not live.
 */
void commanding_begin(struct map *map, struct commanding *command, bool select, int64_t now_ns);
/* Ends it without a request, or whatever became of it. */
void commanding_end(struct commanding *command, enum map_command_state state, enum map_command_result result);
/* What was said since the last time: answers to any of them, and owners that have gone. */
void commanding_take_answers(struct map *map, struct commanding *commands, size_t count, int64_t now_ns);
/* Forgets what has ended. */
void commanding_reset(struct commanding *command);

#endif
