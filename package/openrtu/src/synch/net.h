/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A Petri net, by which modules wait for each other: places with tokens, transitions, arcs between them. The tables lie in the
 * configuration, or in the memory of who looks for what the net can do. Nothing here allocates.
 */
#ifndef OPENRTU_SYNCH_NET_H
#define OPENRTU_SYNCH_NET_H

#include <stdbool.h>
#include <stdint.h>

#include "map/config.h"

#define SYNCH_PLACES_MAX       64
#define SYNCH_TRANSITIONS_MAX  64
#define SYNCH_ARCS_MAX         512
#define SYNCH_PARTICIPANTS_MAX 32
#define SYNCH_POINTS_MAX       64
#define SYNCH_WEIGHT_MAX       255
#define SYNCH_TOKENS_MAX       65534     /* that a place can hold */
#define SYNCH_LABEL_SIZE       96        /* of a place that stands for an arrow: two names */
#define SYNCH_NOTHING          UINT8_MAX /* no transition */

struct synch_place {
	char name[SYNCH_LABEL_SIZE];
	uint16_t tokens; /* at the start */
	uint16_t
	    capacity; /* what would be more is lost; 0: SYNCH_TOKENS_MAX, and it should never be reached */
};

struct synch_transition {
	char name[SYNCH_LABEL_SIZE];
	uint16_t first_arc, arc_count; /* arcs are in the order of their transitions */
};

enum synch_arc_kind {
	SYNCH_TAKES,  /* from the place, which must have as many tokens */
	SYNCH_GIVES,  /* to the place */
	SYNCH_UNLESS, /* inhibitor: only while the place has none */
};

struct synch_arc {
	uint8_t kind; /* enum synch_arc_kind */
	uint8_t place, transition;
	uint8_t weight;
};

/* What becomes of the tokens that a module has taken in a scan, when it dies or hangs before that scan has ended. */
enum synch_death {
	SYNCH_RETURN, /* as if the scan had not begun */
	SYNCH_HOLD,   /* its next process has them, and ends the scan */
	SYNCH_FIRE,   /* as if the scan had ended; while it is dead, so do its further ones */
};

/* A module, or a line. */
struct synch_participant {
	char name[MAP_NAME_SIZE];
	uint16_t module;    /* its number in the map */
	uint8_t begin, end; /* transitions that its scan fires, or SYNCH_NOTHING */
	uint8_t on_death;   /* enum synch_death */
	uint8_t waits;      /* a line does not: what cannot fire when it ends a scan, is lost */
};

/* A synchronisation point: what a module fires by name within its scan. */
struct synch_point {
	char name[MAP_NAME_SIZE];
	uint8_t participant, transition;
	uint16_t reserved;
};

struct synch_net {
	uint32_t place_count, transition_count, arc_count, participant_count, point_count;
	const struct synch_place *places;
	const struct synch_transition *transitions;
	const struct synch_arc *arcs;
	const struct synch_participant *participants;
	const struct synch_point *points;
};

static inline uint16_t synch_capacity(const struct synch_place *place)
{
	return place->capacity ? place->capacity : SYNCH_TOKENS_MAX;
}

/* tokens: of each place. */
bool synch_enabled(const struct synch_net *net, const uint16_t *tokens, unsigned transition);
/*
 * Fires a transition that is enabled: all it takes, then all it gives. changes, unless NULL: by place, grows by what was given and
 * falls by what was taken. lost, unless NULL: by place, grows by the tokens that had no room.
 */
void synch_fire(const struct synch_net *net, uint16_t *tokens, unsigned transition, int16_t *changes,
		uint32_t *lost);
/* Takes such changes back, as far as the tokens are still there and have room. */
void synch_undo(const struct synch_net *net, uint16_t *tokens, const int16_t *changes);
/* Whether the transition is one that the participant's scans fire, or its points. */
bool synch_is_of(const struct synch_net *net, unsigned participant, unsigned transition);
/* The transition of a participant's point of that name; SYNCH_NOTHING: it has none. */
uint8_t synch_point_named(const struct synch_net *net, unsigned participant, const char *name);

#endif
