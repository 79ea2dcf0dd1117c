/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_RTUD_SUPERVISE_H
#define OPENRTU_RTUD_SUPERVISE_H

#include <stdint.h>

#include "map/config.h"
#include "rtud/config.h"

struct supervise_options {
	const char *file; /* the configuration, read again when it has changed */
	const char
	    *kept; /* where the page keeps one, whose text takes the place of file's; NULL: in file itself */
	struct config_modules build;
	const char *map;      /* folder of the map, on a tmpfs */
	const char *modules;  /* folder of the module executables */
	const char *dev;      /* folder of the serial devices */
	const char *watchdog; /* device that is fed while rtud is healthy: rtud/watchdog.h; NULL: none */
	uint32_t uid_base;    /* as root: module i runs as user uid_base + i; 0: all as the caller */
};

/*
 * Creates the map, runs and watches the modules until SIGTERM or SIGINT, stops them and removes the map. Once config
 * is in the map it is freed (config_free), since rtud stays and its memory is the board's.
 * Returns rtud's exit code: 0 stopped as asked, 1 could not start (said on stderr).
 */
int supervise(struct map_config *config, const struct supervise_options *options);

#endif
