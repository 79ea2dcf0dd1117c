/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What rtu-iec104 keeps in its segment: event queues, which outlive connections and the process, and counters.
 *
 * An event queue is a place in the modules' event rings, which is moved when a controlling station has acknowledged.
 * The first MAP_NAMED_QUEUES_MAX are for named queues of the configuration, of redundancy groups; those behind belong to
 * addresses without a group.
 * All is written by rtu-iec104 alone and may be read by anyone.
 */
#ifndef OPENRTU_MAP_STATION_H
#define OPENRTU_MAP_STATION_H

#include <stdatomic.h>

#include "map/map.h"

#define MAP_STATION_CONNECTIONS 16
#define MAP_QUEUES              (MAP_NAMED_QUEUES_MAX + 24) /* each started connection has one; the rest are remembered */
#define MAP_PEER_SIZE           64

/* ---- event queues ------------------------------------------------------------------------ */

struct map_queue_place {
	struct map_cursor cursor;    /* the first event that is not acknowledged; lost is not used */
	uint32_t refresh_all;        /* the current values of all points are owed besides, */
	map_modules refresh_modules; /* or those of these modules */
};

struct map_queue {
	char name[MAP_ADDRESS_SIZE]; /* of the group, or an address; empty: the queue is free */
	uint32_t limit;              /* events that may wait */
	uint32_t waiting;            /* events not acknowledged */
	uint32_t unacknowledged;     /* of these, those that were sent */
	uint32_t lost;               /* events dropped unacknowledged because more than limit waited; wraps */
	uint32_t used;               /* the turn in which it was last taken or left: larger is later */
};

/* The named queue in this slot; NULL: there is none. */
static inline const struct map_queue_plan *map_queue_plan(const struct map_settings *settings, unsigned slot)
{
	for (unsigned i = 0; i < settings->queue_count; i++)
		if (settings->queues[i].slot == slot)
			return &settings->queues[i];
	return NULL;
}

/* How many events may wait in it. */
static inline uint32_t map_queue_limit(const struct map_settings *settings, unsigned slot)
{
	const struct map_queue_plan *plan = map_queue_plan(settings, slot);

	return plan != NULL ? plan->limit : settings->event_ring - 1;
}
/* What is known of a queue: its place's and counters' state now. slot < MAP_QUEUES. */
void map_queue(const struct map *map, unsigned slot, struct map_queue *out);
/* A queue's place. One that cannot be, as a crash or another's mistake leaves it, becomes the end, and all is owed. */
void map_queue_place(const struct map *map, unsigned slot, struct map_queue_place *out);

/* ---- of the own segment, for rtu-iec104 */

/*
 * Names a named queue's place after what the configuration has there: one that had another name begins anew, at this place.
 * Until then it is no queue.
 */
void map_queue_adopt(struct map *map, unsigned slot, const struct map_queue_place *anew);
/* Gives a queue behind the groups' to an address, empty and at this place. */
void map_queue_assign(struct map *map, unsigned slot, const char *address,
		      const struct map_queue_place *place);
/* Takes a queue from its address: it is free. */
void map_queue_free(struct map *map, unsigned slot);
/* Moves a queue to a place: whoever reads it, after a crash too, finds the one before or this one. */
void map_queue_move(struct map *map, unsigned slot, const struct map_queue_place *place);
/* Notes that the queue was taken or left now. */
void map_queue_use(struct map *map, unsigned slot);
void map_queue_count_lost(struct map *map, unsigned slot, uint32_t events);
void map_queue_set_unacknowledged(struct map *map, unsigned slot, uint32_t events);

#endif
