/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Between a Modbus object's bits or registers and a point's value. */
#ifndef OPENRTU_MODBUS_CONVERT_H
#define OPENRTU_MODBUS_CONVERT_H

#include <stdbool.h>
#include <stdint.h>

#include "map/config.h"
#include "map/map.h"
#include "modbus/config.h"

#define CONVERT_WIDTH_MAX 4
/* In the place of a power of ten: it is not known, or the device has none. */
#define CONVERT_NO_EXPONENT INT8_MIN
/* As of SunSpec's sunssf; 0x8000, which means that there is none, is beyond it too. */
#define CONVERT_EXPONENT_MAX 10

/* The power of ten of a point before anything was read: 0 without a scale register. */
int8_t convert_first_exponent(const struct modbus_point *point);

/* What a scale register says (SunSpec's sunssf): -10 .. 10, else CONVERT_NO_EXPONENT. */
int8_t convert_exponent(const struct modbus_point *point, uint16_t word);

/*
 * Fills in value, quality and detail of a sample from the point's registers, or bits as 0 and 1. knots: the
 * configuration's. exponent: the raw number counts ten to its power; without one, a number is invalid. A value beyond its type or its scaling table is the nearest one with MAP_OVERFLOW. A float that is no
 * number, and what a device means by "no value", is 0 with MAP_INVALID. A counter is taken modulo 2^32.
 */
void convert_to_sample(const struct modbus_point *point, const struct modbus_knot *knots, int8_t exponent,
		       const uint16_t raw[CONVERT_WIDTH_MAX], struct map_sample *sample);

/*
 * Fills in the registers or bits that make the point this value; of bits in a register, the register in which all other
 * bits are 0. exponent: not CONVERT_NO_EXPONENT. detail as in struct map_request. False when the point cannot hold it.
 */
bool convert_to_raw(const struct modbus_point *point, const struct modbus_knot *knots, int8_t exponent,
		    union map_value value, uint8_t detail, uint16_t raw[CONVERT_WIDTH_MAX]);

/* The bits of its register that are the point's. */
uint16_t convert_register_mask(const struct modbus_point *point);

#endif
