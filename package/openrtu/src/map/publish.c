/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Publishing: what an update leaves in the map, and the events that it makes. */
#include <math.h>

#include "map/layout.h"
#include "map/limits.h"

/* ---- events ------------------------------------------------------------------------------ */

static double distance(enum map_type type, union map_value a, union map_value b)
{
	switch (map_types[type].class) {
	case MAP_CLASS_MEASURED:
	case MAP_CLASS_TOTAL:
		return fabs(map_number(type, a) - map_number(type, b));
	case MAP_CLASS_STATE:
	case MAP_CLASS_POSITION:
	case MAP_CLASS_PATTERN:
		break;
	}
	return a.u == b.u ? 0 : INFINITY;
}

/* A value that is not a number is at no distance from another: any change of its bits counts. */
static bool value_left(const struct map *map, uint32_t point, union map_value from, union map_value to)
{
	const enum map_type type = (enum map_type)map->config.points[point].type;
	struct map_parameters parameters;
	double by;

	if (from.u == to.u)
		return false;
	by = distance(type, from, to);
	if (isnan(by))
		return true;
	map_parameters_read(map, point, &parameters);
	return by > parameters.threshold || parameters_crossed(&parameters, type, from, to) ||
	       map_range_of(&map->config, point, from) != map_range_of(&map->config, point, to);
}

static bool has_changed(const struct map *map, const struct map_update *update, const struct reported *last)
{
	const struct map_sample *sample = &update->sample;

	if (!last->valid || last->quality != sample->quality)
		return true;
	return update->event_rule == MAP_EVENT_BY_CHANGE &&
	       (last->detail != sample->detail || value_left(map, update->point, last->value, sample->value));
}

static bool is_event(const struct map *map, const struct map_update *update)
{
	const struct map_sample *sample = &update->sample;
	uint32_t point = update->point;
	struct reported *last = &map->reported[map->config.points[point].slot];

	if (map->config.points[point].freeze_s != 0) /* its frozen readings are its events */
		return false;
	if (update->cause == MAP_SPONTANEOUS && update->event_rule != MAP_EVENT_ALWAYS &&
	    !has_changed(map, update, last))
		return false;
	*last = (struct reported){
	    .value = sample->value, .quality = sample->quality, .detail = sample->detail, .valid = true};
	return true;
}

/* ---- samples ----------------------------------------------------------------------------- */

/* What an update leaves in the map. */
static struct map_sample sample_of(struct map *map, const struct map_update *update)
{
	struct map_sample sample = update->sample;

	if (update->flags & UPDATE_AS_IS)
		return sample;
	if (update->flags & MAP_UPDATE_KEEPS_VALUE) {
		const struct map_sample last = map_own_sample(map, update->point);

		sample.value = last.value;
		sample.detail = last.detail;
		return sample;
	}
	switch (map_class_of(&map->config.points[update->point])) {
	case MAP_CLASS_MEASURED:
		parameter_smooth(map, update->point, &sample);
		break;
	case MAP_CLASS_TOTAL:
		total_count(map, update->point, update->flags & MAP_UPDATE_NARROW, &sample);
		break;
	case MAP_CLASS_STATE:
	case MAP_CLASS_POSITION:
	case MAP_CLASS_PATTERN:
		break;
	}
	return sample;
}

/* NULL: it is not forced, as hardly any point is. */
static struct cover *cover_of(const struct map *map, uint32_t point)
{
	return map->covers == 0 ? NULL : cover_in(&map->segments[map->self], slot_of(map, point));
}

static void fill(struct map *map, const struct map_update *update, unsigned copy)
{
	struct cover *cover = cover_of(map, update->point);
	struct map_sample *shown = &map->segments[map->self].samples[copy][slot_of(map, update->point)];
	struct map_sample sample;

	if (update->flags & MAP_UPDATE_PAST)
		return;
	sample = sample_of(map, update);
	*shown = cover != NULL ? cover->shown : sample;
	if (cover != NULL)
		cover->below[copy] = sample;
}

static void fill_again(struct map *map, uint32_t point, unsigned from, unsigned to)
{
	const struct segment *own = &map->segments[map->self];
	struct cover *cover = cover_of(map, point);

	own->samples[to][slot_of(map, point)] = own->samples[from][slot_of(map, point)];
	if (cover != NULL)
		cover->below[to] = cover->below[from];
}

/* What an event tells that leaves the point as it is: of a counter the reading, by its last reset. */
static struct map_sample past_sample(const struct map *map, const struct map_update *update)
{
	struct map_sample sample = update->sample;

	if (map_class_of(&map->config.points[update->point]) == MAP_CLASS_TOTAL)
		sample.value.u -= total_current(total_own(map, update->point)).offset;
	return sample;
}

/* samples: what the updates left. */
static bool put_events(struct map *map, const struct map_update *updates, size_t count,
		       const struct map_sample *samples)
{
	bool any = false;

	for (size_t i = 0; i < count; i++) {
		struct map_update left = updates[i];
		const bool past = (left.flags & MAP_UPDATE_PAST) != 0;

		left.sample = past ? past_sample(map, &left) : samples[map->config.points[left.point].slot];
		if (cover_of(map, left.point) != NULL && past)
			continue;
		if (cover_of(map, left.point) != NULL)
			left.event_rule = MAP_EVENT_BY_CHANGE; /* what is below is worth no event */
		if (!is_event(map, &left))
			continue;
		event_put(map, &left);
		any = true;
	}
	return any;
}

void map_publish(struct map *map, const struct map_update *updates, size_t count)
{
	const struct segment *own = &map->segments[map->self];
	unsigned first, second;
	map_latch *latch;

	if (count == 0)
		return;
	latch = latch_of(map, updates[0].point);
	first = latch_flip(latch);
	for (size_t i = 0; i < count; i++)
		fill(map, &updates[i], first);
	second = latch_flip(latch);
	for (size_t i = 0; i < count; i++)
		fill_again(map, updates[i].point, first, second);
	if (put_events(map, updates, count, own->samples[second]))
		bell_ring_event_readers(map);
}
