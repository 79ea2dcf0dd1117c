/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Words by which modules ask the one that coordinates their scans. */
#include "map/layout.h"

void map_synch_say(struct map *map, uint32_t number, uint32_t word)
{
	atomic_store_explicit(&map->segments[map->self].header->synch[number], word, memory_order_release);
	for (uint32_t i = 0; i < map_module_count(map); i++)
		if (map->modules[i].plan.flags & MAP_COORDINATES)
			bell_ring(map, i);
}

uint32_t map_synch_said(const struct map *map, uint32_t module, uint32_t number)
{
	return atomic_load_explicit(&map->segments[module].header->synch[number], memory_order_acquire);
}

void map_synch_ring(const struct map *map, uint32_t module)
{
	bell_ring(map, module);
}
