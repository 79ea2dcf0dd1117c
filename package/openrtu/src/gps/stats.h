/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What rtu-gps shows of its receivers: the section of its own in its segment, a record each. */
#ifndef OPENRTU_GPS_STATS_H
#define OPENRTU_GPS_STATS_H

#include "gps/fix.h"
#include "map/latch.h"
#include "map/map.h"

#define GPS_KIND "gps"

/* 32-bit counters that wrap, since the module started. */
struct gps_stats {
	_Atomic uint32_t open; /* 1: the port is open, or gpsd is connected */
	_Atomic uint32_t octets;
	_Atomic uint32_t sentences;     /* taken */
	_Atomic uint32_t damaged;       /* lines: no or a wrong checksum, cut, too long */
	_Atomic uint32_t unknown;       /* sound lines that are not read */
	_Atomic uint32_t stray;         /* octets outside a line */
	_Atomic uint32_t fixes;         /* bursts, those without a position among them */
	_Atomic uint32_t events;        /* fixes that were sent */
	_Atomic uint32_t era_corrected; /* dates moved by a multiple of 1 024 weeks */
	_Atomic uint32_t dates_refused; /* dates that were not believed */
	_Atomic uint32_t jumps, too_fast, clock_steps;
	_Atomic uint32_t failures; /* the port could not be opened or was lost; gpsd likewise */
	map_latch latch;           /* of what follows */
	struct gps_fix copies[2];  /* the last burst */
};

/* Of all receivers, in the configuration's order. NULL: there are none. For others than rtu-gps it is read-only. */
struct gps_stats *gps_stats_of(const struct map *map);

#endif
