/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A ring of records with one writer and any number of readers, each with its own position. The writer
 * never waits: what a reader has not taken in time is overwritten, and the reader learns how much.
 *
 * A record becomes visible when the head moves, so a writer killed inside ring_put leaves no half record.
 */
#ifndef OPENRTU_MAP_RING_H
#define OPENRTU_MAP_RING_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/*
 * Where a ring lies. Capacity and record size come from the configuration, never from the writer's segment: a
 * writer gone wild cannot make a reader look outside.
 */
struct ring {
	_Atomic uint32_t *head; /* records ever written, modulo 2^32 */
	uint8_t *records;
	uint32_t capacity; /* a power of two */
	uint32_t record_size;
};

/* Bytes of a ring: a head in a cache line of its own, then the records. */
size_t ring_size(uint32_t capacity, uint32_t record_size);
struct ring ring_at(void *memory, uint32_t capacity, uint32_t record_size);

uint32_t ring_head(const struct ring *ring);
void ring_put(const struct ring *ring, const void *record);

/*
 * Copies the record at *next into record. False: there is none yet. When the writer has overwritten
 * it, *next moves to the oldest one left and *lost grows by what was skipped. Does not move past the record.
 */
bool ring_peek(const struct ring *ring, uint32_t *next, void *record, uint32_t *lost);

#endif
