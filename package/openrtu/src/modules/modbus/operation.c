/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/modbus/operation.h"

#include <string.h>

#include "map/type.h"
#include "modbus/convert.h"

/* What is on there is a coil that is off. */
static bool has_inverted_coils(const struct modbus_point *point)
{
	return (point->flags & MODBUS_INVERTED) != 0;
}

static bool takes_steps(const struct map_point *point)
{
	return point->step > 0;
}

/* A set-point has them with steps or without. */
static bool has_limits(const struct map_point *point)
{
	return point->min < point->max;
}

static bool within_limits(const struct map_point *point, double number)
{
	return number >= (double)point->min && number <= (double)point->max; /* false for NaN too */
}

static bool step_from(const struct map_point *point, union map_value from, int direction, union map_value *to)
{
	double number = map_number((enum map_type)point->type, from) + direction * (double)point->step;

	return within_limits(point, number) && map_value_of((enum map_type)point->type, number, to);
}

/* A pulse that begins with off would end with off, too. */
static bool takes_pulse(const struct modbus_point *point, union map_value value)
{
	return point->table == MODBUS_COILS && (point->type == MAP_DOUBLE || value.u == 1);
}

static struct modbus_request write_of(const struct modbus_point *point, uint8_t unit, uint8_t function,
				      const uint16_t *values, uint16_t count)
{
	struct modbus_request write = {
	    .unit = unit, .function = function, .address = point->address, .count = count};

	memcpy(write.values, values, count * sizeof(*values));
	return write;
}

static struct modbus_request coil(uint8_t unit, uint16_t address, uint16_t value)
{
	return (struct modbus_request){
	    .unit = unit, .function = MODBUS_WRITE_COIL, .address = address, .count = 1, .values = {value}};
}

static void write_two_coils(const struct modbus_point *point, uint8_t unit, const uint16_t raw[2],
			    struct operation *out)
{
	const uint16_t backwards[] = {raw[1], raw[0]};
	struct modbus_request *writes = out->writes;

	if (point->second_address == point->address + 1) {
		*writes = write_of(point, unit, MODBUS_WRITE_COILS, raw, 2);
	} else if (point->second_address == point->address - 1) {
		*writes = write_of(point, unit, MODBUS_WRITE_COILS, backwards, 2);
		writes->address = point->second_address;
	} else {
		unsigned off_first = raw[0] != 0;

		out->count = 2;
		writes[off_first] = coil(unit, point->address, raw[0]);
		writes[!off_first] = coil(unit, point->second_address, raw[1]);
	}
}

bool operation_divide(struct operation *operation)
{
	const struct modbus_request both = operation->writes[0];
	unsigned off_first = both.values[0] != 0;

	if (operation->count != 1 || both.function != MODBUS_WRITE_COILS || both.count != 2)
		return false;
	operation->count = 2;
	operation->writes[off_first] = coil(both.unit, both.address, both.values[0]);
	operation->writes[!off_first] = coil(both.unit, (uint16_t)(both.address + 1), both.values[1]);
	return true;
}

/* The register's other bits stay as they are, whatever the device has made of them since they were read. */
static struct modbus_request write_register_bits(const struct modbus_point *point, uint8_t unit,
						 uint16_t word)
{
	return (struct modbus_request){.unit = unit,
				       .function = MODBUS_MASK_WRITE_REGISTER,
				       .address = point->address,
				       .count = 1,
				       .values = {(uint16_t)~convert_register_mask(point), word}};
}

static void write_raw(const struct modbus_point *point, uint8_t unit, const uint16_t raw[CONVERT_WIDTH_MAX],
		      struct operation *out)
{
	bool single = point->width == 1;

	out->count = 1;
	if (modbus_is_part_of_register(point))
		out->writes[0] = write_register_bits(point, unit, raw[0]);
	else if (point->table != MODBUS_COILS)
		out->writes[0] = write_of(
		    point, unit, single ? MODBUS_WRITE_REGISTER : MODBUS_WRITE_REGISTERS, raw, point->width);
	else if (single)
		out->writes[0] = coil(unit, point->address, raw[0]);
	else
		write_two_coils(point, unit, raw, out);
}

enum map_command_result operation_begin(const struct map_point *point, const struct modbus_point *wire,
					const struct modbus_knot *knots, int8_t exponent, uint8_t unit,
					const struct map_request *request, const struct map_sample *last,
					struct operation *out)
{
	uint16_t raw[CONVERT_WIDTH_MAX] = {0};
	union map_value value = request->value;

	if (exponent == CONVERT_NO_EXPONENT)
		return MAP_RESULT_NO_SCALE;
	if (request->step != 0) {
		if (!takes_steps(point) || last->quality != MAP_GOOD)
			return MAP_RESULT_NOT_COMMANDABLE;
		if (!step_from(point, last->value, request->step > 0 ? 1 : -1, &value))
			return MAP_RESULT_OUT_OF_RANGE;
	}
	if (request->pulse_ms != 0 && !takes_pulse(wire, value))
		return MAP_RESULT_NOT_COMMANDABLE;
	if ((has_limits(point) && !within_limits(point, map_number((enum map_type)point->type, value))) ||
	    !convert_to_raw(wire, knots, exponent, value, request->detail, raw))
		return MAP_RESULT_OUT_OF_RANGE;
	write_raw(wire, unit, raw, out);
	return MAP_RESULT_NONE;
}

void operation_end(const struct modbus_point *point, uint8_t unit, struct operation *out)
{
	uint16_t off = has_inverted_coils(point);

	write_raw(point, unit, (const uint16_t[CONVERT_WIDTH_MAX]){off, off}, out);
}

bool operation_switches_on(const struct modbus_point *point, const struct modbus_request *write)
{
	uint16_t off = has_inverted_coils(point);

	return write->values[0] != off || (write->count > 1 && write->values[1] != off);
}
