/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What a changed configuration file means for the modules that run, and the files of the map for it. This takes as long as
 * reading the file does: a process beside rtud does it.
 */
#ifndef OPENRTU_RTUD_CHANGE_H
#define OPENRTU_RTUD_CHANGE_H

#include <stdio.h>

#include "map/map.h"
#include "rtud/config.h"
#include "rtud/plan.h"

/* The exit code of the process that prepares a change. */
enum change_result {
	CHANGE_READY,   /* the map's files are there */
	CHANGE_NONE,    /* nothing is to be done */
	CHANGE_REFUSED, /* the file has errors, or what it changes needs a restart; there are no files */
};

struct change_plan {
	const char *path;    /* of the configuration; NULL: the one before the map's goes back into force */
	const char *instead; /* another file, whose text is read in its place; NULL: none */
	uint32_t *text;      /* takes the hash of its text */
	struct config_modules modules; /* of this build */
	const char *map;               /* folder of the map */
	uint32_t group;                /* of the map's files */
	bool dry;                      /* only say what would change */
};

/* before: the configuration that went before the map's, if the plan is to go back to it. report takes what would change, or why not. */
enum change_result change_prepare(const struct map *map, const struct map *before,
				  const struct change_plan *plan, FILE *report);

#endif
