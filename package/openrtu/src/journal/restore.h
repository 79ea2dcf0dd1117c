/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_JOURNAL_RESTORE_H
#define OPENRTU_JOURNAL_RESTORE_H

#include "map/supervise.h"

struct journal_findings {
	uint32_t records;        /* that are whole, one behind the other from the beginning */
	size_t unread;           /* bytes behind them: torn by the power cut, or broken */
	uint32_t unknown;        /* events of points that are not configured, or otherwise */
	uint32_t dropped;        /* retained points that are not retained now, or otherwise */
	uint32_t dropped_values; /* of modules, that nobody retains now */
};

/*
 * Reads a journal's file, which may be anything, for the configuration of this map. Gives what its whole records say:
 * the events that a queue of now has not acknowledged, the queues, the points and values that were retained and are, and the history. False:
 * out of memory. journal_forget frees what it has, in any case.
 */
bool journal_restore(const struct map *map, const uint8_t *bytes, size_t size, struct map_kept *kept,
		     struct journal_findings *findings);
void journal_forget(struct map_kept *kept);

#endif
