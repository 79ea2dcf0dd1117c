/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The receiving side of one control block: which messages are believed, and how long what they say holds. GOOSE has no
 * authentication here: what cannot be judged by its numbers and its time is not believed. Times are arguments.
 */
#ifndef OPENRTU_GOOSE_SUBSCRIBER_H
#define OPENRTU_GOOSE_SUBSCRIBER_H

#include "goose/config.h"

enum goose_verdict {
	GOOSE_TAKEN,        /* a new state: its items are to be published */
	GOOSE_REPEATED,     /* the same state still holds */
	GOOSE_OUT_OF_ORDER, /* older than what was taken, or a copy of it */
	GOOSE_JUMPED,       /* its numbers follow none that were taken, and it is no restart */
	GOOSE_SIMULATED,    /* and simulated ones are not wanted */
	GOOSE_REAL,         /* and simulated ones have come */
	GOOSE_MISMATCHED, /* another revision or data set, or it needs commissioning: nothing of it is believed */
};

/* What stays of the last message that was believed, for as long as the process lives. */
struct goose_last {
	bool known;
	uint32_t state, sequence;
	int64_t utc_ns;   /* of the state, by the publisher's clock; 0: that was not set */
	int64_t came_ns;  /* when it was read */
	int64_t alive_ns; /* until then it says that another one comes */
};

/*
 * When a message was read, and when it may have come at the earliest: a process that was stopped reads what waited meanwhile.
 * utc_ns: the first by this machine's clock, 0: that is not set.
 */
struct goose_arrival {
	int64_t now_ns, since_ns, utc_ns;
};

struct goose_subscriber {
	const struct goose_subscription *subscription;
	struct goose_last last;
	bool simulated;    /* one that was has come: only such count */
	uint32_t missed;   /* messages: gaps in sqNum, and states that were never seen */
	uint32_t restarts; /* of the publisher, that were believed */
	int64_t until_ns;  /* what was taken holds; 0: nothing holds */
};

/* until_ns: what a former process has taken may hold for so long; 0: there is none. */
void goose_subscriber_init(struct goose_subscriber *subscriber, const struct goose_subscription *subscription,
			   int64_t until_ns);

/* Whether a sound message is one of this control block. */
bool goose_subscriber_hears(const struct goose_subscriber *subscriber, const struct goose_message *message);

/*
 * A message that it hears. fits: its items are as many, and of the types, as its points want. One that may be older than the time
 * for which it holds is taken, and holds no longer.
 */
enum goose_verdict goose_subscriber_take(struct goose_subscriber *subscriber,
					 const struct goose_message *message, bool fits,
					 const struct goose_arrival *arrival);

bool goose_subscriber_holds(const struct goose_subscriber *subscriber, int64_t now_ns);
/* True, once: what was taken holds no longer. */
bool goose_subscriber_expires(struct goose_subscriber *subscriber, int64_t now_ns);
/* When it may expire; INT64_MAX: nothing holds. */
int64_t goose_subscriber_deadline(const struct goose_subscriber *subscriber);

#endif
