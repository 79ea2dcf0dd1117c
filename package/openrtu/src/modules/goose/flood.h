/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Messages of an APPID that come without end. The kernel does not let them through for a while, so that they cost a bounded time, and the
 * messages of other APPIDs find room in the socket's queue.
 */
#ifndef OPENRTU_MODULES_GOOSE_FLOOD_H
#define OPENRTU_MODULES_GOOSE_FLOOD_H

#include "modules/goose/wire.h"

void flood_begin(struct wire *wire);
/* False: this message is one too many of its APPID. */
bool flood_admits(const uint8_t *frame, size_t size, int64_t now_ns);
/* Whose while is over is listened to again. */
void flood_run(int64_t now_ns);
int64_t flood_deadline(void);

#endif
