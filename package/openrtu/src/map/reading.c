/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The readings of counters: what their sources say, less what that was at the last reset. */
#include "map/layout.h"

struct total_cell *total_own(const struct map *map, uint32_t point)
{
	return &map->segments[map->self].totals[map->config.points[point].extra];
}

struct map_total total_current(const struct total_cell *cell)
{
	return cell->copies[0];
}

void total_store(struct total_cell *cell, const struct map_total *total)
{
	latch_store(&cell->latch, cell->copies, total, sizeof(*total));
}

static void readjust(struct map_total *total, uint32_t device, uint32_t reading)
{
	total->since |= MAP_COUNTER_ADJUSTED;
	total->offset = device - reading;
}

/* The reading behind last. What lies nearer behind it than ahead is a device that was reset or exchanged. */
static uint32_t next_reading(struct map_total *total, uint32_t last, bool narrow, uint32_t device)
{
	uint32_t counted = device - total->offset - last;

	if (narrow)
		counted &= UINT16_MAX;
	if (counted <= (narrow ? (uint32_t)INT16_MAX : (uint32_t)INT32_MAX)) {
		total->since |= last + counted < last ? MAP_COUNTER_CARRY : 0;
		return last + counted;
	}
	readjust(total, device, narrow ? last + device : device);
	return device - total->offset;
}

void total_count(struct map *map, uint32_t point, bool narrow, struct map_sample *sample)
{
	struct total_cell *cell = total_own(map, point);
	struct map_total total = total_current(cell);
	struct map_sample last = map_own_sample(map, point);
	uint8_t since = total.since;

	if (sample->quality & MAP_INVALID)
		sample->value = last.value;
	else if (last.time_ns == 0)
		sample->value.u -= total.offset;
	else
		sample->value.u = next_reading(&total, last.value.u, narrow, sample->value.u);
	if (total.since != since || total.offset != total_current(cell).offset)
		total_store(cell, &total);
}
