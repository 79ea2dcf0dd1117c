/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/compare.h"

#include <string.h>

#include "map/limits.h"
#include "map/meaning.h"
#include "map/supervise.h"
#include "rtud/kinds.h"

/* ---- settings of all modules ----------------------------------------------------------------- */

static bool same_clock(const struct map_settings *a, const struct map_settings *b)
{
	return a->clock == b->clock;
}

static bool same_zone(const struct map_settings *a, const struct map_settings *b)
{
	return memcmp(&a->zone, &b->zone, sizeof(a->zone)) == 0;
}

static bool same_ring(const struct map_settings *a, const struct map_settings *b)
{
	return a->event_ring == b->event_ring;
}

static bool same_force(const struct map_settings *a, const struct map_settings *b)
{
	return a->force_max_s == b->force_max_s;
}

static bool same_timeouts(const struct map_settings *a, const struct map_settings *b)
{
	return a->select_timeout_s == b->select_timeout_s && a->command_timeout_s == b->command_timeout_s;
}

static bool same_groups(const struct map_settings *a, const struct map_settings *b)
{
	for (uint32_t i = 0; i < a->queue_count && i < b->queue_count; i++)
		if (strcmp(a->queues[i].name, b->queues[i].name) != 0)
			return false;
	return a->queue_count == b->queue_count;
}

static bool same_limits(const struct map_settings *a, const struct map_settings *b)
{
	for (uint32_t i = 0; i < a->queue_count && i < b->queue_count; i++)
		if (a->queues[i].limit != b->queues[i].limit)
			return false;
	return true;
}

static const struct {
	struct compare_setting setting;
	bool (*same)(const struct map_settings *a, const struct map_settings *b);
} settings[] = {
    {{"clock", NULL}, same_clock},
    {{"timezone", NULL}, same_zone},
    {{"event_ring", NULL}, same_ring},
    {{"force_max_s", NULL}, same_force},
    {{"commands", NULL}, same_timeouts},
    {{"redundancy_groups", NULL}, same_groups},
    {{"redundancy_groups.queue", NULL}, same_limits},
};

const struct compare_setting *compare_settings(const struct map_settings *a, const struct map_settings *b,
					       uint32_t *next)
{
	while (*next < sizeof(settings) / sizeof(settings[0])) {
		const uint32_t i = (*next)++;

		if (!settings[i].same(a, b))
			return &settings[i].setting;
	}
	return NULL;
}

/* ---- points -------------------------------------------------------------------------------- */

static bool same_name(const struct map_config *a, uint32_t in_a, const struct map_config *b, uint32_t in_b)
{
	char name[MAP_NAME_SIZE], other[MAP_NAME_SIZE];

	map_point_name(a, &a->points[in_a], name);
	map_point_name(b, &b->points[in_b], other);
	return strcmp(name, other) == 0;
}

/* In bits: not-a-number is itself. */
static bool same_float(float a, float b)
{
	return memcmp(&a, &b, sizeof(a)) == 0;
}

static bool same_point(const struct map_point *a, const struct map_point *b)
{
	return a->type == b->type && a->flags == b->flags && a->group == b->group &&
	       a->counter_group == b->counter_group && a->short_pulse_ms == b->short_pulse_ms &&
	       a->long_pulse_ms == b->long_pulse_ms && a->ioa == b->ioa &&
	       a->send_period_ms == b->send_period_ms && a->freeze_s == b->freeze_s &&
	       same_float(a->deadband, b->deadband) && same_float(a->step, b->step) &&
	       same_float(a->min, b->min) && same_float(a->max, b->max);
}

static bool same_ranges(const struct map_config *a, uint32_t in_a, const struct map_config *b, uint32_t in_b)
{
	const struct map_limits *one, *other;

	if (!(a->points[in_a].flags & MAP_POINT_LIMITS))
		return true;
	one = map_limits_of(a, in_a);
	other = map_limits_of(b, in_b);
	return same_float(one->high_high, other->high_high) && same_float(one->high, other->high) &&
	       same_float(one->low, other->low) && same_float(one->low_low, other->low_low);
}

/* What people are told of a point's values. */
static bool same_words(const struct map_config *a, uint32_t in_a, const struct map_config *b, uint32_t in_b)
{
	const struct map_point *one = &a->points[in_a], *other = &b->points[in_b];
	const struct map_meaning *meanings, *others;
	const uint32_t count = map_meanings_of(a, in_a, &meanings);

	if (one->decimals != other->decimals || strcmp(map_unit_of(a, one), map_unit_of(b, other)) != 0 ||
	    map_meanings_of(b, in_b, &others) != count)
		return false;
	for (uint32_t i = 0; i < count; i++)
		if (meanings[i].number != others[i].number || strcmp(meanings[i].text, others[i].text) != 0)
			return false;
	return true;
}

static bool same_set(const struct map_config *a, const struct map_set *set, const struct map_config *b,
		     const struct map_set *other)
{
	if (set->ca != other->ca || set->point_count != other->point_count ||
	    strcmp(set->name, other->name) != 0 || strcmp(set->prefix, other->prefix) != 0)
		return false;
	for (uint32_t i = 0; i < set->point_count; i++)
		if (!same_point(&a->points[set->first_point + i], &b->points[other->first_point + i]) ||
		    !same_ranges(a, set->first_point + i, b, other->first_point + i) ||
		    !same_words(a, set->first_point + i, b, other->first_point + i) ||
		    !same_name(a, set->first_point + i, b, other->first_point + i))
			return false;
	return true;
}

/* The module's first set from this place on; set_count: it has no more. */
static uint32_t next_set(const struct map_config *config, uint32_t module, uint32_t from)
{
	while (from < config->set_count && config->sets[from].module != module)
		from++;
	return from;
}

static bool same_sets(const struct map_config *a, const struct map_config *b, uint32_t module)
{
	uint32_t i = next_set(a, module, 0), j = next_set(b, module, 0);

	while (i < a->set_count && j < b->set_count && same_set(a, &a->sets[i], b, &b->sets[j])) {
		i = next_set(a, module, i + 1);
		j = next_set(b, module, j + 1);
	}
	return i == a->set_count && j == b->set_count;
}

bool compare_has_point(const struct map_config *config, const struct map_config *other, uint32_t point)
{
	const struct map_point *object = &config->points[point];
	const struct map_set *set = &config->sets[object->set];

	for (uint32_t i = 0; i < other->set_count; i++) {
		const struct map_set *there = &other->sets[i];

		if (there->ca != set->ca || there->module != set->module)
			continue;
		for (uint32_t j = there->first_point; j < there->first_point + there->point_count; j++)
			if (other->points[j].ioa == object->ioa && other->points[j].type == object->type &&
			    same_name(config, point, other, j))
				return true;
	}
	return false;
}

/* ---- modules ------------------------------------------------------------------------------- */

static bool same_plan(const struct map_module_plan *a, const struct map_module_plan *b)
{
	return strcmp(a->kind, b->kind) == 0 && a->flags == b->flags &&
	       memcmp(&a->rings, &b->rings, sizeof(a->rings)) == 0 &&
	       a->heartbeat_limit_ms == b->heartbeat_limit_ms && a->section_size == b->section_size;
}

/* Of a module that keeps its segment: what its kind alone knows. */
static enum kind_change compare_kept(const struct map *map, const struct map_config *now, uint32_t module)
{
	const struct map_module_plan *plan = map_plan_of(map, module);
	const struct kind *kind = kinds_find(plan->kind);

	if (kind == NULL || kind->same == NULL || kind->same(map_config(map), now, module, plan->name))
		return KIND_UNCHANGED;
	return kind->change == NULL ? KIND_EXCHANGED : kind->change(map_config(map), now);
}

enum kind_change compare_modules(const struct map *map, const struct map_config *now, uint32_t module)
{
	if (!same_plan(map_plan_of(map, module), &now->modules[module]) ||
	    !same_sets(map_config(map), now, module))
		return KIND_EXCHANGED;
	return compare_kept(map, now, module);
}

map_modules compare_again(const struct map *map, const struct map_config *now, map_modules kept, bool moved)
{
	map_modules again = 0;

	for (uint32_t i = MAP_RTUD + 1; i < map_module_count(map); i++) {
		const struct kind *kind = kinds_find(map_plan_of(map, i)->kind);

		if ((kept & map_module_bit(i)) &&
		    ((moved && kind->by_numbers) || compare_kept(map, now, i) == KIND_STARTS_AGAIN))
			again |= map_module_bit(i);
	}
	return again;
}

static bool reads_the_same(const struct map_config *before, const struct map_config *now, uint32_t module,
			   map_modules kept)
{
	const struct map_module_plan *plan = &now->modules[module];
	const struct kind *kind = kinds_find(plan->kind);

	if (kind == NULL || kind->reads == NULL || (plan->flags & MAP_IS_GONE))
		return true;
	for (uint32_t i = 0;; i++) {
		const uint32_t was = kind->reads(before, plan->name, i), is = kind->reads(now, plan->name, i);

		if (was == MAP_NONE || is == MAP_NONE)
			return was == is;
		if (!same_name(before, was, now, is) ||
		    !(kept & map_module_bit(now->sets[now->points[is].set].module)))
			return false;
	}
}

/* Owners of what a module reads that may be commanded: it may be one who does. */
static map_modules asked_by(const struct map_config *config, const struct map_module_plan *plan)
{
	const struct kind *kind = kinds_find(plan->kind);
	map_modules owners = 0;
	uint32_t point;

	if (kind == NULL || kind->reads == NULL || !(plan->flags & MAP_MAY_REQUEST) ||
	    (plan->flags & MAP_IS_GONE))
		return 0;
	for (uint32_t i = 0; (point = kind->reads(config, plan->name, i)) != MAP_NONE; i++)
		if (config->points[point].flags & MAP_POINT_COMMAND)
			owners |= map_module_bit(config->sets[config->points[point].set].module);
	return owners;
}

static map_modules asked_by_changed(const struct map_config *now, map_modules kept)
{
	map_modules owners = 0;

	for (uint32_t i = 0; i < now->module_count; i++)
		if (!(kept & map_module_bit(i)))
			owners |= asked_by(now, &now->modules[i]);
	return owners;
}

map_modules compare_others(const struct map *map, const struct map_config *now, map_modules kept)
{
	map_modules moved = 0, last;

	do {
		last = moved;
		moved |= kept & asked_by_changed(now, kept & ~moved);
		for (uint32_t i = 0; i < now->module_count; i++)
			if ((kept & ~moved & map_module_bit(i)) &&
			    !reads_the_same(map_config(map), now, i, kept & ~moved))
				moved |= map_module_bit(i);
	} while (moved != last);
	return moved;
}
