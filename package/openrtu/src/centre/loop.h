/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_CENTRE_LOOP_H
#define OPENRTU_CENTRE_LOOP_H

#include <stdatomic.h>

#include "centre/station.h"

#define CENTRE_TURN_MAX_MS 500 /* between two turns of a loop, however little there is to do */

/*
 * Serves until SIGTERM or SIGINT. listener: of consumers, on a socket at path. turns: counts those of the loop, for who
 * watches it. Returns an exit code.
 */
int centre_loop(struct centre *centre, int listener, const char *path, atomic_uint *turns);

#endif
