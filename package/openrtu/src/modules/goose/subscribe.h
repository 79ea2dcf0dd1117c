/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Messages of others as points of the map. */
#ifndef OPENRTU_MODULES_GOOSE_SUBSCRIBE_H
#define OPENRTU_MODULES_GOOSE_SUBSCRIBE_H

#include "goose/stats.h"
#include "map/map.h"

bool subscribe_begin(struct map *map, struct goose_stats *stats);
/* A frame that was read now, and came at since_ns or later. */
void subscribe_take(const uint8_t *frame, size_t size, int64_t now_ns, int64_t since_ns);
/* What holds no longer is invalid. */
void subscribe_run(int64_t now_ns);
int64_t subscribe_deadline(void);

#endif
