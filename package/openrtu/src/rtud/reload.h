/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A changed configuration, step by step, from rtud's loop: a process beside rtud reads the file and makes the map's files; the
 * new processes of the modules that change are started and wait; the old ones end; the configuration comes into force; the
 * new ones prove themselves. Until the old ones end, nothing has happened; what breaks later goes back.
 */
#ifndef OPENRTU_RTUD_RELOAD_H
#define OPENRTU_RTUD_RELOAD_H

#include <stdbool.h>
#include <sys/types.h>

#include "map/map.h"
#include "rtud/setup.h"

struct supervisor;

enum reload_phase {
	RELOAD_IDLE,
	RELOAD_PREPARING, /* the file is read */
	RELOAD_STARTING,  /* new processes attach */
	RELOAD_QUIET,     /* commands under way come to their ends */
	RELOAD_ENDING,    /* old processes end */
	RELOAD_PROVING,   /* new processes work */
};

struct reload {
	enum reload_phase phase;
	bool asked; /* by a request, which waits for its answer */
	struct map_request request;
	enum setup_job job; /* of the page's proposal; SETUP_NO_JOB: a file as it is */
	bool back;          /* the former configuration comes into force again */
	const char *path;   /* of the file that is read */
	char asked_path[MAP_PATH_SIZE];
	pid_t worker;
	int worker_status;
	struct map *next;   /* the configuration that was prepared; NULL: none */
	struct map *former; /* to go back to, while the new processes prove themselves; NULL: none */
	pid_t incoming[MAP_MODULES_MAX]; /* new processes that wait; 0: none */
	map_modules exchanged, added, gone;
	map_modules again;  /* those that start again in the segments that they have */
	map_modules valid;  /* of these, those whose points were */
	map_modules broken; /* of these, those whose new process ended */
	int64_t deadline_ns, switched_ns;
};

/* Reads rtud's own file again. */
void reload_again(struct supervisor *supervisor);
/* A request to read a file that the requester names in its section; detail 1: only to say what would change. */
void reload_take(struct supervisor *supervisor, const struct map_request *request);
/* Reads what the page proposes, or the file that was before it: no phase but RELOAD_IDLE. */
void reload_propose(struct supervisor *supervisor, enum setup_job job);
/* Does what can be done now. */
void reload_step(struct supervisor *supervisor);
/* A process has ended. True: it was one of a reload, which knows what to do. */
bool reload_reap(struct supervisor *supervisor, pid_t pid, int status);
/* The module's process is not to be started or announced now. */
bool reload_holds(const struct supervisor *supervisor, uint32_t module);
/* rtud ends, or starts all modules anew. */
void reload_cancel(struct supervisor *supervisor);

#endif
