/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Attempts to reach a peer: when the next one is made (retry.h), and what the log says of them, the same for receivers, Modbus
 * lines and outstations.
 *
 * The first failure is said at once, and so is the end of the first trouble. While attempts go on to fail they are counted, and
 * said with the count when map/repeats.h has it, and once meanwhile if there is another reason. A connection that was said to be there again and failed once more is one that
 * comes and goes: it is said to be there when it has lasted as long as the pause between the lines. So the last line of the log
 * is true of it, however often it comes and goes. After an hour without a failure it begins anew.
 */
#ifndef OPENRTU_CHANNEL_ATTEMPTS_H
#define OPENRTU_CHANNEL_ATTEMPTS_H

#include "channel/retry.h"
#include "map/repeats.h"

/* Of those who have no keys for it: soon enough for who has just put the plug in, and rare enough for a busy server. */
#define ATTEMPTS_FIRST_NS NS_PER_S
#define ATTEMPTS_MOST_NS  (10 * NS_PER_S)

#define ATTEMPTS_TEXT_SIZE 96

struct attempts {
	struct retry retry;
	/* What the log knows. */
	struct map_repeats repeats; /* its lines about failures */
	int64_t since_ns;           /* the trouble began */
	int64_t useful_ns;          /* since then the connection has been of use; 0: it has not */
	int64_t pause_ns;           /* until the next attempt, when the last one failed */
	uint32_t failures;          /* since the trouble began */
	uint32_t reason;            /* of the last line, a hash */
	bool another_said;          /* since then, a line for another reason */
	bool failing;
	bool said;  /* that it fails is in the last line about it */
	bool ended; /* one trouble ended less than an hour ago */
};

struct attempts attempts_begin(int64_t first_ns, int64_t most_ns);
/*
 * An attempt failed, or the connection is lost; pause_ns is set. True: the log is to say so, and then attempts_failure's text.
 */
bool attempts_failed(struct attempts *attempts, const char *reason, int64_t now_ns);
/*
 * The connection is there and of use, as far as the log is concerned; when the pause begins anew, its owner tells retry. True:
 * the log is to say so, and then attempts_success' text. A first connection, before which nothing failed, is its owner's to say.
 */
bool attempts_useful(struct attempts *attempts, int64_t now_ns);

/* "; trying again in 2 s", "; 7 times in 30 s, trying again in 10 s". Returns text. */
const char *attempts_failure(const struct attempts *attempts, int64_t now_ns, char text[ATTEMPTS_TEXT_SIZE]);
/* ", again after 7 failures in 30 s". Returns text. */
const char *attempts_success(const struct attempts *attempts, int64_t now_ns, char text[ATTEMPTS_TEXT_SIZE]);

#endif
