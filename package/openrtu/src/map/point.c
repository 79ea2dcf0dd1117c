/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Points, what their owner puts right after a former generation, and events. */
#include <string.h>

#include "map/layout.h"

/* A time that cannot be true is of a writer gone wild. */
static struct map_sample believed(const struct map *map, struct map_sample sample, bool alive)
{
	if (!is_past(map, sample.time_ns))
		return (struct map_sample){.quality = MAP_INVALID};
	if (!alive)
		sample.quality |= MAP_INVALID;
	return sample;
}

bool map_read_changed(const struct map *map, const uint32_t *points, size_t count, struct map_seen *seen,
		      struct map_sample *out)
{
	const uint32_t owner = map_owner(map, points[0]);
	const struct segment *segment = &map->segments[owner];
	const uint32_t slots = slot_of(map, points[0]) - points[0]; /* a set's points lie side by side */
	map_latch *latch = latch_of(map, points[0]);

	for (int tries = 0; tries < LATCH_TRIES; tries++) {
		const bool alive = map_alive(map, owner); /* first, as in map_read */
		const uint32_t sequence = latch_read_begin(latch);

		if (seen->whole && seen->sequence == sequence && seen->alive == alive)
			return false;
		for (size_t i = 0; i < count; i++)
			out[i] = segment->samples[sequence & 1][points[i] + slots];
		if (!latch_read_done(latch, sequence))
			continue;
		for (size_t i = 0; i < count; i++)
			out[i] = believed(map, out[i], alive);
		*seen = (struct map_seen){.sequence = sequence, .alive = alive, .whole = true};
		return true;
	}
	seen->whole = false;
	return false;
}

bool map_read_together(const struct map *map, const uint32_t *points, size_t count, struct map_sample *out)
{
	struct map_seen nothing = {.whole = false};

	return map_read_changed(map, points, count, &nothing, out);
}

bool map_read(const struct map *map, uint32_t point, struct map_sample *out)
{
	const struct map_point *config = &map->config.points[point];
	uint32_t owner = map_owner(map, point);
	const struct segment *segment = &map->segments[owner];
	map_latch *latch = latch_of(map, point);

	for (int tries = 0; tries < LATCH_TRIES; tries++) {
		/* First: a generation that begins after the sample was read must not vouch for its predecessor's. */
		bool alive = map_alive(map, owner);
		uint32_t sequence = latch_read_begin(latch);
		struct map_sample sample = segment->samples[sequence & 1][config->slot];

		if (!latch_read_done(latch, sequence))
			continue;
		*out = believed(map, sample, alive);
		return true;
	}
	return false;
}

/* ---- owner ------------------------------------------------------------------------------- */

void event_put(struct map *map, const struct map_update *update)
{
	struct map_event event = {.point = slot_of(map, update->point), /* its number may change: map_renew */
				  .kind = MAP_EVENT_CHANGE,
				  .cause = update->cause,
				  .past = (update->flags & MAP_UPDATE_PAST) != 0,
				  .sample = update->sample};

	ring_put(&map->segments[map->self].events, &event);
}

struct map_sample shown_sample(const struct map *map, uint32_t point)
{
	const struct segment *own = &map->segments[map->self];

	return own->samples[latch_whole_copy(latch_of(map, point))][slot_of(map, point)];
}

struct map_sample map_own_sample(const struct map *map, uint32_t point)
{
	const struct cover *cover =
	    map->covers == 0 ? NULL : cover_in(&map->segments[map->self], slot_of(map, point));

	return cover != NULL ? cover->below[latch_whole_copy(latch_of(map, point))]
			     : shown_sample(map, point);
}

/* What was never written has nothing to retain. */
static bool is_retained(const struct map *map, uint32_t point, const struct map_sample *sample)
{
	return (map->config.points[point].flags & MAP_POINT_RETAIN) && sample->time_ns != 0;
}

static void invalidate(const struct map *map, uint32_t point, struct map_sample *sample)
{
	if (!is_retained(map, point, sample))
		sample->quality |= MAP_INVALID;
}

/* What is shown is known, whatever the device says; what is below is as if it were shown. */
static void recover_cover(const struct map *map, const struct map_set *device, struct cover *cover,
			  unsigned whole)
{
	const uint32_t slot = atomic_load(&cover->slot) - 1; /* of an unused one, beyond all */
	const uint32_t first = map->config.points[device->first_point].slot;

	if (slot < first || slot - first >= device->point_count)
		return;
	invalidate(map, device->first_point + slot - first, &cover->below[whole]);
	cover->below[!whole] = cover->below[whole];
}

/*
 * A former generation may have died inside map_publish. The copy that readers take is whole: it is copied over the
 * other one before the latch turns again. The values stay to be looked at, and are invalid until this
 * generation has read the device, unless they are to be retained.
 */
static void recover_device(struct map *map, const struct map_set *device, map_latch *latch)
{
	const struct segment *own = &map->segments[map->self];
	uint32_t first = map->config.points[device->first_point].slot;
	unsigned whole = latch_whole_copy(latch);

	memcpy(&own->samples[!whole][first], &own->samples[whole][first],
	       device->point_count * sizeof(struct map_sample));
	for (int copy = 0; copy < 2; copy++) {
		unsigned filled = latch_flip(latch);

		for (uint32_t i = 0; i < device->point_count; i++)
			invalidate(map, device->first_point + i, &own->samples[filled][first + i]);
	}
	for (unsigned i = 0; i < MAP_FORCES_MAX; i++)
		recover_cover(map, device, &own->covers[i], whole);
}

void points_recover(struct map *map)
{
	for (uint32_t i = 0; i < map->config.set_count + map->config.gone_set_count; i++) {
		const struct map_set *device = &map->config.sets[i];

		if (device->point_count && device->module == map->self)
			recover_device(map, device, &map->segments[map->self].latches[device->latch]);
	}
}

/* ---- events ------------------------------------------------------------------------------ */

void map_cursor_to_end(const struct map *map, struct map_cursor *cursor)
{
	for (uint32_t i = 0; i < map_module_count(map); i++)
		cursor->next[i] = ring_head(&map->segments[i].events);
	cursor->lost = 0;
}

uint32_t map_events_behind(const struct map *map, const struct map_cursor *cursor)
{
	uint32_t behind = 0;

	for (uint32_t i = 0; i < map_module_count(map); i++)
		behind += ring_head(&map->segments[i].events) - cursor->next[i];
	return behind;
}

/* rtud says how many there are: a module cannot pass off as restored what would go before all that is live. */
static bool time_makes_sense(const struct map *map, uint32_t writer, uint32_t number,
			     const struct map_event *event)
{
	if (event->time == MAP_TIME_MONOTONIC)
		return is_past(map, event->sample.time_ns);
	return event->time <= MAP_TIME_WALL_UNSET && number < map->directory->modules[writer].restored &&
	       event->sample.time_ns >= 0;
}

/* What a module wrote is believed about its own points only. */
static bool event_makes_sense(const struct map *map, uint32_t writer, uint32_t number,
			      const struct map_event *event)
{
	if (!time_makes_sense(map, writer, number, event))
		return false;
	switch (event->kind) {
	case MAP_EVENT_CHANGE:
		return point_in(map, writer, event->point) != MAP_NONE && event->cause <= MAP_RETURN_LOCAL;
	case MAP_EVENT_MODULE_DOWN:
	case MAP_EVENT_MODULE_UP:
		return writer == MAP_RTUD && event->point < map_module_count(map);
	case MAP_EVENT_CLOCK:
		return writer == MAP_RTUD;
	default:
		return false;
	}
}

static bool peek_event(const struct map *map, struct map_cursor *cursor, uint32_t writer,
		       struct map_event *out)
{
	for (uint32_t skipped = 0; skipped <= map->segments[writer].events.capacity; skipped++) {
		if (!ring_peek(&map->segments[writer].events, &cursor->next[writer], out, &cursor->lost))
			return false;
		if (event_makes_sense(map, writer, cursor->next[writer], out)) {
			if (out->kind == MAP_EVENT_CHANGE)
				out->point = point_in(map, writer, out->point);
			return true;
		}
		cursor->lost += out->kind == EVENT_OVERWRITTEN;
		cursor->next[writer]++;
	}
	return false;
}

static bool is_older(const struct map_event *event, const struct map_event *other)
{
	bool restored = event->time != MAP_TIME_MONOTONIC, other_restored = other->time != MAP_TIME_MONOTONIC;

	return restored != other_restored ? restored : event->sample.time_ns < other->sample.time_ns;
}

bool map_event_next(const struct map *map, struct map_cursor *cursor, struct map_event *out)
{
	struct map_event first = {.kind = MAP_EVENT_CHANGE};
	uint32_t oldest = MAP_NONE;

	for (uint32_t i = 0; i < map_module_count(map); i++) {
		struct map_event event;

		if (!peek_event(map, cursor, i, &event))
			continue;
		if (oldest != MAP_NONE && !is_older(&event, &first))
			continue;
		first = event;
		oldest = i;
	}
	if (oldest == MAP_NONE)
		return false;
	*out = first;
	cursor->next[oldest]++;
	return true;
}

bool map_event_next_of(const struct map *map, struct map_cursor *cursor, uint32_t module,
		       struct map_event *out)
{
	if (!peek_event(map, cursor, module, out))
		return false;
	cursor->next[module]++;
	return true;
}
