/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The engineer's view of the point map, after LinuxCNC's halcmd. All commands but set, step, force, unforce, module and reload attach as observers and write
 * nothing.
 */
#ifndef OPENRTU_RTUCTL_H
#define OPENRTU_RTUCTL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include <jansson.h>

#include "map/map.h"

enum rtuctl_exit {
	RTUCTL_DONE,
	RTUCTL_FAILED, /* nothing found, or the command was refused */
	RTUCTL_USAGE,  /* wrong usage, or no map */
};

#define RTUCTL_ARGUMENTS_MAX 2

/* What the command line says. */
struct rtuctl_request {
	const char *dir;
	const char *arguments[RTUCTL_ARGUMENTS_MAX];
	unsigned long count; /* 0: no limit */
	bool json;
	bool select;
	bool histogram;
	bool suggest;
	bool once;
	bool dry_run;
	bool follow;
	const char *pulse;    /* NULL: none */
	const char *duration; /* of a force; NULL: as usual */
	const char *svg;      /* a file; NULL: none */
	const char *pcapng;   /* the same */
};

/* One command: runs on an attached map and returns an exit code. */
typedef int rtuctl_command(struct map *map, const struct rtuctl_request *request);

rtuctl_command rtuctl_points;
rtuctl_command rtuctl_top;
rtuctl_command rtuctl_show;
rtuctl_command rtuctl_commands;
rtuctl_command rtuctl_modules;
rtuctl_command rtuctl_module;
rtuctl_command rtuctl_reload;
rtuctl_command rtuctl_counters;
rtuctl_command rtuctl_clock;
rtuctl_command rtuctl_lines;
rtuctl_command rtuctl_histogram;      /* lines --histogram */
rtuctl_command rtuctl_scan_histogram; /* modules --histogram */
rtuctl_command rtuctl_suggest;        /* lines --suggest */
rtuctl_command rtuctl_frames;
rtuctl_command rtuctl_gps;
rtuctl_command rtuctl_logic;
rtuctl_command rtuctl_iec104;
rtuctl_command rtuctl_iec61850;
rtuctl_command rtuctl_synch;
rtuctl_command rtuctl_watch;
rtuctl_command rtuctl_events;
rtuctl_command rtuctl_log;
rtuctl_command rtuctl_set;
rtuctl_command rtuctl_step;
rtuctl_command rtuctl_force;
rtuctl_command rtuctl_unforce;
rtuctl_command rtuctl_forces;

/* The point of that name; MAP_NONE: there is none. */
uint32_t rtuctl_find_point(const struct map_config *config, const char *name);
/* The forced points as a table, if there are some, with an empty line before or behind it. */
void rtuctl_print_forces(const struct map *map, FILE *out);
/* True when the point's name matches the pattern; no pattern matches all. */
bool rtuctl_matches(const struct map_config *config, uint32_t point, const char *pattern);

#endif
