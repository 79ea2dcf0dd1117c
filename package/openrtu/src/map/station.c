/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The controlled station's part of the map: event queues and counters. */
#include "map/station.h"

#include <stdio.h>
#include <string.h>

#include "map/layout.h"
#include "map/time_ns.h"

static const struct segment *segment_of_queues(const struct map *map)
{
	uint32_t module = 0;

	while (!(map->modules[module].plan.flags & MAP_KEEPS_QUEUES))
		module++;
	return &map->segments[module];
}

static struct queue_cell *queue_cell(const struct map *map, unsigned slot)
{
	return &segment_of_queues(map)->queues[slot];
}

/* ---- event queues ------------------------------------------------------------------------ */

/* A place ahead of a ring's head cannot be: read as it stands, it would count as four thousand million events lost. */
static void check_place(const struct map *map, struct map_queue_place *place)
{
	for (uint32_t i = 0; i < map_module_count(map); i++) {
		uint32_t head = ring_head(&map->segments[i].events);

		if ((int32_t)(head - place->cursor.next[i]) >= 0)
			continue;
		place->cursor.next[i] = head;
		place->refresh_all = true;
	}
	place->cursor.lost = 0;
}

void map_queue_place(const struct map *map, unsigned slot, struct map_queue_place *out)
{
	struct queue_cell *cell = queue_cell(map, slot);

	/* Where its owner acknowledges faster than this reads, any of its places will do. */
	latch_load(&cell->latch, cell->places, out, sizeof(*out));
	check_place(map, out);
}

void map_queue_move(struct map *map, unsigned slot, const struct map_queue_place *place)
{
	struct queue_cell *cell = queue_cell(map, slot);

	if (memcmp(&cell->places[latch_whole_copy(&cell->latch)], place, sizeof(*place)) == 0)
		return;
	cell->places[!latch_whole_copy(&cell->latch)] = *place;
	latch_flip(&cell->latch);
}

void map_queue_use(struct map *map, unsigned slot)
{
	uint32_t last = 0;

	for (unsigned i = 0; i < MAP_QUEUES; i++)
		if (atomic_load(&queue_cell(map, i)->used) > last)
			last = atomic_load(&queue_cell(map, i)->used);
	atomic_store(&queue_cell(map, slot)->used, last + 1);
}

void map_queue_assign(struct map *map, unsigned slot, const char *address,
		      const struct map_queue_place *place)
{
	struct queue_cell *cell = queue_cell(map, slot);

	cell->name[0] = '\0'; /* free, should the process be killed before the name is there again */
	atomic_thread_fence(memory_order_release);
	map_queue_move(map, slot, place);
	atomic_store(&cell->lost, 0);
	atomic_store(&cell->unacknowledged, 0);
	snprintf(cell->name + 1, sizeof(cell->name) - 1, "%s", address + 1);
	atomic_thread_fence(memory_order_release);
	cell->name[0] = address[0];
}

void map_queue_count_lost(struct map *map, unsigned slot, uint32_t events)
{
	map_count(&queue_cell(map, slot)->lost, events);
}

void map_queue_set_unacknowledged(struct map *map, unsigned slot, uint32_t events)
{
	atomic_store_explicit(&queue_cell(map, slot)->unacknowledged, events, memory_order_relaxed);
}

void map_queue_free(struct map *map, unsigned slot)
{
	struct queue_cell *cell = queue_cell(map, slot);

	cell->name[0] = '\0';
	atomic_store(&cell->used, 0);
}

/* ---- named queues ------------------------------------------------------------------------ */

#define GONE "\177" /* which no name is: of a queue that the configuration has no more */

/* What the place is named after; empty: nobody has named it since the map's start, where the journal may have set it. */
static bool is_named(const struct map *map, unsigned slot, const char *name)
{
	return strncmp(queue_cell(map, slot)->name, name, MAP_ADDRESS_SIZE) == 0;
}

static bool is_adopted(const struct map *map, unsigned slot)
{
	const struct map_queue_plan *plan = map_queue_plan(&map->config.settings, slot);

	return plan != NULL && (is_named(map, slot, "") || is_named(map, slot, plan->name));
}

/* The place comes before the name: whoever is killed between them leaves no name at another's place. */
void map_queue_adopt(struct map *map, unsigned slot, const struct map_queue_place *anew)
{
	const struct map_queue_plan *plan = map_queue_plan(&map->config.settings, slot);
	const char *name = plan != NULL ? plan->name : GONE;
	struct map_queue_place place = *anew;

	if (is_named(map, slot, name))
		return;
	if (is_adopted(map, slot))
		map_queue_place(map, slot, &place);
	else
		map_queue_move(map, slot, &place);
	map_queue_assign(map, slot, name, &place);
}

/* ---- queues of addresses ------------------------------------------------------------------ */

static bool is_address_character(char c)
{
	return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f') || c == '.' || c == ':';
}

/* The name is its writer's: what is no address is not shown, and not looked for. */
static void copy_address(char to[MAP_ADDRESS_SIZE], const char *from)
{
	memcpy(to, from, MAP_ADDRESS_SIZE);
	to[MAP_ADDRESS_SIZE - 1] = '\0';
	for (const char *c = to; *c != '\0'; c++)
		if (!is_address_character(*c))
			to[0] = '\0';
}

void map_queue(const struct map *map, unsigned slot, struct map_queue *out)
{
	const struct map_settings *settings = &map->config.settings;
	const struct queue_cell *cell = queue_cell(map, slot);
	struct map_queue_place place;

	map_queue_place(map, slot, &place);
	*out = (struct map_queue){
	    .limit = map_queue_limit(settings, slot),
	    .waiting = map_events_behind(map, &place.cursor),
	    .unacknowledged = atomic_load(&cell->unacknowledged),
	    .lost = atomic_load(&cell->lost),
	    .used = atomic_load(&cell->used),
	};
	if (slot >= MAP_NAMED_QUEUES_MAX)
		copy_address(out->name, cell->name);
	else if (is_adopted(map, slot))
		memcpy(out->name, map_queue_plan(settings, slot)->name, MAP_NAME_SIZE);
	if (out->unacknowledged > out->waiting)
		out->unacknowledged = out->waiting;
}
