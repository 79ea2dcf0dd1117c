/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Who connects, by the address, and what the configuration grants that address. */
#ifndef OPENRTU_MODULES_PEER_H
#define OPENRTU_MODULES_PEER_H

#include <sys/socket.h>

#include "map/station.h"

struct peer {
	char name[MAP_PEER_SIZE];       /* for the log: address and port */
	char address[MAP_ADDRESS_SIZE]; /* an IPv4 peer of an IPv6 socket is seen by its IPv4 address */
	uint32_t group;                 /* index of its redundancy group, MAP_NONE: none */
	bool listed;                    /* may connect */
	bool clock_master;              /* may set the clock */
};

struct peer peer_of(const struct sockaddr_storage *from, const struct map_settings *settings);

#endif
