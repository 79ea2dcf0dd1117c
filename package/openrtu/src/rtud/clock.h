/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The gateway's clock: an offset to the monotonic clock, in the map, set by a controlling station. Only with
 * "clock": "system" is it the system's clock, and only then is that one ever set.
 */
#ifndef OPENRTU_RTUD_CLOCK_H
#define OPENRTU_RTUD_CLOCK_H

#include "map/map.h"

/* Starts from the system's clock; it counts as set when the kernel says that it is synchronised. */
void clock_begin(struct map *map);
/* Follows the system's clock when that is the gateway's. Once a tick. */
void clock_follow(struct map *map);
/* Carries out and answers a MAP_SET_CLOCK request. */
void clock_set(struct map *map, const struct map_request *request);

#endif
