/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_CENTRE_LOOP_H
#define OPENRTU_CENTRE_LOOP_H

#include "centre/station.h"

/* Serves until SIGTERM or SIGINT. listener: of consumers, on a socket at path. Returns an exit code. */
int centre_loop(struct centre *centre, int listener, const char *path);

#endif
