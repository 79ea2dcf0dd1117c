/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_RTUD_START_H
#define OPENRTU_RTUD_START_H

#include "rtud/supervisor.h"

/* The module's user, of modules that have one of their own. */
uid_t start_user(const struct supervisor *supervisor, const struct map_module *module);
/* Starts the process of a module as that map has it. Its pid; -1: not, see errno. */
pid_t start_process(const struct supervisor *supervisor, const struct map *map, uint32_t index,
		    const struct map_module *module);
/* Asks a module's process, if there is one, to end; it is killed if it does not in time. */
void start_end(struct child *child);
/* The map has grown: modules may map more than when they were started. */
void start_allow_memory(const struct supervisor *supervisor);

#endif
