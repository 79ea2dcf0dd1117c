/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_RTUCTL_IDENTITY_LIST_H
#define OPENRTU_RTUCTL_IDENTITY_LIST_H

#include "map/map.h"

/* Prints nothing where no device has said anything. */
void identity_list(const struct map *map);

#endif
