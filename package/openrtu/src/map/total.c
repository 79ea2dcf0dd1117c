/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Integrated totals: readings that can be frozen and reset without a touch of the device. */
#include "map/layout.h"
#include "map/time_ns.h"

/* ---- freezing ---------------------------------------------------------------------------- */

static void freeze(struct map_total *total, const struct map_sample *reading)
{
	uint8_t sequence = (uint8_t)((total->frozen.detail + 1) & MAP_COUNTER_SEQUENCE);

	total->frozen = *reading;
	total->frozen.detail = sequence | total->since;
	if (total->frozen.time_ns == 0) /* never read: it is frozen all the same, as invalid */
		total->frozen.time_ns = map_now_ns();
	total->since = 0;
}

/* A counter that cannot be read now is reset to its last reading: what it counts meanwhile is not lost. */
static void carry_out(struct map *map, uint32_t point, enum map_freeze mode)
{
	struct total_cell *cell = total_own(map, point);
	struct map_total total = total_current(cell);
	struct map_update update = {
	    .point = point, .flags = UPDATE_AS_IS, .sample = map_own_sample(map, point)};

	if (mode != MAP_RESET_ONLY)
		freeze(&total, &update.sample);
	if (mode == MAP_RESET_ONLY)
		total.since = MAP_COUNTER_ADJUSTED;
	if (mode != MAP_FREEZE_ONLY)
		total.offset += update.sample.value.u;
	total_store(cell, &total);
	if (mode == MAP_FREEZE_ONLY || update.sample.time_ns == 0)
		return;
	update.sample.value.u = 0;
	update.sample.time_ns = map_now_ns();
	map_publish(map, &update, 1);
}

static uint16_t ca_of(const struct map *map, uint32_t point)
{
	return map->config.sets[map->config.points[point].set].ca;
}

static bool is_meant(const struct map *map, uint32_t point, const struct map_request *request)
{
	const struct map_point *object = &map->config.points[point];
	uint32_t group = request->value.u & MAP_FREEZE_GROUP;

	return object->type == MAP_COUNTER && map_owner(map, point) == map->self &&
	       ((request->value.u & MAP_FREEZE_ALL_DEVICES) ||
		ca_of(map, point) == ca_of(map, request->point)) &&
	       (group == 0 || object->counter_group == group);
}

bool totals_freeze(struct map *map, const struct map_request *request)
{
	if (request->detail < MAP_FREEZE_ONLY || request->detail > MAP_RESET_ONLY)
		return false;
	for (uint32_t i = 0; i < map->config.point_count; i++)
		if (is_meant(map, i, request))
			carry_out(map, i, (enum map_freeze)request->detail);
	return true;
}

/* Whoever takes it late finds another frozen reading beside it. */
static void put_freeze(struct map *map, uint32_t point)
{
	struct map_update update = {.point = point, .sample = total_current(total_own(map, point)).frozen};

	update.sample.detail |= MAP_COUNTER_FROZEN;
	event_put(map, &update);
}

void map_totals_tick(struct map *map)
{
	const struct module_entry *self = &map->modules[map->self];
	int64_t now_s, then_s = map->ticked_s;
	bool any = false;

	if (self->total_count == 0)
		return;
	now_s = (map_now_ns() + map_clock_read(map).offset_ns) / NS_PER_S;
	map->ticked_s = now_s;
	if (then_s == 0 || then_s == now_s)
		return;
	for (uint32_t slot = 0; slot < self->point_count; slot++) {
		const uint32_t i = point_in(map, map->self, slot);
		const uint32_t period_s = map->config.points[i].freeze_s;

		if (period_s == 0 || now_s / period_s == then_s / period_s || i >= map->config.point_count)
			continue;
		carry_out(map, i, MAP_FREEZE_ONLY);
		put_freeze(map, i);
		any = true;
	}
	if (any)
		bell_ring_event_readers(map);
}

/* A former generation may have died inside store. */
void totals_recover(struct map *map)
{
	for (uint32_t i = 0; i < map->modules[map->self].total_count; i++) {
		struct total_cell *cell = &map->segments[map->self].totals[i];
		unsigned whole = latch_whole_copy(&cell->latch);

		cell->copies[!whole] = cell->copies[whole];
	}
}

/* ---- anyone ------------------------------------------------------------------------------ */

bool map_total_read(const struct map *map, uint32_t point, struct map_sample *out)
{
	struct total_cell *cell =
	    &map->segments[map_owner(map, point)].totals[map->config.points[point].extra];
	struct map_total total;

	if (!latch_load(&cell->latch, cell->copies, &total, sizeof(total)))
		return false;
	if (total.frozen.time_ns == 0 || !is_past(map, total.frozen.time_ns))
		return map_read(map, point, out);
	*out = total.frozen;
	return true;
}
