/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What is the same in two configurations, apart from the numbers that its parts have in each. */
#ifndef OPENRTU_RTUD_COMPARE_H
#define OPENRTU_RTUD_COMPARE_H

#include "map/map.h"
#include "modules/kind.h"

/* A setting that holds for all modules. */
struct compare_setting {
	const char *key;
	const char *because; /* it needs a restart of rtud; NULL: it is taken as all runs */
};

/* One that differs, from number *next on, which moves behind it; NULL: there is no more. */
const struct compare_setting *compare_settings(const struct map_settings *a, const struct map_settings *b,
					       uint32_t *next);
/* What becomes of a module that both have: how it is planned, its sets and points, and what its kind knows besides. */
enum kind_change compare_modules(const struct map *map, const struct map_config *now, uint32_t module);
/*
 * Modules among the kept ones, a bit each, that have to be exchanged for the sake of others: who refers to points of modules
 * that are not kept, since these have moved, and who carries out commands of such a module, whose segment he has mapped.
 */
map_modules compare_others(const struct map *map, const struct map_config *now, map_modules kept);
/* Modules among the kept ones that start again. moved: numbers of points may have changed. */
map_modules compare_again(const struct map *map, const struct map_config *now, map_modules kept, bool moved);
/* The other configuration has the point too: by addresses, name, type and owner. */
bool compare_has_point(const struct map_config *config, const struct map_config *other, uint32_t point);

#endif
