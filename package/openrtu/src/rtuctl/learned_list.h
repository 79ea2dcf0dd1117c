/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_RTUCTL_LEARNED_LIST_H
#define OPENRTU_RTUCTL_LEARNED_LIST_H

#include "map/map.h"

/* Prints a table with a row for each device: what its line's process has learned of it. */
void learned_list(const struct map *map);

#endif
