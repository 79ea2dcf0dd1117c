/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The table of the kinds of modules. */
#ifndef OPENRTU_RTUD_KINDS_H
#define OPENRTU_RTUD_KINDS_H

#include "modules/kind.h"

#define KINDS_MAX 16

/* The parts of the file that kinds have, in the order of the table. Returns how many. */
size_t kinds_parts(const struct config_part *parts[KINDS_MAX]);
/* Plans all modules of a configuration. False: they are more than MAP_MODULES_MAX. */
bool kinds_plan(struct map_config *config);
/* The kind of a module; NULL: none in the table. */
const struct kind *kinds_find(const char *name);
/* How a module of a kind in the table is run. Neither a program nor a path: rtud starts none. */
struct kind_run kinds_run(const struct map_module *module, const struct map_config *config);
/* What a process of the module has opened for it: struct kind; NULL: nothing. */
kind_opener *kinds_opens(const char *kind, const char *module, const struct map_config *config);
/* The highest real-time priority of all kinds; 0: none. */
int kinds_highest_priority(const struct map_config *config);

#endif
