/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the lines of a configuration can do at best: docs/limit.md. */
#ifndef OPENRTU_RTUD_LIMIT_H
#define OPENRTU_RTUD_LIMIT_H

#include <stdbool.h>
#include <stdio.h>

#include "map/config.h"

/*
 * Prints for each line its shortest scan, computed from the read plan that rtu-modbus begins with; with requests,
 * each of them and each device's share too. False without memory.
 */
bool limit_print(const struct map_config *config, bool requests, FILE *out);

#endif
