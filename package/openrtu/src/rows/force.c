/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rows/rows.h"

#include "map/time_ns.h"
#include "rows/words.h"

json_t *rows_force(const struct map *map, const struct map_force *force)
{
	const struct map_config *config = map_config(map);
	const enum map_type type = config->points[force->point].type;
	const int64_t left_ns = force->until_ns - map_now_ns();
	struct map_sample below = {.quality = MAP_INVALID};
	char quality[WORDS_SIZE], name[MAP_NAME_SIZE];
	json_t *row = json_object();

	map_read_below(map, force->point, &below);
	words_quality(below.quality, quality);
	map_point_name(config, &config->points[force->point], name);
	json_object_set_new(row, "name", json_string(name));
	json_object_set_new(row, "value", words_value(type, &force->value));
	json_object_set_new(row, "below", below.time_ns != 0 ? words_value(type, &below.value) : json_null());
	json_object_set_new(row, "below_quality", json_string(quality));
	json_object_set_new(row, "left_s", json_real(left_ns > 0 ? (double)left_ns / NS_PER_S : 0));
	return row;
}

json_t *rows_force_of_point(const struct map *map, uint32_t point)
{
	struct map_force forces[MAP_FORCES_MAX];
	const unsigned count = map_forces(map, forces);

	for (unsigned i = 0; i < count; i++)
		if (forces[i].point == point)
			return rows_force(map, &forces[i]);
	return json_null();
}
