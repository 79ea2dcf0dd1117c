/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Between a Modbus object's bits or registers and a point's value. */
#ifndef OPENRTU_MODULES_CONVERT_H
#define OPENRTU_MODULES_CONVERT_H

#include <stdbool.h>
#include <stdint.h>

#include "map/config.h"
#include "map/map.h"

#define CONVERT_WIDTH_MAX 4

/*
 * Fills in value, quality and detail of a sample from the point's registers, or bits as 0 and 1. knots: the
 * configuration's. A value beyond its type or its scaling table is the nearest one with MAP_OVERFLOW. A float that is no
 * number, and what a device means by "no value", is 0 with MAP_INVALID. A counter is taken modulo 2^32.
 */
void convert_to_sample(const struct map_point *point, const struct map_knot *knots,
		       const uint16_t raw[CONVERT_WIDTH_MAX], struct map_sample *sample);

/*
 * Fills in the registers or bits that make the point this value; of bits in a register, the register in which all other
 * bits are 0. detail as in struct map_request. False when the point cannot hold it.
 */
bool convert_to_raw(const struct map_point *point, const struct map_knot *knots, union map_value value,
		    uint8_t detail, uint16_t raw[CONVERT_WIDTH_MAX]);

/* The bits of its register that are the point's. */
uint16_t convert_register_mask(const struct map_point *point);

#endif
