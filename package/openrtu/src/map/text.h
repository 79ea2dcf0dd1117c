/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Texts of points: what a device calls itself, its serial number, its version. A point with MAP_POINT_TEXT is a bitstring of 32
 * bits that stands for its text: who knows no texts sees by it that there is another one.
 */
#ifndef OPENRTU_MAP_TEXT_H
#define OPENRTU_MAP_TEXT_H

#include "map/map.h"

/*
 * Keeps a text, UTF-8 without control characters and shorter than MAP_TEXT_SIZE, and returns the value of an update that
 * publishes it. Until it is published, readers have the one before. Owner only.
 */
union map_value map_text_put(struct map *map, uint32_t point, const char *text);

/* The text that a value of a point stands for. False: it is older than the one before, or nobody's text, and out is empty. */
bool map_text_of(const struct map *map, uint32_t point, union map_value value, char out[MAP_TEXT_SIZE]);

#endif
