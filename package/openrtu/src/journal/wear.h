/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * How long the flash lives with a journal that writes as much as it may, always. docs/telecontrol.md has the
 * derivation.
 */
#ifndef OPENRTU_JOURNAL_WEAR_H
#define OPENRTU_JOURNAL_WEAR_H

#include <stdint.h>

#include "journal/config.h"

#define JOURNAL_LIFE_YEARS 10 /* less is refused */

/* The largest record; four fit into the file, so that a file is not written anew with every other record. */
static inline uint32_t journal_record_max(const struct journal_settings *journal)
{
	return journal->size_kb * 1024 / 4;
}
/* Bytes that reach the flash in a day at most. */
uint64_t journal_bytes_a_day(const struct journal_settings *journal);
/* Until every block of the volume has been erased as often as it may be. */
double journal_life_years(const struct journal_settings *journal);

#endif
