/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Values of all types as a double, which holds 32 bits and a float exactly. */
#include "lib/handle.h"
#include "map/type.h"

double value_number(enum map_type type, union map_value value)
{
	switch (map_types[type].class) {
	case MAP_CLASS_STATE:
	case MAP_CLASS_PATTERN:
		return value.u;
	case MAP_CLASS_POSITION:
		return value.i;
	case MAP_CLASS_MEASURED:
	case MAP_CLASS_TOTAL:
		break;
	}
	return map_number(type, value);
}

bool value_of_number(enum map_type type, double number, union map_value *out)
{
	const struct map_type_row *row = &map_types[type];

	if (!(number >= row->low && number <= row->high)) /* nor is it NaN */
		return false;
	switch (row->class) {
	case MAP_CLASS_STATE:
	case MAP_CLASS_PATTERN:
		if (map_nearest(number) != number)
			return false;
		out->u = (uint32_t)number;
		return true;
	case MAP_CLASS_POSITION:
		if (map_nearest(number) != number)
			return false;
		break;
	case MAP_CLASS_MEASURED:
	case MAP_CLASS_TOTAL:
		break;
	}
	if (type == MAP_FLOAT)
		out->f = (float)number;
	else
		out->i = map_round(number);
	return true;
}
