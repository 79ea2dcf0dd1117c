/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_CONFIG_ZONE_H
#define OPENRTU_CONFIG_ZONE_H

#include "map/config.h"

/* Reads a POSIX TZ string with its rules, as "CET-1CEST,M3.5.0,M10.5.0/3". False: it is none. */
bool config_read_zone(const char *text, struct map_zone *zone);

#endif
