/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the journal held goes back into the map: events into their owners' rings, queues and points to their places. */
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "map/layout.h"
#include "map/retained.h"
#include "map/supervise.h"

struct restoration {
	struct segment segments[MAP_MODULES_MAX]; /* writable, of owners of points and of the station */
	struct map_queue_place places[MAP_QUEUES];
	map_modules placed[MAP_QUEUES]; /* modules in whose ring the queue has its place */
};

static bool has_part(const struct module_entry *entry)
{
	return entry->point_count > 0 || (entry->plan.flags & MAP_KEEPS_QUEUES) ||
	       entry->plan.history.entries != 0 || entry->plan.retained.names != 0;
}

static bool open_segment(const struct map *map, uint32_t module, struct segment *out)
{
	struct layout layout = layout_of(&map->modules[module]);
	int fd = map_segment_open(map, module);
	void *memory = MAP_FAILED;

	if (fd >= 0) {
		memory = mmap(NULL, layout.size, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
		close(fd);
	}
	if (memory == MAP_FAILED)
		return false;
	segment_place(out, memory, &layout);
	return true;
}

static bool open_segments(const struct map *map, struct restoration *restoration)
{
	for (uint32_t i = 0; i < map_module_count(map); i++)
		if (has_part(&map->modules[i]) && !open_segment(map, i, &restoration->segments[i]))
			return false;
	return true;
}

static void close_segments(struct restoration *restoration)
{
	for (unsigned i = 0; i < MAP_MODULES_MAX; i++)
		if (restoration->segments[i].header)
			munmap(restoration->segments[i].header, restoration->segments[i].size);
}

static void put_event(const struct map *map, struct restoration *restoration,
		      const struct map_kept_event *kept)
{
	uint32_t owner = map_owner(map, kept->event.point);
	const struct ring *ring = &restoration->segments[owner].events;
	struct map_event event = kept->event;

	for (uint32_t queue = 0; queue < MAP_QUEUES; queue++) {
		if (!(kept->wanted & 1u << queue) || (restoration->placed[queue] & map_module_bit(owner)))
			continue;
		restoration->places[queue].cursor.next[owner] = ring_head(ring);
		restoration->placed[queue] |= map_module_bit(owner);
	}
	event.point = slot_of(map, event.point);
	ring_put(ring, &event);
}

/* Of what a queue has acknowledged, or of a group that is new, nothing is sent. */
static void place_at_end(const struct map *map, struct restoration *restoration, uint32_t queue)
{
	for (uint32_t i = 0; i < map_module_count(map); i++)
		if (has_part(&map->modules[i]) && !(restoration->placed[queue] & map_module_bit(i)))
			restoration->places[queue].cursor.next[i] =
			    ring_head(&restoration->segments[i].events);
}

static void put_queue(struct queue_cell *cell, const char *address, const struct map_queue_place *place,
		      uint32_t used)
{
	snprintf(cell->name, sizeof(cell->name), "%s", address);
	atomic_store(&cell->used, used);
	cell->places[latch_whole_copy(&cell->latch)] = *place;
}

static void put_queues(struct map *map, struct restoration *restoration, const struct map_kept *kept)
{
	uint32_t station = MAP_RTUD;

	while (!(map->modules[station].plan.flags & MAP_KEEPS_QUEUES))
		station++;
	for (uint32_t queue = 0; queue < MAP_QUEUES; queue++) {
		if (map_queue_plan(&map->config.settings, queue) == NULL && kept->addresses[queue][0] == '\0')
			continue;
		place_at_end(map, restoration, queue);
		put_queue(&restoration->segments[station].queues[queue], kept->addresses[queue],
			  &restoration->places[queue], queue + 1);
	}
}

/* Nobody writes the segment yet: the latch stays as it is, and its owner's first process makes of it what it can. */
static void put_sample(const struct map *map, const struct restoration *restoration,
		       const struct map_kept_sample *kept)
{
	const struct segment *segment = &restoration->segments[map_owner(map, kept->point)];

	for (int copy = 0; copy < 2; copy++)
		segment->samples[copy][slot_of(map, kept->point)] = kept->sample;
}

/* The latch stays as it is: the first copy is whole. */
static void put_value(const struct map *map, const struct restoration *restoration,
		      const struct map_kept_value *kept)
{
	const uint32_t owner = map_retained_owner(map, kept->name);
	const struct map_retained_plan *plan;
	struct map_retained *retained;

	if (owner == MAP_NONE)
		return;
	plan = &map->modules[owner].plan.retained;
	retained = (void *)((uint8_t *)restoration->segments[owner].own + plan->at);
	map_retained_whole(retained, plan->values)[kept->name - plan->first] =
	    (struct map_retained_value){kept->low, kept->high, kept->quality | MAP_RETAINED_KNOWN};
}

/* Its keeper's first process sees by a start that is none that this is of a former gateway. */
static void put_history(const struct map *map, const struct restoration *restoration,
			const struct map_kept_history *kept)
{
	const uint32_t keeper = map_history_keeper(map);
	const struct map_history_plan *plan;
	struct map_history history;

	if (kept->start == 0 || keeper == MAP_NONE)
		return;
	plan = &map->modules[keeper].plan.history;
	history = map_history_at((uint8_t *)restoration->segments[keeper].own + plan->at, plan->readers,
				 plan->entries);
	history.head->former = kept->start;
	history.head->revision = kept->revision;
	history.head->places[0].next = kept->next;
	for (uint32_t i = 0; i < kept->entry_count; i++)
		history.entries[kept->entries[i].number & (history.size - 1)] = kept->entries[i];
	for (uint32_t i = 0; i < kept->reader_count && i < history.reader_count; i++)
		history.readers[i] = kept->readers[i];
}

int map_restore(struct map *map, const struct map_kept *kept, char *error)
{
	struct restoration restoration = {0};
	bool opened = open_segments(map, &restoration);

	if (!opened)
		snprintf(error, MAP_ERROR_SIZE, "cannot open the map's segments: %s", strerror(errno));
	for (uint32_t i = 0; opened && i < kept->event_count; i++)
		put_event(map, &restoration, &kept->events[i]);
	for (uint32_t i = 0; opened && i < kept->sample_count; i++)
		put_sample(map, &restoration, &kept->samples[i]);
	for (uint32_t i = 0; opened && i < kept->value_count; i++)
		put_value(map, &restoration, &kept->values[i]);
	if (opened) {
		put_queues(map, &restoration, kept);
		put_history(map, &restoration, &kept->history);
	}
	for (uint32_t i = 0; opened && i < map_module_count(map); i++)
		if (has_part(&map->modules[i]))
			map->directory->modules[i].restored = ring_head(&restoration.segments[i].events);
	close_segments(&restoration);
	return opened ? 0 : -1;
}
