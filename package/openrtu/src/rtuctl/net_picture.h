/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A picture of the net, as SVG. */
#ifndef OPENRTU_RTUCTL_NET_PICTURE_H
#define OPENRTU_RTUCTL_NET_PICTURE_H

#include <stdio.h>

#include "synch/net.h"

/* How a participant is drawn. */
struct net_mark {
	bool alive, waits;
};

/* tokens: of each place. marks: of each participant. */
void net_picture(const struct synch_net *net, const uint16_t *tokens, const struct net_mark *marks,
		 FILE *out);

#endif
