/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Points that whoever acts on site forces: whether he may, for how long, and the log of it. */
#ifndef OPENRTU_RTUD_FORCE_H
#define OPENRTU_RTUD_FORCE_H

#include "map/map.h"

/* Carries out and answers a MAP_FORCE request. */
void force_take(struct map *map, const struct map_request *request);
/* Ends what is over. */
void force_tick(struct map *map);

#endif
