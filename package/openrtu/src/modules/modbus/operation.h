/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a command asks of its device: the Modbus writes, in their order. */
#ifndef OPENRTU_MODULES_MODBUS_OPERATION_H
#define OPENRTU_MODULES_MODBUS_OPERATION_H

#include "map/map.h"
#include "modbus/config.h"
#include "modbus/frame.h"

#define OPERATION_WRITES_MAX 2

struct operation {
	uint8_t count;
	struct modbus_request writes[OPERATION_WRITES_MAX];
};

/*
 * The writes that carry out an accepted request. Two neighbouring coils are one function 15 and two registers one
 * function 16, so that no device ever sees half of a command; of coils that lie apart, the one that goes off is written
 * first. Bits of a register are one function 22, which leaves the others alone. knots: the configuration's. exponent: of the point's
 * raw value, CONVERT_NO_EXPONENT: not known. last: the point's sample, from which a regulating step goes. Returns
 * - MAP_RESULT_NONE: out is filled in;
 * - MAP_RESULT_OUT_OF_RANGE: the point cannot hold the value, or it is beyond the point's min and max;
 * - MAP_RESULT_NOT_COMMANDABLE: no pulse or step of this point, or a step from a value that is not good;
 * - MAP_RESULT_NO_SCALE: its power of ten is not known.
 */
enum map_command_result operation_begin(const struct map_point *point, const struct modbus_point *wire,
					const struct modbus_knot *knots, int8_t exponent, uint8_t unit,
					const struct map_request *request, const struct map_sample *last,
					struct operation *out);

/* The writes that end a pulse of a single or double point: its coils off, or on where they are inverted. */
void operation_end(const struct modbus_point *point, uint8_t unit, struct operation *out);

/*
 * Makes two writes of one function 15 of two coils, for a device that does not know it: that which goes off is written first. False:
 * it is none.
 */
bool operation_divide(struct operation *operation);

/* The write of this point turns a coil on: unanswered, it may have begun a pulse. */
bool operation_switches_on(const struct modbus_point *point, const struct modbus_request *write);

#endif
