/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/type.h"

#include <stdio.h>
#include <stdlib.h>

/* Of a float: the fewest that any has, and those that tell all apart. */
#define DIGITS_LEAST 6
#define DIGITS_MOST  9

#define STANDARD(type, name, width, class, form, low, high, expected)                                        \
	[type] = {name, width, MAP_CLASS_##class, MAP_FORM_##form, low, high, type, expected},
#define OWN(type, name, width, class, form, low, high, carrier, expected)                                    \
	[type] = {name, width, MAP_CLASS_##class, MAP_FORM_##form, low, high, carrier, expected},

const struct map_type_row map_types[MAP_TYPES] = {MAP_STANDARD_TYPES(STANDARD) MAP_OWN_TYPES(OWN)};
const char *const map_type_names[MAP_TYPES + 1] = {MAP_STANDARD_TYPES(MAP_TYPE_NAME)
						       MAP_OWN_TYPES(MAP_TYPE_NAME)};

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
	else if (row->form == MAP_FORM_UNSIGNED)
		out->u = (uint32_t)value;
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
