/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "logic/value.h"

#include "map/type.h"

#define NORMALIZED_ONE 32768.0 /* NVA of 1.0, which is just beyond its range: IEC 60870-5-101, 7.2.6.6 */

enum { INTERMEDIATE, OFF, ON };

static bool is_real(enum logic_type type)
{
	return type == LOGIC_REAL || type == LOGIC_LREAL;
}

static bool is_integer(enum logic_type type)
{
	return type >= LOGIC_SINT && type <= LOGIC_UDINT;
}

static bool is_pattern(enum logic_type type)
{
	return type >= LOGIC_BYTE && type <= LOGIC_DWORD;
}

/* A fraction of a number: an integer would lose it. */
static bool has_fractions(enum map_type map_type)
{
	return map_type == MAP_FLOAT || map_type == MAP_ANGLE;
}

/* All that the map's type has is in the range of the program's. */
static bool holds_all(enum map_type map_type, enum logic_type type)
{
	return (double)logic_ranges[type].low <= map_types[map_type].low &&
	       (double)logic_ranges[type].high >= map_types[map_type].high;
}

bool logic_value_fits(enum map_type map_type, enum logic_type type, bool written)
{
	enum map_class class = map_types[map_type].class;

	if (type == LOGIC_BOOL)
		return class == MAP_CLASS_STATE;
	if (is_real(type))
		return class == MAP_CLASS_MEASURED || class == MAP_CLASS_POSITION || class == MAP_CLASS_TOTAL;
	if (is_pattern(type))
		return class == MAP_CLASS_PATTERN && (written || holds_all(map_type, type));
	return is_integer(type) && map_type != MAP_SINGLE && !has_fractions(map_type) &&
	       (written || holds_all(map_type, type));
}

unsigned logic_map_type(enum logic_type type)
{
	if (type == LOGIC_BOOL)
		return MAP_SINGLE;
	if (is_pattern(type))
		return MAP_BITSTRING;
	if (is_real(type))
		return MAP_FLOAT;
	if (type == LOGIC_SINT || type == LOGIC_INT || type == LOGIC_USINT)
		return MAP_SCALED;
	return type == LOGIC_DINT || type == LOGIC_UINT ? MAP_INTEGER : MAP_TYPES;
}

bool logic_number(enum map_type map_type, enum logic_type type, union map_value value, double *out)
{
	enum map_class class = map_types[map_type].class;

	*out = class == MAP_CLASS_STATE || class == MAP_CLASS_PATTERN ? value.u : map_number(map_type, value);
	if (map_type == MAP_NORMALIZED && is_real(type))
		*out /= NORMALIZED_ONE;
	if (map_type != MAP_DOUBLE || type != LOGIC_BOOL)
		return true;
	*out = value.u == ON;
	return value.u == OFF || value.u == ON;
}

bool logic_map_value(enum map_type map_type, enum logic_type type, double number, union map_value *out)
{
	const struct map_type_row *row = &map_types[map_type];
	double wanted = number;

	if (type == LOGIC_BOOL && wanted != 0 && wanted != 1)
		return false;
	if (map_type == MAP_DOUBLE && type == LOGIC_BOOL)
		wanted = wanted != 0 ? ON : OFF;
	if (map_type == MAP_NORMALIZED && is_real(type))
		wanted *= NORMALIZED_ONE;
	if (map_type == MAP_ANGLE)
		wanted *= MAP_ANGLE_PER_DEGREE;
	if (map_type != MAP_FLOAT)
		wanted = map_nearest(wanted);
	number = wanted < row->low ? row->low : wanted > row->high ? row->high : wanted;
	if (map_type == MAP_FLOAT)
		out->f = (float)number;
	else if (row->low < 0)
		out->i = (int32_t)number;
	else
		out->u = (uint32_t)number;
	return number == wanted;
}

void logic_take_sample(enum map_type map_type, enum logic_type type, const struct map_sample *sample,
		       struct logic_value *out)
{
	double number;

	out->quality = sample->quality;
	if (!logic_number(map_type, type, sample->value, &number))
		out->quality |= LOGIC_INVALID;
	out->value.bits = 0;
	if (type == LOGIC_REAL)
		out->value.r = (float)number;
	else if (type == LOGIC_LREAL)
		out->value.d = number;
	else
		out->value.i = (int64_t)number;
}

void logic_make_sample(enum map_type map_type, enum logic_type type, const struct logic_value *value,
		       struct map_sample *out)
{
	double number = type == LOGIC_REAL    ? (double)value->value.r
			: type == LOGIC_LREAL ? value->value.d
					      : (double)value->value.i;

	out->quality = value->quality;
	if (!logic_map_value(map_type, type, number, &out->value))
		out->quality |= MAP_OVERFLOW;
}
