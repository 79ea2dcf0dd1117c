/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a module does again and again, whatever it is. */
#include "map/layout.h"

void map_heartbeat(struct map *map)
{
	atomic_store_explicit(&map->segments[map->self].header->heartbeat_ms, now_ms(), memory_order_release);
	forces_follow(map);
	requesters_follow(map);
}
