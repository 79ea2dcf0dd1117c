/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The control socket: one command a line, one answer line each, "ok …" or "error …". README.md lists the
 * commands. A client that said "trace on" gets the frame log as JSON lines in between: those begin with "{".
 */
#ifndef LINESIM_CONTROL_H
#define LINESIM_CONTROL_H

#include "plant.h"

#define CONTROL_NAME "control" /* of the socket, in the directory of the lines */

/* Listens at path, which must not exist. -1 with errno. */
int control_open(struct plant *plant, const char *path);

#endif
