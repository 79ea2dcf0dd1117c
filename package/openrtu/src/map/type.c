/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/type.h"

#include <stdio.h>
#include <stdlib.h>

/* Of a float: the fewest that any has, and those that tell all apart. */
#define DIGITS_LEAST 6
#define DIGITS_MOST  9

#define HALF_TURN (180.0 * MAP_ANGLE_PER_DEGREE)

/* type, name, width, class, form, low, high, expected */
#define TYPES(ROW)                                                                                           \
	ROW(MAP_SINGLE, "single", 1, MAP_CLASS_STATE, MAP_FORM_SINGLE, 0, 1, "on or off")                    \
	ROW(MAP_DOUBLE, "double", 2, MAP_CLASS_STATE, MAP_FORM_DOUBLE, 0, 3, "on or off")                    \
	ROW(MAP_STEP, "step", 7, MAP_CLASS_POSITION, MAP_FORM_SIGNED, -64, 63, "an integer from -64 to 63")  \
	ROW(MAP_BITSTRING, "bitstring", 32, MAP_CLASS_PATTERN, MAP_FORM_UNSIGNED, 0, UINT32_MAX,             \
	    "an integer from 0 to 0xffffffff")                                                               \
	ROW(MAP_NORMALIZED, "normalized", 16, MAP_CLASS_MEASURED, MAP_FORM_FRACTION, INT16_MIN, INT16_MAX,   \
	    "a number from -1 to 0.99997")                                                                   \
	ROW(MAP_SCALED, "scaled", 16, MAP_CLASS_MEASURED, MAP_FORM_SIGNED, INT16_MIN, INT16_MAX,             \
	    "an integer from -32768 to 32767")                                                               \
	ROW(MAP_FLOAT, "float", 32, MAP_CLASS_MEASURED, MAP_FORM_FLOAT, -FLT_MAX, FLT_MAX, "a number")       \
	ROW(MAP_COUNTER, "counter", 32, MAP_CLASS_TOTAL, MAP_FORM_SIGNED, INT32_MIN, INT32_MAX,              \
	    "an integer from -2147483648 to 2147483647")                                                     \
	ROW(MAP_INTEGER, "integer", 32, MAP_CLASS_MEASURED, MAP_FORM_SIGNED, INT32_MIN, INT32_MAX,           \
	    "an integer from -2147483648 to 2147483647")                                                     \
	ROW(MAP_ANGLE, "angle", 32, MAP_CLASS_MEASURED, MAP_FORM_DEGREES, -HALF_TURN, HALF_TURN,             \
	    "degrees from -180 to 180")

#define AS_ROW(type, name, width, class, form, low, high, expected)                                          \
	[type] = {name, width, class, form, low, high, expected},
#define AS_NAME(type, name, width, class, form, low, high, expected) [type] = name,

const struct map_type_row map_types[MAP_TYPES] = {TYPES(AS_ROW)};
const char *const map_type_names[MAP_TYPES + 1] = {TYPES(AS_NAME)};

bool map_value_of(enum map_type type, double number, union map_value *out)
{
	const struct map_type_row *row = &map_types[type];
	double value = number;

	if (type == MAP_ANGLE)
		value *= MAP_ANGLE_PER_DEGREE;
	if (type != MAP_FLOAT)
		value = map_nearest(value);
	if (!(value >= row->low && value <= row->high)) /* nor a NaN */
		return false;
	if (type == MAP_FLOAT)
		out->f = (float)value;
	else
		out->i = (int32_t)value;
	return true;
}

double map_shortest(float value)
{
	char text[32];

	for (int digits = DIGITS_LEAST; digits < DIGITS_MOST; digits++) {
		snprintf(text, sizeof(text), "%.*g", digits, (double)value);
		if (!(strtof(text, NULL) < value) && !(strtof(text, NULL) > value))
			return strtod(text, NULL);
	}
	return (double)value;
}
