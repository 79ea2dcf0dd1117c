/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The records between the stations and the consumer: a ring of batches. One is filled; it is closed when it is full or sent. A
 * batch keeps its place until the consumer has acknowledged it.
 */
#ifndef OPENRTU_CENTRE_BATCHES_H
#define OPENRTU_CENTRE_BATCHES_H

#include <stdbool.h>
#include <stddef.h>

#include "centre/records.h"

struct centre_batches {
	uint8_t *memory;
	size_t batch_size; /* octets */
	uint32_t records;  /* a batch has at most */
	uint32_t slots;
	uint32_t in_flight_max;
	uint64_t acknowledged, sent; /* the last sequence of each */
	uint64_t filling;
};

/* slots: more than in_flight_max. False: no memory. */
bool centre_batches_init(struct centre_batches *batches, uint32_t slots, uint32_t records,
			 uint32_t in_flight_max);
void centre_batches_free(struct centre_batches *batches);
/* Empties it, for a new consumer. */
void centre_batches_reset(struct centre_batches *batches);
/* How many records can be added now. */
size_t centre_batches_room(const struct centre_batches *batches);
/* A new record, all zeros. There is room. */
struct centre_record *centre_batches_add(struct centre_batches *batches);
/* The batch to be sent next, *size octets; NULL: there is none, or in_flight_max are not acknowledged. */
const struct centre_batch *centre_batches_next(const struct centre_batches *batches, size_t *size);
/* That batch was sent. */
void centre_batches_sent(struct centre_batches *batches);
/*
 * The consumer has acknowledged all batches up to this one; calls released for each record with CENTRE_LAST. False, and nothing
 * happened: no such batch is unacknowledged.
 */
bool centre_batches_acknowledge(struct centre_batches *batches, uint64_t sequence,
				void (*released)(void *context, const struct centre_record *record),
				void *context);
/* Records that were added and not acknowledged. */
uint64_t centre_batches_open(const struct centre_batches *batches);

#endif
