/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What other points of its device make of a point's scale, as they are now. */
#ifndef OPENRTU_MODULES_MODBUS_SCALING_H
#define OPENRTU_MODULES_MODBUS_SCALING_H

#include "map/map.h"
#include "modbus/config.h"

struct scaling_read {
	const struct map_update *updates;
	size_t count;
};

/*
 * Puts the factor into wire, which is a copy of the point's. exponent: what its scale register says. Returns the power of ten that
 * holds: CONVERT_NO_EXPONENT where one of these is not known. read: what came in the same answer, and goes before what is published.
 */
int8_t scaling_apply(const struct map *map, uint32_t point, int8_t exponent, struct modbus_point *wire,
		     struct scaling_read read);
/* It names a point that makes its scale: which has to be converted before. */
bool scaling_is_by_others(const struct map_config *config, const struct modbus_point *wire);

#endif
