/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Peers that are connected and have not finished their handshake. They have their own places: a peer that connects and
 * sends nothing takes none of the module's connections.
 */
#ifndef OPENRTU_CHANNEL_HANDSHAKES_H
#define OPENRTU_CHANNEL_HANDSHAKES_H

#include "channel/channel.h"
#include "map/config.h"

#define HANDSHAKES_MAX 16

struct handshake {
	bool here;
	int64_t until_ns; /* CLOCK_MONOTONIC; it has finished by then, or is sent away */
	char address[MAP_ADDRESS_SIZE];
	struct channel channel;
};

/* A place for a peer. If none is free, the oldest handshake of the address that has the most is sent away. */
struct handshake *handshakes_place(const struct channel_owner *owner, const char *address, int64_t now_ns);
/* The handshake in a place, which is less than HANDSHAKES_MAX; NULL: there is none. */
struct handshake *handshakes_at(uint32_t place);
uint32_t handshakes_place_of(const struct handshake *handshake);
/* Sends away the peers that take too long. */
void handshakes_watch(const struct channel_owner *owner, int64_t now_ns);

/* Sends away the peers that a changed configuration does not list. */
void handshakes_renew(const struct channel_owner *owner, bool (*is_listed)(const char *address));

#endif
