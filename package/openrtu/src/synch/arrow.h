/* SPDX-License-Identifier: GPL-3.0-or-later */
/* An arrow: "line1 -> filter", "filter -(2)-> logic". */
#ifndef OPENRTU_SYNCH_ARROW_H
#define OPENRTU_SYNCH_ARROW_H

#include "synch/net.h"

struct synch_arrow {
	char from[MAP_NAME_SIZE], to[MAP_NAME_SIZE];
	uint8_t weight; /* 1 where none is given */
};

/* False: it is no arrow. */
bool synch_read_arrow(const char *text, struct synch_arrow *out);
/* Letters, digits, -, _ and . in a length that fits. */
bool synch_is_name(const char *text);

#endif
