/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the values of a point are called: those of a mode or a state, as its device's manual has them. */
#ifndef OPENRTU_MAP_MEANING_H
#define OPENRTU_MAP_MEANING_H

#include <stdbool.h>

#include "map/config.h"
#include "map/value.h"

#define MAP_MEANING_SIZE 32 /* terminator included */
#define MAP_MEANINGS     MAP_SECTION_ID('M', 'E', 'A', 'N')

/* In the order of the points, and of a point's numbers. A configuration without any has no such section. */
struct map_meaning {
	uint32_t point;
	int32_t number;
	char text[MAP_MEANING_SIZE];
};

/* How many of the records are the point's, the first of which is *first; 0: its values have no names. */
uint32_t map_meanings_of(const struct map_config *config, uint32_t point, const struct map_meaning **first);
/* "": this value has none. */
const char *map_meaning(const struct map_config *config, uint32_t point, union map_value value);
/* The value that is called that. False: none is. */
bool map_meaning_value(const struct map_config *config, uint32_t point, const char *text,
		       union map_value *out);
/* A command may give it: one that has a name, where values have some. */
bool map_meaning_allows(const struct map_config *config, uint32_t point, union map_value value);

#endif
