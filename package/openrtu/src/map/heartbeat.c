/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a module does again and again, whatever it is. */
#include "map/layout.h"

void map_heartbeat(struct map *map)
{
	map_heartbeat_at(map, map_now_ns());
}

void map_heartbeat_at(struct map *map, int64_t now_ns)
{
	atomic_store_explicit(&map->segments[map->self].header->heartbeat_ms, (uint32_t)(now_ns / NS_PER_MS),
			      memory_order_release);
	log_say_withheld(map, now_ns);
	forces_follow(map);
	requesters_follow(map);
}
