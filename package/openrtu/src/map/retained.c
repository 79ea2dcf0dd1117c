/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/retained.h"

#include "map/layout.h"

static bool is_retaining(const struct map_module_plan *plan)
{
	return plan->retained.names != 0 && !(plan->flags & MAP_IS_GONE);
}

struct map_retained *map_retained(const struct map *map, uint32_t module,
				  const struct map_retained_plan **plan)
{
	const struct map_module_plan *module_plan = &map->modules[module].plan;
	uint8_t *own = map->segments[module].own;

	*plan = &module_plan->retained;
	return own == NULL || !is_retaining(module_plan) ? NULL : (void *)(own + module_plan->retained.at);
}

uint32_t map_retained_owner(const struct map *map, uint32_t name)
{
	for (uint32_t i = 0; i < map_module_count(map); i++) {
		const struct map_module_plan *plan = &map->modules[i].plan;

		if (is_retaining(plan) && name - plan->retained.first < plan->retained.names)
			return i;
	}
	return MAP_NONE;
}
