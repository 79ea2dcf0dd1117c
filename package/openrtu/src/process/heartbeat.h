/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Why a heartbeat was late: the scheduler counts how long it let a process wait that could have run (sched-stats in the
 * kernel's documentation: the second figure of /proc/PID/schedstat, nanoseconds).
 */
#ifndef OPENRTU_PROCESS_HEARTBEAT_H
#define OPENRTU_PROCESS_HEARTBEAT_H

#include <stdint.h>

#include "map/map.h"

#define HEARTBEAT_UNKNOWN (-1) /* a kernel without CONFIG_SCHED_INFO counts nothing */

struct heartbeat {
	int schedstat_fd;  /* -1: there is none */
	int64_t waited_ns; /* for a processor, up to the last beat */
	int64_t beaten_ns;
	int64_t said_ns; /* 0: never */
	unsigned unsaid; /* since then */
};

/* The first beat. Before confine(): it opens a file. */
void heartbeat_begin(struct heartbeat *heartbeat, struct map *map);

/* A beat; in the log, at most each 10 s, why it is later than the map's readers wait for it. */
void heartbeat_beat(struct heartbeat *heartbeat, struct map *map, int64_t now_ns);

/* The sentence. waited_ms: of the silence, for a processor, or HEARTBEAT_UNKNOWN. out: size bytes. */
void heartbeat_words(char *out, size_t size, int64_t silent_ms, uint32_t limit_ms, int64_t waited_ms,
		     unsigned unsaid);

#endif
