/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the lines of a configuration can do at best: docs/limit.md. */
#ifndef OPENRTU_MODBUS_LIMIT_H
#define OPENRTU_MODBUS_LIMIT_H

#include <stdbool.h>
#include <stdio.h>

#include "map/config.h"
#include "modbus/line.h"

/* What a read takes when its device reacts as fast as it is known or assumed to, or at once. */
int64_t modbus_limit_read_ns(const struct modbus_line *line, const struct modbus_device *device,
			     const struct modbus_read *read, bool at_once);

/*
 * The share of the line's time that its reads and its own writes with a period need. More than 1 cannot be held; less can, but for one
 * request that is under way when another is due.
 */
double modbus_limit_load(const struct modbus_line *line, bool at_once);

/*
 * Prints for each line its shortest scan, computed from the read plan that rtu-modbus begins with; with requests,
 * each of them and each device's share too. False without memory.
 */
bool modbus_limit_print(const struct map_config *config, bool requests, FILE *out);

#endif
