/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What each type of a point is: one row. Whatever differs from type to type is a column here, or a switch without
 * default, so that the compiler finds what a new type lacks.
 */
#ifndef OPENRTU_MAP_TYPE_H
#define OPENRTU_MAP_TYPE_H

#include "map/config.h"

enum map_class {
	MAP_CLASS_STATE,    /* on, off, and what lies between: value.u */
	MAP_CLASS_POSITION, /* of a step: value.i */
	MAP_CLASS_PATTERN,  /* of bits: value.u */
	MAP_CLASS_MEASURED, /* a number with a deadband, limits, a filter */
	MAP_CLASS_TOTAL,    /* what a counter has counted */
};

struct map_type_row {
	const char *name; /* in the configuration and of rtuctl */
	enum map_class class;
	double low, high; /* the least and the greatest value, as it lies in union map_value */
};

/* By enum map_type. */
extern const struct map_type_row map_types[MAP_TYPES];

static inline enum map_class map_class_of(const struct map_point *point)
{
	return map_types[point->type].class;
}

#endif
