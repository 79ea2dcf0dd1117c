/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What is in the map as rows of JSON: those of rtuctl --json, and those that rtu-web sends. Each is a new reference, NULL
 * without memory.
 */
#ifndef OPENRTU_ROWS_ROWS_H
#define OPENRTU_ROWS_ROWS_H

#include <jansson.h>

#include "map/map.h"

/* How they are written: an angle needs 10 digits to be read back, a 32-bit float 9. */
#define ROWS_FORMAT JSON_REAL_PRECISION(10)

/* A value of a point: its text, where it has one; null of one that the map has no longer. */
json_t *rows_value(const struct map *map, uint32_t point, const union map_value *value);
/* Its type, or "text". */
json_t *rows_type(const struct map_config *config, uint32_t point);
/* What a value is called, if it has a name. */
void rows_set_meaning(json_t *row, const char *key, const struct map_config *config, uint32_t point,
		      union map_value value);

json_t *rows_point(const struct map *map, uint32_t index);
/* Of a point that has one. */
json_t *rows_command(const struct map *map, uint32_t index);
json_t *rows_module(const struct map *map, uint32_t index);
/* A line with the rows of its devices; index: among the ports of the configuration. */
json_t *rows_line(const struct map *map, uint32_t index);
json_t *rows_device(const struct map *map, uint32_t index);
json_t *rows_counter(const char *module, const struct map_counter *counter);
json_t *rows_event(const struct map *map, const struct map_event *event);
json_t *rows_log(const struct map *map, uint32_t module, const struct map_log_line *line);
json_t *rows_force(const struct map *map, const struct map_force *force);
/* What forces a point; null: nothing does. */
json_t *rows_force_of_point(const struct map *map, uint32_t point);

/* ---- parts of them ----------------------------------------------------------------------- */

json_t *rows_point_name(const struct map_config *config, uint32_t point);
/* null: there is no such module. */
json_t *rows_module_name(const struct map *map, uint32_t index);
/* Seconds since a time of the map; null when there was none. */
json_t *rows_age(int64_t time_ns);
/* Microseconds as milliseconds. */
json_t *rows_milliseconds(uint32_t us);

#endif
