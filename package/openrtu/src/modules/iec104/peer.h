/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Who connects, by the address, and what the configuration grants that address. */
#ifndef OPENRTU_MODULES_IEC104_PEER_H
#define OPENRTU_MODULES_IEC104_PEER_H

#include <sys/socket.h>

#include "iec104/station.h"

/* Fills in out, in which an IPv4 peer of an IPv6 socket has its IPv4 address. False: it may not connect. */
bool peer_identify(const struct sockaddr_storage *from, const struct map_config *config,
		   struct iec104_peer *out);

/* What a changed configuration grants a peer that was identified before. False: it may not be connected any more. */
bool peer_look_again(const struct map_config *config, struct iec104_peer *peer);

#endif
