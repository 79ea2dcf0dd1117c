/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a module of others counts of itself, by libopenrtu. */
#ifndef OPENRTU_FOREIGN_STATS_H
#define OPENRTU_FOREIGN_STATS_H

#include <stdatomic.h>
#include <stdint.h>

struct foreign_stats {
	_Atomic uint32_t scans;
	_Atomic uint32_t missed; /* periods */
};

#define FOREIGN_COUNTERS 2 /* that have a name */

#endif
