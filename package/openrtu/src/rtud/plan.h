/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Whether what a configuration asks for can run: all that is decided before there is a process, at a start, a reload and --check. */
#ifndef OPENRTU_RTUD_PLAN_H
#define OPENRTU_RTUD_PLAN_H

#include <stdio.h>

#include "map/config.h"

/*
 * Of modules that kinds_plan has planned; map: the folder of the map. Each reason against them is a line in messages; false: there
 * is one. A program that is missing is none: it costs its points alone.
 */
bool plan_is_possible(const struct map_config *config, const char *map, FILE *messages);
/* Plans the modules first. */
bool plan_modules(struct map_config *config, const char *map, FILE *messages);
/* Says which programs of this build are neither in that folder nor beside rtud. */
void plan_note_programs(const struct map_config *config, const char *folder, FILE *messages);

#endif
