/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a device says that it is, and where that is not what the configuration says. */
#ifndef OPENRTU_ROWS_IDENTITY_H
#define OPENRTU_ROWS_IDENTITY_H

#include <jansson.h>

#include "map/map.h"

void rows_add_identity(json_t *row, const struct map *map, uint32_t device);

#endif
