/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Values of all types as a double, which holds 32 bits and a float exactly. */
#include "lib/handle.h"
#include "map/type.h"

bool value_is_sound(enum map_type type, union map_value value)
{
	union map_value ignored;

	return value_of_number(type, value_number(type, value), &ignored);
}

/* Nor is NaN one. */
static bool is_whole_in_range(enum map_type type, double number)
{
	return number >= map_types[type].low && number <= map_types[type].high &&
	       map_nearest(number) == number;
}

bool value_of_number(enum map_type type, double number, union map_value *out)
{
	switch (map_types[type].class) {
	case MAP_CLASS_STATE:
	case MAP_CLASS_PATTERN:
		if (!is_whole_in_range(type, number))
			return false;
		out->u = (uint32_t)number;
		return true;
	case MAP_CLASS_POSITION:
		if (!is_whole_in_range(type, number))
			return false;
		out->i = (int32_t)number;
		return true;
	case MAP_CLASS_MEASURED:
	case MAP_CLASS_TOTAL:
		break;
	}
	return map_value_of(type, number, out);
}
