/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "journal/wear.h"

#define DAY_S       86400u
#define YEAR_DAYS   365.25
#define AROUND      16384u /* what a record costs besides: blocks begun, pages filled up, inode, log, folder */
#define MOVED_AGAIN 2u     /* the file system's garbage collection, UBI's wear levelling */

uint64_t journal_bytes_a_day(const struct journal_settings *journal)
{
	return (uint64_t)MOVED_AGAIN * (journal_record_max(journal) + AROUND) * DAY_S / journal->interval_s;
}

double journal_life_years(const struct journal_settings *journal)
{
	return (double)journal->volume_mb * 1048576 * journal->cycles / (double)journal_bytes_a_day(journal) /
	       YEAR_DAYS;
}
