/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What rtud knows of what runs: for the files of it that start, watch and exchange modules. */
#ifndef OPENRTU_RTUD_SUPERVISOR_H
#define OPENRTU_RTUD_SUPERVISOR_H

#include <stdbool.h>
#include <sys/types.h>

#include "map/lines.h"
#include "map/map.h"
#include "map/repeats.h"
#include "rtud/reload.h"
#include "rtud/supervise.h"

#define STOP_MS 3000 /* a module that takes longer to stop is killed */

struct child {
	pid_t pid;     /* 0: none */
	bool attached; /* this generation has */
	bool silent;   /* heartbeat too old, said to all readers of events */
	bool silence_logged;
	bool held;                 /* stopped on purpose: stays so until it is asked for */
	int64_t kill_at_ns;        /* was asked to end, and ends then at the latest; 0: was not */
	int64_t silent_since_ns;   /* its last heartbeat */
	int64_t silence_logged_ns; /* 0: never */
	int64_t started_ns;
	int64_t restart_at_ns;
	uint32_t pause_ms; /* before the next start; grows while it ends young */
};

/* What rtud prints of a module's log. */
struct log_reader {
	uint32_t position;
	struct map_lines lines;
	struct map_repeats lost;
};

struct supervisor {
	const struct supervise_options *options;
	struct map *map;
	struct child children[MAP_MODULES_MAX];
	struct log_reader logs[MAP_MODULES_MAX];
	int watchdog; /* descriptor; -1: none */
	bool stopping;
	bool filtered;         /* modules get filters of their system calls */
	bool priority_refused; /* said in the log */
	int64_t reset_at_ns;   /* all modules are restarted then; 0: no */
	int64_t reset_ns;      /* when they were last */
	struct reload reload;
	struct setup setup;
};

#endif
