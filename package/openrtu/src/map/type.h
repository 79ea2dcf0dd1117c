/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What each type of a point is: one row. Whatever differs from type to type is a column here, or a switch without
 * default, so that the compiler finds what a new type lacks. The rows are in map/codes.h.
 */
#ifndef OPENRTU_MAP_TYPE_H
#define OPENRTU_MAP_TYPE_H

#include "map/value.h"

enum map_class {
	MAP_CLASS_STATE,    /* on, off, and what lies between: value.u */
	MAP_CLASS_POSITION, /* of a step: value.i */
	MAP_CLASS_PATTERN,  /* of bits: value.u */
	MAP_CLASS_MEASURED, /* a number with a deadband, limits, a filter */
	MAP_CLASS_TOTAL,    /* what a counter has counted */
};

/* How people read and write a value. */
enum map_form {
	MAP_FORM_SINGLE,   /* on, off */
	MAP_FORM_DOUBLE,   /* on, off; read: intermediate, indeterminate too */
	MAP_FORM_SIGNED,   /* value.i */
	MAP_FORM_UNSIGNED, /* value.u */
	MAP_FORM_FRACTION, /* value.i / 32768 */
	MAP_FORM_FLOAT,    /* value.f, with the digits that it needs */
	MAP_FORM_DEGREES,  /* value.i / MAP_ANGLE_PER_DEGREE, with 7 decimals */
};

struct map_type_row {
	const char *name; /* in the configuration and of rtuctl */
	uint8_t width;    /* bits of a value */
	enum map_class class;
	enum map_form form;
	double low, high; /* the least and the greatest value, as it lies in union map_value */
	enum map_type
	    carrier; /* the type of IEC 60870-5-101 that carries one; of those that it has, the same */
	const char *expected; /* what people may write, in words */
};

/* By enum map_type. */
extern const struct map_type_row map_types[MAP_TYPES];
/* Their names, and NULL: for a key of the configuration whose value is a type (config/keys.h, CONFIG_CHOICE). */
extern const char *const map_type_names[MAP_TYPES + 1];

static inline enum map_class map_class_of(const struct map_point *point)
{
	return map_types[point->type].class;
}

/*
 * A number as a measured value or a counter of this type has it, rounded; of an angle in degrees. False: the type cannot hold
 * it, or it is none; out is not written then.
 */
bool map_value_of(enum map_type type, double number, union map_value *out);

/* The number with the fewest digits that is this one as a float: 0.1, where (double)0.1f is 0.10000000149. */
double map_shortest(float value);

#endif
