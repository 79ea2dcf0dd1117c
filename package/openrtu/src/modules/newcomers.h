/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Peers that have not yet said who they are. They have places of their own: whoever connects and says nothing takes
 * none of the station's connections.
 */
#ifndef OPENRTU_MODULES_NEWCOMERS_H
#define OPENRTU_MODULES_NEWCOMERS_H

#include "modules/channel.h"

#define NEWCOMERS_MAX 16

struct newcomer {
	bool here;
	int64_t until_ns; /* CLOCK_MONOTONIC; it is greeted by then, or sent away */
	struct iec104_peer peer;
	struct channel channel;
};

/* A place for a peer; when none is free, of the address that has most the one who has taken longest is sent away. */
struct newcomer *newcomers_place(struct iec104_station *station, const struct iec104_peer *peer,
				 int64_t now_ns);
/* The newcomer in a place, which is less than NEWCOMERS_MAX; NULL: nobody. */
struct newcomer *newcomers_at(uint32_t place);
uint32_t newcomers_place_of(const struct newcomer *newcomer);
/* Sends away who takes too long. */
void newcomers_watch(struct iec104_station *station, int64_t now_ns);

#endif
