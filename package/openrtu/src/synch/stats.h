/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What rtu-synch keeps in the section of its own: the state, which outlives its process, and what it shows. */
#ifndef OPENRTU_SYNCH_STATS_H
#define OPENRTU_SYNCH_STATS_H

#include "map/latch.h"
#include "map/map.h"
#include "synch/coordinator.h"

#define SYNCH_KIND "synch"

_Static_assert(SYNCH_PARTICIPANTS_MAX == MAP_SYNCH_WORDS, "a word each");

struct synch_stats {
	map_latch latch;
	uint32_t reserved;
	struct synch_state copies[2];
	/* Shown, each singly. */
	_Atomic uint32_t firings[SYNCH_TRANSITIONS_MAX];
	_Atomic uint32_t lost[SYNCH_PLACES_MAX];
	_Atomic uint32_t left_out[SYNCH_PARTICIPANTS_MAX], deaths[SYNCH_PARTICIPANTS_MAX],
	    stood_in[SYNCH_PARTICIPANTS_MAX];
	_Atomic uint32_t refused;
	_Atomic uint32_t waits_for[SYNCH_PARTICIPANTS_MAX]; /* 1 + transition; 0: it waits for nothing */
	_Atomic uint32_t since_ms[SYNCH_PARTICIPANTS_MAX];  /* low 32 bits of CLOCK_MONOTONIC */
};

/* NULL: there is no net. */
static inline struct synch_stats *synch_stats_of(const struct map *map)
{
	const uint32_t module = map_module_of_kind(map, SYNCH_KIND);

	return module == MAP_NONE ? NULL : map_section(map, module, sizeof(struct synch_stats));
}

/* Owner: the first size octets of the state. */
static inline void synch_store(struct synch_stats *stats, const struct synch_state *state, size_t size)
{
	latch_store_part(&stats->latch, stats->copies, state, size, sizeof(*state));
}

/* The answer to a participant. A state is stored more often than a reader tries only by a coordinator gone wild: 0 then. */
static inline uint32_t synch_answer_in(struct synch_stats *stats, uint32_t participant)
{
	for (int tries = 0; tries < LATCH_TRIES; tries++) {
		const uint32_t sequence = latch_read_begin(&stats->latch);
		const uint32_t answer = stats->copies[sequence & 1].answers[participant];

		if (latch_read_done(&stats->latch, sequence))
			return answer;
	}
	return 0;
}

#endif
