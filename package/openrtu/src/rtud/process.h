/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Starting a module's process with the rights and the priority it needs, and no others. */
#ifndef OPENRTU_RTUD_PROCESS_H
#define OPENRTU_RTUD_PROCESS_H

#include <stdint.h>
#include <sys/types.h>

struct process_plan {
	const char *program; /* path of the executable */
	const char *map;     /* folder of the map */
	const char *module;  /* name in the module table */
	const char *dev;     /* folder of the serial devices */
	int priority;        /* SCHED_FIFO 1..99, 0: ordinary scheduling */
	uid_t uid;           /* user of the process, 0: the caller's */
	gid_t gid;           /* group shared by all modules */
};

/*
 * Forks and executes `program --map M --module N --dev D`. The child dies with its parent, holds no capability, can gain
 * none, and may lock its memory. Returns its pid, or -1 with errno.
 */
pid_t process_start(const struct process_plan *plan);

/* Gives the calling process SCHED_FIFO at that priority. 0, or -1 with errno. */
int process_set_priority(int priority);

#endif
