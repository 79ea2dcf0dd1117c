/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What looks at the map for long follows its configuration (docs/reload.md). */
#ifndef OPENRTU_RTUCTL_RENEW_H
#define OPENRTU_RTUCTL_RENEW_H

#include "map/map.h"

/* True: another configuration is in use here now, so modules, lines and points may have other numbers. */
bool renew_map(struct map *map);

#endif
