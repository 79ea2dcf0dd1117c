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
/* The program of a module of this kind; NULL: rtud starts none. */
const struct kind_program *kinds_program(const char *name, const struct map_config *config);
/* The real-time priority of a kind's modules, and the highest of all kinds; 0: none. */
int kinds_priority(const char *name, const struct map_config *config);
int kinds_highest_priority(const struct map_config *config);

#endif
