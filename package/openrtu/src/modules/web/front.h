/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The connections of browsers, in front of the library that speaks HTTP: who may come, TLS, and how long they may take. What
 * is left for the library is octets on a socket of this process, so that it needs neither TLS nor a limit of its own in time.
 */
#ifndef OPENRTU_MODULES_WEB_FRONT_H
#define OPENRTU_MODULES_WEB_FRONT_H

#include <netinet/in.h>
#include <poll.h>

#include "map/map.h"
#include "web/config.h"
#include "web/stats.h"

#define FRONTS_MAX        16
#define FRONTS_OF_ADDRESS 8 /* a browser opens six */
#define FRONT_POLLS       (1 + 2 * FRONTS_MAX)
#define FRONT_HANDSHAKE_S                                                                                    \
	10 /* a connection ends whose handshake takes longer; or earlier, if its place is needed */
#define FRONT_LATE_S 30 /* a connection ends that has had no whole request, with its answer, for so long */

/* Takes the other end of a connection: number is what front_answered wants. False: it cannot. */
typedef bool front_taker(int fd, unsigned number, const struct in6_addr *peer);

/* False: the log says why. */
bool front_begin(struct map *map, const struct web_settings *settings, struct web_stats *stats, int listener,
		 front_taker *take);
/* What poll shall wait for. True: it shall not wait at all. */
bool front_wait(struct pollfd waits[FRONT_POLLS]);
/* Carries octets after poll. */
void front_serve(const struct pollfd waits[FRONT_POLLS], int64_t now_ns);
/* The settings are elsewhere now, and the same. */
void front_renew(const struct web_settings *settings);
/* That connection's request is there, and its answer begins: it does not give way. */
void front_answering(unsigned number);
/* A request of that connection is wholly answered. */
void front_answered(unsigned number, int64_t now_ns);

#endif
