/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Bells: a pipe for each module, which others ring when they have left something for it. */
#include <string.h>
#include <unistd.h>

#include "map/layout.h"

/* Of a real-time module, by others: fifteen commands within 25 ms, which no line carries out. A wake-up is most of the cost. */
#define LOAD_A_PERIOD  256
#define LOAD_OF_A_RING 16

int map_bell_fd(const struct map *map)
{
	return map->segments[map->self].bell;
}

/* One read: who rings faster than it empties the pipe is heard again, and holds nobody up. */
bool map_bell_clear(struct map *map)
{
	char heard[4096];
	ssize_t rings = read(map_bell_fd(map), heard, sizeof(heard));

	map->load += map->taken + (rings > 0 ? LOAD_OF_A_RING : 0);
	map->taken = 0;
	memset(map->taken_of, 0, sizeof(map->taken_of));
	return rings > 0;
}

void map_bell_clear_if_taken(struct map *map)
{
	if (map->taken != 0)
		map_bell_clear(map);
}

bool map_bell_is_wild(const struct map *map)
{
	return map->load >= LOAD_A_PERIOD;
}

void map_bell_new_period(struct map *map)
{
	map->load = 0;
}

void bell_ring(const struct map *map, uint32_t module)
{
	ssize_t written = write(map->segments[module].bell, "", 1);

	(void)written; /* a full pipe has been heard already */
}

void bell_ring_event_readers(const struct map *map)
{
	for (uint32_t i = 0; i < map_module_count(map); i++)
		if ((map->modules[i].plan.flags & (MAP_HEARS_EVENTS | MAP_IS_GONE)) == MAP_HEARS_EVENTS)
			bell_ring(map, i);
}
