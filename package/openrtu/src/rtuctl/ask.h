/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_RTUCTL_ASK_H
#define OPENRTU_RTUCTL_ASK_H

#include "map/map.h"

/* Asks rtud, and waits for its answer for so long. False: there is none. */
bool rtuctl_ask(struct map *map, struct map_request request, uint32_t patience_ms, struct map_answer *out);

#endif
