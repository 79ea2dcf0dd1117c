/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What a module says to the coordinator, and how it is answered: a word each, stored at once, so that neither of them can die
 * within it. Words are counted: one is open until the answer has its number. A line, which waits for nobody, says how many scans it
 * has ended instead.
 */
#ifndef OPENRTU_SYNCH_WORDS_H
#define OPENRTU_SYNCH_WORDS_H

#include <stdbool.h>
#include <stdint.h>

enum synch_wish {
	SYNCH_HELLO, /* nothing yet: a process has begun */
	SYNCH_ASK,   /* fire the transition, when it is enabled */
	SYNCH_TRY,   /* fire it now or not at all */
	SYNCH_END,   /* the scan is over: fire the scan_end, if there is one, when it is enabled */
};

enum synch_result {
	SYNCH_OPEN,    /* not answered yet */
	SYNCH_FIRED,   /* or there was nothing to fire */
	SYNCH_NOT_NOW, /* SYNCH_TRY: it is not enabled */
	SYNCH_LATE,    /* the module was taken for dead, and the scan's tokens are no longer its own */
	SYNCH_REFUSED, /* the transition is not the module's */
};

#define SYNCH_NEW (1u << 12) /* no word of this process has been answered yet */

static inline uint32_t synch_word(uint16_t sequence, enum synch_wish wish, uint8_t transition)
{
	return (uint32_t)sequence << 16 | (uint32_t)wish << 8 | transition;
}

static inline enum synch_wish synch_wish_of(uint32_t word)
{
	return (enum synch_wish)(word >> 8 & 3u);
}

static inline uint8_t synch_transition_of(uint32_t word)
{
	return (uint8_t)word;
}

static inline uint32_t synch_answer_to(uint32_t word, enum synch_result result)
{
	return (word & 0xffff0000u) | result;
}

static inline bool synch_is_answered(uint32_t word, uint32_t answer)
{
	return word >> 16 == answer >> 16;
}

#endif
