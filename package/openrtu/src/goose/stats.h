/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What rtu-goose keeps in its segment: its counters, and the state numbers that another process of the module goes on with. */
#ifndef OPENRTU_GOOSE_STATS_H
#define OPENRTU_GOOSE_STATS_H

#include "goose/config.h"

/* 32-bit counters that wrap, since the module started; but states. */
struct goose_published {
	_Atomic uint32_t states; /* stNum that was sent last */
	_Atomic uint32_t messages;
	_Atomic uint32_t failures; /* messages that could not be sent */
	_Atomic uint32_t merged;   /* changes that another one hid: more than messages may be sent */
};

struct goose_subscribed {
	_Atomic uint32_t holds; /* 1: what was received holds */
	_Atomic uint32_t states, repeated;
	_Atomic uint32_t missed, out_of_order;
	_Atomic uint32_t
	    mismatched; /* another revision or data set, needs commissioning, or types that the points have not */
	_Atomic uint32_t simulated; /* and not wanted */
	_Atomic uint32_t real;      /* while simulated ones are */
	_Atomic uint32_t jumps;     /* numbers that follow none, and not believed */
	_Atomic uint32_t restarts;  /* of the publisher, believed */
	_Atomic uint32_t expired;
	_Atomic uint32_t floods; /* times that its APPID was not listened to, since too much came */
};

struct goose_stats {
	_Atomic uint32_t frames, damaged;
	_Atomic uint32_t unknown;  /* of no subscription */
	_Atomic uint32_t failures; /* of the interface, as that it is down */
	_Atomic uint32_t overrun;  /* messages that came faster than the process took them */
	struct goose_published published[GOOSE_PUBLISHED_MAX];
	struct goose_subscribed subscribed[GOOSE_SUBSCRIBED_MAX];
};

#define GOOSE_COUNTERS                                                                                       \
	(sizeof(struct goose_stats) / sizeof(uint32_t)) /* all of it is counters: each has a name */

#endif
