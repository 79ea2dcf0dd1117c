/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A history: changes of points in one order, each with a number, which a module keeps in its own section for readers that come back
 * to where they were. It outlives the module's process, and a power cut by the journal, which knows it from here. Of one
 * module in a map.
 */
#ifndef OPENRTU_MAP_HISTORY_H
#define OPENRTU_MAP_HISTORY_H

#include "map/map.h"

#define MAP_HISTORY_READER_SIZE 176u

/* A change. */
struct map_history_entry {
	_Atomic uint32_t number; /* written last; another one: this entry is no more, or not yet */
	uint32_t point;
	uint32_t start; /* of the numbers, when it was added */
	uint8_t reason; /* its keeper's */
	uint8_t time;   /* enum map_event_time */
	uint16_t reserved;
	int64_t
	    noted_ns; /* when it happened, by the clock of the sample's time: of another thing than the value, not with it */
	struct map_sample sample;
};

/* What its keeper remembers of a reader. */
struct map_history_reader {
	uint32_t used;                                            /* 0: nobody has ever used it */
	_Alignas(8) uint32_t octets[MAP_HISTORY_READER_SIZE / 4]; /* its keeper's */
};

/* Which events became entries, and the number of the next one: both move in one step. */
struct map_history_place {
	struct map_cursor cursor;
	uint32_t next;
};

struct map_history_head {
	uint32_t
	    start; /* another one for each time that the numbers have a gap; 0: nothing is kept by this gateway yet */
	uint32_t revision; /* of what the keeper has made of the points */
	uint32_t former;   /* the start before, of entries that the journal has kept; 0: there was none */
	uint32_t first;    /* the number with which start began */
	_Atomic uint32_t which;
	struct map_history_place places[2];
};

/* Where it lies. */
struct map_history {
	struct map_history_head *head;
	struct map_history_reader *readers;
	struct map_history_entry *entries;
	uint32_t reader_count;
	uint32_t size; /* of entries: a power of two */
};

#define MAP_HISTORY_ALIGNED(size) (((size) + 7u) & ~(size_t)7u)

/* Octets that it takes. */
static inline size_t map_history_size(uint32_t readers, uint32_t entries)
{
	return MAP_HISTORY_ALIGNED(sizeof(struct map_history_head)) +
	       MAP_HISTORY_ALIGNED(readers * sizeof(struct map_history_reader)) +
	       entries * sizeof(struct map_history_entry);
}

static inline struct map_history map_history_at(void *memory, uint32_t readers, uint32_t entries)
{
	uint8_t *octets = memory;
	struct map_history history = {.head = memory, .reader_count = readers, .size = entries};

	octets += MAP_HISTORY_ALIGNED(sizeof(struct map_history_head));
	history.readers = (void *)octets;
	octets += MAP_HISTORY_ALIGNED(readers * sizeof(struct map_history_reader));
	history.entries = (void *)octets;
	return history;
}

/* The place that its keeper has settled. */
static inline const struct map_history_place *map_history_place(const struct map_history *history)
{
	return &history->head->places[atomic_load_explicit(&history->head->which, memory_order_acquire) & 1];
}

/* The module that keeps one, as its plan says; MAP_NONE: none does. */
uint32_t map_history_keeper(const struct map *map);
/* False: nobody keeps one. For others than its keeper it is read-only, and may change as one looks. */
bool map_history(const struct map *map, struct map_history *out);
/* For others than its keeper: copies an entry. False: it is not there, or changes now. */
bool map_history_read(const struct map_history *history, uint32_t number, struct map_history_entry *out);

#endif
