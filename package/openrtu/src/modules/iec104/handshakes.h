/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Peers that are connected and have not finished their handshake. They have their own places: a peer that connects and
 * sends nothing takes none of the station's connections.
 */
#ifndef OPENRTU_MODULES_IEC104_HANDSHAKES_H
#define OPENRTU_MODULES_IEC104_HANDSHAKES_H

#include "channel/channel.h"
#include "iec104/station.h"

#define HANDSHAKES_MAX 16

struct handshake {
	bool here;
	int64_t until_ns; /* CLOCK_MONOTONIC; it has finished by then, or is sent away */
	struct iec104_peer peer;
	struct channel channel;
};

/* A place for a peer. If none is free, the oldest handshake of the address that has the most is sent away. */
struct handshake *handshakes_place(struct iec104_station *station, const struct iec104_peer *peer,
				   int64_t now_ns);
/* The handshake in a place, which is less than HANDSHAKES_MAX; NULL: there is none. */
struct handshake *handshakes_at(uint32_t place);
uint32_t handshakes_place_of(const struct handshake *handshake);
/* Sends away the peers that take too long. */
void handshakes_watch(struct iec104_station *station, int64_t now_ns);

/* Sends away the peers that a changed configuration does not list, and looks again at what it grants the others. */
void handshakes_renew(struct iec104_station *station, const struct map_config *config);

#endif
