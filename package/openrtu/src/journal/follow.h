/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Decides what the journal writes next: follows the events and the queues of the map, and remembers what it has written.
 * It reads no clock but the map's, and does no input or output.
 */
#ifndef OPENRTU_JOURNAL_FOLLOW_H
#define OPENRTU_JOURNAL_FOLLOW_H

#include "journal/record.h"

/* The content of a file: the queues, the retained points and values, and all events before heads that a queue wants. */
struct journal_content {
	uint32_t heads[MAP_MODULES_MAX];
	struct journal_queue queues[MAP_QUEUES];
	uint32_t queue_count;
	struct map_clock clock; /* by which its first record's times are wall times */
	uint32_t number;        /* of the next record */
	uint32_t digest;        /* what is retained, and the readers of the history, are: journal_builder */
	uint32_t start;         /* of the history; 0: nothing of one is in the file */
	uint32_t entry;         /* the number of the entry to be written next */
};

struct journal_follower {
	const struct map *map;
	struct journal_content written,
	    next; /* next: with the record that was made last, which may yet fail */
	struct journal_builder record;
	uint32_t left_out; /* events for which the record made last has no room */
	bool begun;        /* there is a file */
};

/* memory: for a record, of at least JOURNAL_QUEUES_SIZE bytes. */
void journal_follow(struct journal_follower *follower, const struct map *map, uint8_t *memory, size_t size);
/*
 * Makes the next record, in follower->record. False: the file is up to date. anew: make one in any case, as the first of a
 * new file. A record is also the first of a new file if none was begun, or if the clock was set since the last record.
 */
bool journal_make(struct journal_follower *follower, bool anew);
/* The record that was made begins a file. */
static inline bool journal_is_first(const struct journal_follower *follower)
{
	return follower->next.number == 1;
}
/* The record that was made is in the file. */
void journal_written(struct journal_follower *follower);
/* The file is useless: the next record begins a new one. */
void journal_abandon(struct journal_follower *follower);
/* How many events of the file somebody had not acknowledged when the last record was made. */
uint32_t journal_pending(const struct journal_follower *follower);

#endif
