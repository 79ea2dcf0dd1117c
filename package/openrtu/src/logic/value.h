/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a point of the map is in a program, and what a program's value is in the map: docs/logic.md, "Types". */
#ifndef OPENRTU_LOGIC_VALUE_H
#define OPENRTU_LOGIC_VALUE_H

#include "logic/logic.h"
#include "map/map.h"

/* A program may have a point of this type of the map as a variable of that type; written: it is the program's own. */
bool logic_value_fits(enum map_type map_type, enum logic_type type, bool written);
/* The type of a program's own point whose type the file does not name; MAP_TYPES: it has to. */
unsigned logic_map_type(enum logic_type type);

/* The number that a program sees. False: it has none for this value, such as BOOL for a double point between its ends. */
bool logic_number(enum map_type map_type, enum logic_type type, union map_value value, double *out);
/* The nearest value that the point can have. False: the number is beyond it. */
bool logic_map_value(enum map_type map_type, enum logic_type type, double number, union map_value *out);

/* Time is left to the caller. */
void logic_take_sample(enum map_type map_type, enum logic_type type, const struct map_sample *sample,
		       struct logic_value *out);
void logic_make_sample(enum map_type map_type, enum logic_type type, const struct logic_value *value,
		       struct map_sample *out);

#endif
