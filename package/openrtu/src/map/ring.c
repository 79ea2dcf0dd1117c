/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/ring.h"

#include <string.h>

#define HEAD_SIZE  32 /* a cache line of the ARM926 */
#define RING_TRIES 16 /* a try fails only when the writer went once around the ring within one copy */

size_t ring_size(uint32_t capacity, uint32_t record_size)
{
	return HEAD_SIZE + (size_t)capacity * record_size;
}

struct ring ring_at(void *memory, uint32_t capacity, uint32_t record_size)
{
	return (struct ring){
	    .head = memory,
	    .records = (uint8_t *)memory + HEAD_SIZE,
	    .capacity = capacity,
	    .record_size = record_size,
	};
}

uint32_t ring_head(const struct ring *ring)
{
	return atomic_load_explicit(ring->head, memory_order_acquire);
}

static uint8_t *ring_slot(const struct ring *ring, uint32_t number)
{
	return ring->records + (size_t)(number & (ring->capacity - 1)) * ring->record_size;
}

void ring_put(const struct ring *ring, const void *record)
{
	uint32_t head = atomic_load_explicit(ring->head, memory_order_relaxed);

	memcpy(ring_slot(ring, head), record, ring->record_size);
	atomic_store_explicit(ring->head, head + 1, memory_order_release);
	/* The next record overwrites the oldest: the head must be seen before that. */
	atomic_thread_fence(memory_order_release);
}

/* The writer may be filling the slot of record head - capacity, so the oldest whole one is the next. */
static void ring_skip_overwritten(const struct ring *ring, uint32_t head, uint32_t *next, uint32_t *lost)
{
	uint32_t behind = head - *next;

	if (behind >= ring->capacity) {
		*lost += behind - (ring->capacity - 1);
		*next = head - (ring->capacity - 1);
	}
}

bool ring_peek(const struct ring *ring, uint32_t *next, void *record, uint32_t *lost)
{
	uint32_t head = ring_head(ring);

	ring_skip_overwritten(ring, head, next, lost);
	for (int tries = 0; *next != head && tries < RING_TRIES; tries++) {
		uint32_t taken = *next;

		memcpy(record, ring_slot(ring, taken), ring->record_size);
		atomic_thread_fence(memory_order_acquire);
		head = atomic_load_explicit(ring->head, memory_order_relaxed);
		ring_skip_overwritten(ring, head, next, lost);
		if (*next == taken)
			return true;
	}
	return false;
}
