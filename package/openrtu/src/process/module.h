/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How a module begins, is asked to stop, and ends: the same for all. Its command line is in options.h, its heartbeat in map.h. */
#ifndef OPENRTU_PROCESS_MODULE_H
#define OPENRTU_PROCESS_MODULE_H

#include <stddef.h>

#include "map/map.h"
#include "process/options.h"

/* The exit codes of a module's process. */
enum module_end {
	MODULE_ENDED,  /* it was asked to, or its generation is over */
	MODULE_FAILED, /* it could not start; stderr or the log says why */
	MODULE_USAGE,  /* wrong command line */
};

/*
 * Reads the command line and attaches to the map, under the module's name. Ends the process with MODULE_USAGE or
 * MODULE_FAILED and a message on stderr when it cannot. Also for --help and --version.
 */
struct map *module_begin(int argc, char **argv, struct options *options);

/*
 * A descriptor that becomes readable when the module shall stop: rtud sends SIGTERM, and kills what runs 3 s later. -1 with
 * errno: there is none. A module that owns a loop of its own may handle the signal itself instead.
 */
int module_stop_fd(void);

/* Says in the log that this program was built for other records than its map has, and is MODULE_FAILED. */
int module_is_of_another_build(struct map *map);

/* The end of the start: confine() with the filter that rtud left. False: the module must end; the log says why. */
bool module_confine(struct map *map, const struct options *options, size_t file_size);

#endif
