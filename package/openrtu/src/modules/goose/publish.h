/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The map's points as messages: each event that a member of a data set has is sent, in order. */
#ifndef OPENRTU_MODULES_GOOSE_PUBLISH_H
#define OPENRTU_MODULES_GOOSE_PUBLISH_H

#include "modules/goose/wire.h"

/* False with errno: there is no memory. */
bool publish_begin(struct map *map, struct goose_stats *stats);
void publish_end(void);
/* Takes the events that are there, and sends what is due. */
void publish_run(struct wire *wire, int64_t now_ns);
int64_t publish_deadline(void);

#endif
