/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What is the same in two configurations, apart from the numbers that its parts have in each. */
#ifndef OPENRTU_RTUD_COMPARE_H
#define OPENRTU_RTUD_COMPARE_H

#include "map/map.h"

/* The key of a setting of all modules that differs; NULL: none does. */
const char *compare_settings(const struct map_settings *a, const struct map_settings *b);
/* The module is planned in the same way, its sets and points are the same, and what its kind knows besides. */
bool compare_modules(const struct map *map, const struct map_config *now, uint32_t module);
/* Modules among the kept ones, a bit each, that refer to points of modules that are not kept: these have moved. */
uint32_t compare_readers(const struct map_config *before, const struct map_config *now, uint32_t kept);
/* The other configuration has the point too: by addresses, name, type and owner. */
bool compare_has_point(const struct map_config *config, const struct map_config *other, uint32_t point);

#endif
