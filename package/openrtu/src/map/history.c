/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/history.h"

#include "map/layout.h"

uint32_t map_history_keeper(const struct map *map)
{
	for (uint32_t i = 0; i < map_module_count(map); i++)
		if (map->modules[i].plan.history.entries != 0)
			return i;
	return MAP_NONE;
}

/* Sizes are the plan's, whatever its keeper writes. */
bool map_history(const struct map *map, struct map_history *out)
{
	const uint32_t keeper = map_history_keeper(map);
	const struct map_history_plan *plan;

	if (keeper == MAP_NONE || map->segments[keeper].own == NULL)
		return false;
	plan = &map->modules[keeper].plan.history;
	*out = map_history_at((uint8_t *)map->segments[keeper].own + plan->at, plan->readers, plan->entries);
	return true;
}

bool map_history_read(const struct map_history *history, uint32_t number, struct map_history_entry *out)
{
	const struct map_history_entry *entry = &history->entries[number & (history->size - 1)];

	if (number == 0 || atomic_load_explicit(&entry->number, memory_order_acquire) != number)
		return false;
	*out = *entry;
	atomic_thread_fence(memory_order_acquire);
	return atomic_load_explicit(&entry->number, memory_order_relaxed) == number;
}
