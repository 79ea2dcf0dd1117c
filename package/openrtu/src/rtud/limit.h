/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the lines of a configuration can do at best: docs/limit.md. */
#ifndef OPENRTU_RTUD_LIMIT_H
#define OPENRTU_RTUD_LIMIT_H

#include <stdbool.h>
#include <stdio.h>

#include "map/config.h"
#include "modbus/line.h"

/*
 * The share of the line's time that its reads with a period need when devices react so fast. More than 1 cannot be
 * held; less can, but for one request that is under way when another is due.
 */
double limit_load(const struct modbus_line *line, int64_t reaction_ns);

/*
 * Prints for each line its shortest scan, computed from the read plan that rtu-modbus begins with; with requests,
 * each of them and each device's share too. False without memory.
 */
bool limit_print(const struct map_config *config, bool requests, FILE *out);

#endif
