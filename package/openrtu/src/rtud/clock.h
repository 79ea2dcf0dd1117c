/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The gateway's clock: an offset to the monotonic clock, in the map, which dates events and fires no timer. By the
 * configuration's "clock" it is
 * - "gateway": the system's while that is synchronised, else what a controlling station sets;
 * - "masters": what a controlling station sets, whatever the system's clock says;
 * - "system": always the system's, which a controlling station sets, too.
 * While the gateway follows a synchronised clock nobody else may set it.
 *
 * A system that loses its synchronisation leaves a clock that is good for a while. How wrong it may be then the kernel
 * tells: what it knew last, and from there on 500 parts in a million, the most that it ever corrects. Until that reaches
 * the kernel's own limit, 16 s, the clock counts as set; without a source from the start on that is 8.9 h.
 */
#ifndef OPENRTU_RTUD_CLOCK_H
#define OPENRTU_RTUD_CLOCK_H

#include <sys/timex.h>

#include "map/map.h"
#include "map/time_ns.h"

#define CLOCK_ERROR_MAX_US 16000000LL      /* NTP_PHASE_LIMIT of the kernel */
#define CLOCK_DRIFT_PPM    500             /* its MAXFREQ */
#define CLOCK_LOST_NS      (10 * NS_PER_S) /* until then it is no loss: each step is called one, by the kernel */

/* The system's clock as it is now. */
struct clock_reading {
	int64_t now_ns;                 /* CLOCK_MONOTONIC */
	int64_t earliest_ns, latest_ns; /* CLOCK_REALTIME is ahead of it by something between these */
	uint32_t error_us;              /* it is wrong by so much at most, if it is synchronised */
	int state; /* TIME_OK, or what there is of a leap second: TIME_INS, TIME_OOP … */
	bool synchronised;
};

/* kernel: adjtimex, which is only asked. */
struct clock_reading clock_read(int (*kernel)(struct timex *));

/* Starts from the system's clock, and says what that is worth. */
void clock_begin(struct map *map, const struct clock_reading *system);
/* Takes up what became of the system's clock. Once a tick. */
void clock_follow(struct map *map, const struct clock_reading *system);
/* The configuration has another mode than before: a clock that a controlling station has set becomes the system's, if that counts now. */
void clock_mode_changed(struct map *map, enum map_clock_mode before);
/* Carries out and answers a MAP_SET_CLOCK request. */
void clock_set(struct map *map, const struct map_request *request);

#endif
