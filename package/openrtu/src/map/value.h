/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A value of a point, and what number it is. */
#ifndef OPENRTU_MAP_VALUE_H
#define OPENRTU_MAP_VALUE_H

#include <float.h>
#include <stdint.h>

#include "config.h"

#define MAP_TEXT_SIZE                                                                                        \
	132 /* of a point's text: 64 characters of two octets of UTF-8 and the terminator, in words */

union map_value {
	int32_t i;
	uint32_t u;
	float f;
};

/* A measured value or a counter as a number; an angle in degrees. The reverse is map_value_of (map/type.h). */
static inline double map_number(enum map_type type, union map_value value)
{
	if (type == MAP_FLOAT)
		return (double)value.f;
	return type == MAP_ANGLE ? value.i / (double)MAP_ANGLE_PER_DEGREE : value.i;
}

/* The nearest whole number, of two the even one, as rint: libm for this alone was 0.4 MiB in each process's memory. */
static inline double map_nearest(double number)
{
	_Static_assert(FLT_EVAL_METHOD == 0, "a double has 53 bits here");
	const double no_fraction = 0x1p52; /* numbers of this size have no place for one */

	if (number >= no_fraction || number <= -no_fraction)
		return number;
	return number < 0 ? number - no_fraction + no_fraction : number + no_fraction - no_fraction;
}

static inline bool map_is_whole(double number)
{
	return !(number < map_nearest(number)) && !(number > map_nearest(number));
}

static inline int32_t map_round(double number)
{
	return (int32_t)map_nearest(number);
}

#endif
