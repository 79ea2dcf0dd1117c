/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A module's side of the net: what it asks of the coordinator, and whether that has answered. Nothing here waits. */
#ifndef OPENRTU_SYNCH_SYNCHED_H
#define OPENRTU_SYNCH_SYNCHED_H

#include "map/map.h"
#include "synch/net.h"
#include "synch/words.h"

struct synch_stats;

struct synched {
	struct map *map;
	struct synch_stats *stats; /* NULL: the net, if there is one, has no place for this module */
	struct synch_net net;
	uint32_t number; /* of the participant */
	uint32_t word;   /* as it was said last; of a line, its scans */
	bool met;        /* a word of this process was answered */
	bool open;       /* a scan is under way of which the coordinator is to hear the end */
};

/* name: of the participant. Says that a process has begun. */
void synched_begin(struct synched *synched, struct map *map, const char *name);

static inline bool synched_takes_part(const struct synched *synched)
{
	return synched->stats != NULL;
}

/* Its scans begin when the net lets them. */
bool synched_waits(const struct synched *synched);
/* Asks; the answer of a word before must be there, or is no longer wanted. */
void synched_ask_begin(struct synched *synched);
void synched_ask(struct synched *synched, uint8_t transition, bool blocking);
/* Asks for the end of the scan. False: the coordinator need not hear of it. */
bool synched_ask_end(struct synched *synched);
/* The answer to what was asked last; SYNCH_OPEN: there is none yet. */
enum synch_result synched_answer(struct synched *synched);
/* A line has ended a scan, and waits for no answer. */
void synched_ended(struct synched *synched);

#endif
