/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A latch: two copies of something and a sequence. The writer fills one copy while readers take the
 * other, so a writer that is preempted, stopped or killed anywhere leaves a whole copy to read, and a
 * real-time reader above it on one core never spins (a plain sequence lock would).
 *
 * Even sequence: copy 0 is readable; odd: copy 1. One writer. The sequence has 32 bits because ARMv5
 * has no wider atomic.
 */
#ifndef OPENRTU_MAP_LATCH_H
#define OPENRTU_MAP_LATCH_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* ARMv5: GCC says 1 (sometimes), since they are lock-free through the kernel's helpers (CONFIG_KUSER_HELPERS). */
_Static_assert(ATOMIC_INT_LOCK_FREE != 0, "atomics in shared memory must be lock-free");

typedef _Atomic uint32_t map_latch;

/* Gives the copy that the writer may fill now: first copy 0, then copy 1 after latch_flip. */
static inline unsigned latch_flip(map_latch *latch)
{
	uint32_t sequence = atomic_load_explicit(latch, memory_order_relaxed) + 1;

	atomic_store_explicit(latch, sequence, memory_order_release);
	/* The sequence must be seen before what follows in the copy it takes from the readers. */
	atomic_thread_fence(memory_order_release);
	return (sequence & 1) ? 0 : 1;
}

/* The copy that is whole, whatever a former writer left half done. */
static inline unsigned latch_whole_copy(map_latch *latch)
{
	return atomic_load_explicit(latch, memory_order_relaxed) & 1;
}

/*
 * The first size octets of a record, into both copies of an array of two. A former writer that was killed left the copy that
 * is not whole torn: the first flip gives that one to the readers, so it is made whole before.
 */
static inline void latch_store_part(map_latch *latch, void *copies, const void *record, size_t size,
				    size_t record_size)
{
	uint8_t *whole = (uint8_t *)copies + latch_whole_copy(latch) * record_size;
	uint8_t *other = (uint8_t *)copies + !latch_whole_copy(latch) * record_size;

	memcpy(other, whole, size);
	for (int copy = 0; copy < 2; copy++)
		memcpy((uint8_t *)copies + latch_flip(latch) * record_size, record, size);
}

static inline void latch_store(map_latch *latch, void *copies, const void *record, size_t size)
{
	latch_store_part(latch, copies, record, size, size);
}

static inline uint32_t latch_read_begin(map_latch *latch)
{
	return atomic_load_explicit(latch, memory_order_acquire);
}

/* True when the copy (sequence & 1) was not touched since latch_read_begin gave that sequence. */
static inline bool latch_read_done(map_latch *latch, uint32_t sequence)
{
	atomic_thread_fence(memory_order_acquire);
	return atomic_load_explicit(latch, memory_order_relaxed) == sequence;
}

/*
 * How often a reader tries. A try fails only when the writer turned the latch within one copy of a few
 * bytes; writers publish at the pace of a serial line.
 */
#define LATCH_TRIES 64

/* Takes a record out of an array of two copies. False: the writer overtook every try, and out is of no use. */
static inline bool latch_load(map_latch *latch, const void *copies, void *out, size_t size)
{
	for (int tries = 0; tries < LATCH_TRIES; tries++) {
		uint32_t sequence = latch_read_begin(latch);

		memcpy(out, (const uint8_t *)copies + (sequence & 1) * size, size);
		if (latch_read_done(latch, sequence))
			return true;
	}
	return false;
}

#endif
