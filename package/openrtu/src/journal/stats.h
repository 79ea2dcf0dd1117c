/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What rtu-journal shows of its work: the section of its own in its segment. */
#ifndef OPENRTU_JOURNAL_STATS_H
#define OPENRTU_JOURNAL_STATS_H

#include <stdatomic.h>

#include "map/map.h"

#define JOURNAL_KIND "journal"

/* Since the gateway started; they wrap. Written by rtu-journal. */
struct journal_stats {
	_Atomic uint32_t records;    /* written and synchronised */
	_Atomic uint32_t kib;        /* in these, rounded up one by one */
	_Atomic uint32_t failures;   /* records that could not be written */
	_Atomic uint32_t events;     /* in the file, that somebody has not acknowledged */
	_Atomic uint32_t left_out;   /* events for which a record had no room */
	_Atomic uint32_t written_s;  /* CLOCK_MONOTONIC, of the last record; 0: none */
	_Atomic uint32_t longest_ms; /* that a record took */
	_Atomic uint32_t failing;    /* 1: the last record could not be written */
	_Atomic uint32_t moved;      /* 1: another folder than the one that the former process wrote in */
};

#define JOURNAL_COUNTERS 7 /* of these, that have names for all: map_name_counter */

/* rtu-journal: names them. */
void journal_name_counters(struct map *map);
/* NULL: there is no journal. For others than rtu-journal it is read-only. */
struct journal_stats *journal_stats_of(const struct map *map);

#endif
