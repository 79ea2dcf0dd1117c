/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Who may fire when: the marking, the wishes of the modules, and what becomes of the tokens of one that dies. Bytes and time are
 * arguments. All that an answer follows from is in one state, which the caller stores at once: a coordinator that is killed
 * anywhere leaves each wish open or answered, and never a half of it.
 */
#ifndef OPENRTU_SYNCH_COORDINATOR_H
#define OPENRTU_SYNCH_COORDINATOR_H

#include <stddef.h>

#include "synch/net.h"
#include "synch/words.h"

enum synch_phase {
	SYNCH_IDLE,
	SYNCH_SCANS, /* it has fired something in a scan that has not ended */
	SYNCH_LOST,  /* its scan was ended or undone in its stead; it may not know */
	SYNCH_HELD,  /* its process is gone, and the next one ends the scan */
	SYNCH_OWES,  /* its scan_end fires in its stead, as soon as it is enabled */
};

struct synch_state {
	uint32_t begun; /* 0: not even the marking of the start */
	uint16_t tokens[SYNCH_PLACES_MAX];
	uint32_t
	    answers[SYNCH_PARTICIPANTS_MAX]; /* synch_answer_to; of a line: the scans that were looked at */
	uint8_t phases[SYNCH_PARTICIPANTS_MAX];                    /* enum synch_phase */
	int16_t changes[SYNCH_PARTICIPANTS_MAX][SYNCH_PLACES_MAX]; /* that scans under way have made */
};

/* Of it that a net uses. */
static inline size_t synch_state_size(const struct synch_net *net)
{
	return offsetof(struct synch_state, changes) +
	       net->participant_count * SYNCH_PLACES_MAX * sizeof(int16_t);
}

/* What a participant says, and whether it lives. */
struct synch_seen {
	uint32_t word;
	bool alive;
};

/* 32-bit counters that wrap. */
struct synch_counts {
	uint32_t firings[SYNCH_TRANSITIONS_MAX];
	uint32_t lost[SYNCH_PLACES_MAX];           /* tokens that had no room */
	uint32_t left_out[SYNCH_PARTICIPANTS_MAX]; /* ends of a line's scans that could not fire */
	uint32_t deaths[SYNCH_PARTICIPANTS_MAX];   /* in a scan */
	uint32_t stood_in[SYNCH_PARTICIPANTS_MAX]; /* scans that were fired for a dead one */
	uint32_t refused;                          /* words that no module may say */
};

struct synch_coordinator {
	struct synch_net net;
	struct synch_state state;
	struct synch_counts counts;
	bool stands_in; /* for a dead module: its next scan is due soon */
	uint32_t rung;  /* a bit for each participant that was answered in this turn */
	/* Open words: since when, and in which order they came. */
	uint32_t open[SYNCH_PARTICIPANTS_MAX]; /* 0: none */
	uint32_t places[SYNCH_PARTICIPANTS_MAX];
	int64_t since_ns[SYNCH_PARTICIPANTS_MAX];
	uint32_t next_place;
	/* Scans that are fired for the dead do not run ahead of the living. */
	int64_t stood_ns[SYNCH_PARTICIPANTS_MAX];
	uint32_t fired; /* by the living */
	uint32_t stood_at[SYNCH_PARTICIPANTS_MAX];
};

/* state: as a former process of the coordinator has left it; one that never began is that of the start. */
void synch_begin(struct synch_coordinator *coordinator, const struct synch_net *net,
		 const struct synch_state *state);
/* Looks at all participants, and fires what can be. True: the state is another, to be stored before rung is. */
bool synch_turn(struct synch_coordinator *coordinator, const struct synch_seen *seen, int64_t now_ns);

#endif
