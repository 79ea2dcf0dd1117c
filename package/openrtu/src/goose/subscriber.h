/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The receiving side of one control block: which messages are taken, and how long what they say holds. Times are arguments.
 */
#ifndef OPENRTU_GOOSE_SUBSCRIBER_H
#define OPENRTU_GOOSE_SUBSCRIBER_H

#include "goose/config.h"

enum goose_verdict {
	GOOSE_NOT_MINE,
	GOOSE_TAKEN,        /* a new state: its items are to be published */
	GOOSE_REPEATED,     /* the same state still holds */
	GOOSE_OUT_OF_ORDER, /* older than what was taken, or a copy of it */
	GOOSE_SIMULATED,    /* and simulated ones are not wanted */
	GOOSE_MISMATCHED, /* another revision or data set, or it needs commissioning: nothing of it is believed */
};

struct goose_subscriber {
	const struct goose_subscription *subscription;
	bool has_taken;           /* a message, since something holds */
	uint32_t state, sequence; /* of the last one */
	uint32_t missed;          /* messages: gaps in sqNum, and states that were never seen */
	int64_t until_ns;         /* what was taken holds; 0: nothing holds */
	struct goose_time time;   /* of the state */
};

/* until_ns: what a former process has taken may hold for so long; 0: there is none. */
void goose_subscriber_init(struct goose_subscriber *subscriber, const struct goose_subscription *subscription,
			   int64_t until_ns);

/* A message that is sound. now_ns: when it came. */
enum goose_verdict goose_subscriber_take(struct goose_subscriber *subscriber,
					 const struct goose_message *message, int64_t now_ns);

/* True, once: what was taken holds no longer. */
bool goose_subscriber_expires(struct goose_subscriber *subscriber, int64_t now_ns);
/* When it may expire; INT64_MAX: nothing holds. */
int64_t goose_subscriber_deadline(const struct goose_subscriber *subscriber);

#endif
