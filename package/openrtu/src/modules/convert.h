/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Between a Modbus object's bits or registers and a point's value. */
#ifndef OPENRTU_MODULES_CONVERT_H
#define OPENRTU_MODULES_CONVERT_H

#include <stdbool.h>
#include <stdint.h>

#include "map/config.h"
#include "map/map.h"

#define CONVERT_WIDTH_MAX 2

/*
 * Fills in value, quality and detail of a sample from the point's registers, or bits as 0 and 1. A
 * value beyond its type is the nearest one with MAP_OVERFLOW. A float that is no number is 0 with
 * MAP_INVALID: devices send that for "no value".
 */
void convert_to_sample(const struct map_point *point, const uint16_t raw[CONVERT_WIDTH_MAX],
		       struct map_sample *sample);

/*
 * Fills in the registers or bits that make the point this value. detail as in struct map_request. False
 * when the point cannot hold it.
 */
bool convert_to_raw(const struct map_point *point, union map_value value, uint8_t detail,
		    uint16_t raw[CONVERT_WIDTH_MAX]);

#endif
