/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the map's tables say: whose a point is, and which point an address names. */
#include "map/layout.h"

const struct map_config *map_config(const struct map *map)
{
	return &map->config;
}

uint32_t map_self(const struct map *map)
{
	return map->self;
}

uint32_t map_select_timeout_s(const struct map *map)
{
	return atomic_load(&map->directory->select_timeout_s);
}

uint32_t map_command_timeout_s(const struct map *map)
{
	return atomic_load(&map->directory->command_timeout_s);
}

uint32_t map_module_count(const struct map *map)
{
	return map->module_count;
}

uint32_t map_epoch(const struct map *map)
{
	return map->file->epoch;
}

uint32_t map_owner(const struct map *map, uint32_t point)
{
	return map->config.sets[map->config.points[point].set].module;
}

uint32_t map_find(const struct map *map, uint16_t ca, uint32_t ioa)
{
	uint32_t low = 0, high = map->config.point_count;

	while (low < high) {
		uint32_t middle = low + (high - low) / 2;
		uint32_t candidate = map->by_address[middle];
		const struct map_point *point = &map->config.points[candidate];
		uint16_t point_ca = map->config.sets[point->set].ca;

		if (point_ca == ca && point->ioa == ioa)
			return candidate;
		if (point_ca < ca || (point_ca == ca && point->ioa < ioa))
			low = middle + 1;
		else
			high = middle;
	}
	return MAP_NONE;
}
