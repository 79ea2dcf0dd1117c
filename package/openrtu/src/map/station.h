/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What rtu-iec104 keeps in its segment: event queues, which outlive connections and the process, and counters.
 *
 * An event queue is a place in the modules' event rings, which is moved when a controlling station has acknowledged.
 * Queue i belongs to redundancy group i of the configuration; those behind belong to addresses without a group.
 * All is written by rtu-iec104 alone and may be read by anyone.
 */
#ifndef OPENRTU_MAP_STATION_H
#define OPENRTU_MAP_STATION_H

#include <stdatomic.h>

#include "map/map.h"

#define MAP_STATION_CONNECTIONS 16
#define MAP_QUEUES              (MAP_GROUPS_MAX + 24) /* each started connection has one; the rest are remembered */
#define MAP_PEER_SIZE           64
#define MAP_REFRESH_ALL         (1u << 31) /* beside a bit for each module, of which there are MAP_MODULES_MAX */

/* ---- event queues ------------------------------------------------------------------------ */

struct map_queue_place {
	struct map_cursor cursor; /* the first event that is not acknowledged; lost is not used */
	uint32_t refresh;         /* modules whose current values are owed besides, or MAP_REFRESH_ALL */
};

struct map_queue {
	char name[MAP_ADDRESS_SIZE]; /* of the group, or an address; empty: the queue is free */
	uint32_t limit;              /* events that may wait */
	uint32_t waiting;            /* events not acknowledged */
	uint32_t unacknowledged;     /* of these, those that were sent */
	uint32_t lost;               /* events dropped unacknowledged because more than limit waited; wraps */
	uint32_t used;               /* the turn in which it was last taken or left: larger is later */
};

/* How many events may wait in it. */
static inline uint32_t map_queue_limit(const struct map_settings *settings, unsigned slot)
{
	return slot < settings->group_count ? settings->groups[slot].queue : settings->event_ring - 1;
}
/* What is known of a queue: its place's and counters' state now. slot < MAP_QUEUES. */
void map_queue(const struct map *map, unsigned slot, struct map_queue *out);
/* A queue's place. One that cannot be, as a crash or another's mistake leaves it, becomes the end, and all is owed. */
void map_queue_place(const struct map *map, unsigned slot, struct map_queue_place *out);

/* ---- of the own segment, for rtu-iec104 */

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

/* ---- counters ---------------------------------------------------------------------------- */

/* The closings have the order of iec104/session.h, which checks it. */
enum map_station_counter {
	MAP_STATION_I_IN,
	MAP_STATION_S_IN,
	MAP_STATION_STARTDT_ACT_IN,
	MAP_STATION_STARTDT_CON_IN,
	MAP_STATION_STOPDT_ACT_IN,
	MAP_STATION_STOPDT_CON_IN,
	MAP_STATION_TESTFR_ACT_IN,
	MAP_STATION_TESTFR_CON_IN,
	MAP_STATION_I_OUT,
	MAP_STATION_S_OUT,
	MAP_STATION_STARTDT_ACT_OUT,
	MAP_STATION_STARTDT_CON_OUT,
	MAP_STATION_STOPDT_ACT_OUT,
	MAP_STATION_STOPDT_CON_OUT,
	MAP_STATION_TESTFR_ACT_OUT,
	MAP_STATION_TESTFR_CON_OUT,
	MAP_STATION_ACCEPTED,
	MAP_STATION_NOT_LISTED,
	MAP_STATION_TOO_MANY,
	MAP_STATION_BAD_APDU,
	MAP_STATION_BAD_ASDU,
	MAP_STATION_BAD_NS,
	MAP_STATION_BAD_NR,
	MAP_STATION_I_WHILE_STOPPED,
	MAP_STATION_T1_I_FRAME,
	MAP_STATION_T1_TESTFR,
	MAP_STATION_UNREAD_ANSWERS,
	MAP_STATION_TAKEN_OVER,
	MAP_STATION_GAVE_WAY,
	MAP_STATION_NOT_SECURE,
	MAP_STATION_CLOSED_BY_PEER,
	MAP_STATION_CLOSED_BY_STATION,
	MAP_STATION_UNKNOWN_TYPE,
	MAP_STATION_UNKNOWN_CAUSE,
	MAP_STATION_UNKNOWN_CA,
	MAP_STATION_UNKNOWN_IOA,
	MAP_STATION_NEGATIVE,
	MAP_STATION_ORIGINATOR,
	MAP_STATION_EVENTS_SENT,
	MAP_STATION_EVENTS_LOST,
	MAP_STATION_COUNTERS
};

/* Session numbers are those of IEC 60870-5-104, clause 5. */
struct map_connection_stats {
	char peer[MAP_PEER_SIZE];
	_Atomic uint32_t open;
	_Atomic uint32_t queue;   /* slot, MAP_NONE before the first STARTDT */
	_Atomic uint32_t since_s; /* CLOCK_MONOTONIC */
	_Atomic uint32_t started;
	_Atomic uint32_t next_ns, next_nr; /* V(S), V(R) */
	_Atomic uint32_t unacknowledged;   /* own I frames, at most k */
	_Atomic uint32_t owed;             /* received I frames not yet acknowledged, at most w */
};

/* The same, as others see it. */
struct map_connection {
	char peer[MAP_PEER_SIZE];
	uint32_t queue;
	int64_t since_ns;
	bool started;
	uint32_t next_ns, next_nr;
	uint32_t unacknowledged, owed;
};

struct map_station_stats {
	_Atomic uint32_t counters[MAP_STATION_COUNTERS]; /* since the gateway started; wrap at 2^32 */
	struct map_connection_stats connections[MAP_STATION_CONNECTIONS];
};

/* rtu-iec104: to count in. Others get the same memory read-only. */
struct map_station_stats *map_station_stats(const struct map *map);
/* A connection. False: there is none in this place. place < MAP_STATION_CONNECTIONS. */
bool map_connection(const struct map *map, unsigned place, struct map_connection *out);
/* A counter's name, as in "i_frames_in". */
const char *map_station_counter_name(enum map_station_counter counter);

/* Adds to a counter that this process alone writes; a plain store, since ARMv5 has no atomic addition. */
static inline void map_count(_Atomic uint32_t *counter, uint32_t by)
{
	atomic_store_explicit(counter, atomic_load_explicit(counter, memory_order_relaxed) + by,
			      memory_order_relaxed);
}

#endif
