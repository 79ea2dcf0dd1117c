/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Starting a module's process with the rights and the priority it needs, and no others. */
#ifndef OPENRTU_RTUD_PROCESS_H
#define OPENRTU_RTUD_PROCESS_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

#include "modules/kind.h"

struct process_plan {
	const char *folder; /* of the executables */
	const struct kind_program *program;
	const char *path;   /* instead: a program of others, maybe a script */
	const char *map;    /* folder of the map */
	const char *module; /* name in the module table */
	const char *dev;    /* folder of the serial devices */
	int segment;        /* descriptor of the module's own segment, writable */
	const char *group;  /* that its user is in besides, by name; NULL: none */
	uid_t uid;          /* user of the process, 0: the caller's */
	gid_t gid;          /* group shared by all modules */
	size_t memory;      /* bytes of address space it may have at most; 0: unlimited */
	unsigned files;     /* descriptors */
	unsigned processes; /* and threads that its user may have; 0: as many as the caller's */
	kind_opener *open;  /* struct kind; NULL: nothing */
	int (*describe)(const struct map_config *config); /* struct kind; NULL: nothing */
	const struct map_config *config;
	bool filtered; /* gets the filter of system calls of its program */
};

/*
 * Forks and executes `folder/program --map M --module N --dev D [--filter F] [--socket S] [--file N]`. The child dies with its parent, has no
 * descriptors but the standard ones, its segment at MAP_SEGMENT_FD, its filter, its socket and its file, may lock its memory, writes no core, can
 * gain no privilege, and as a user of its own has none. It starts with ordinary scheduling: on this core a program's start takes longer than another line process'
 * heartbeat may. Returns its pid, or -1 with errno.
 * A path's program is executed by that path, so that a script's interpreter finds it: its user must be able to walk there.
 */
pid_t process_start(const struct process_plan *plan);

/* Gives a process, 0: the calling one, SCHED_FIFO at that priority; priority 0: ordinary scheduling. 0, or -1 with errno. */
int process_set_priority(pid_t pid, int priority);

#endif
