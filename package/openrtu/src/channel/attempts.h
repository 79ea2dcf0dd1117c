/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Attempts to reach a peer: when the next one is made (retry.h), and what the log says of them (map/trouble.h). The same for
 * receivers, Modbus lines and outstations.
 */
#ifndef OPENRTU_CHANNEL_ATTEMPTS_H
#define OPENRTU_CHANNEL_ATTEMPTS_H

#include "channel/retry.h"
#include "map/trouble.h"

/* Of those who have no keys for it: soon enough for who has just put the plug in, and rare enough for a busy server. */
#define ATTEMPTS_FIRST_NS NS_PER_S
#define ATTEMPTS_MOST_NS  (10 * NS_PER_S)

#define ATTEMPTS_TEXT_SIZE (MAP_TROUBLE_SIZE + MAP_DURATION_SIZE + 24)

struct attempts {
	struct retry retry;
	struct map_trouble trouble;
	int64_t pause_ns; /* until the next attempt, when the last one failed */
};

struct attempts attempts_begin(int64_t first_ns, int64_t most_ns);
/*
 * An attempt failed, or the connection is lost; pause_ns is set. True: the log is to say so, and then attempts_failure's text.
 */
bool attempts_failed(struct attempts *attempts, const char *reason, int64_t now_ns);
/* "; 7 times in 30 s; trying again in 10 s". Returns text. */
const char *attempts_failure(const struct attempts *attempts, int64_t now_ns, char text[ATTEMPTS_TEXT_SIZE]);

#endif
