/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The points of the program: read together, published together. */
#include <string.h>

#include "logic/value.h"
#include "modules/logic/host.h"

#define TRIES 3 /* a writer publishes once a scan at most: it does not overtake a reader thrice */

struct host_point *points_find(const struct host *host, uint32_t point)
{
	for (uint16_t i = 0; i < host->logic.head->points; i++)
		if (host->points[i].point == point)
			return &host->points[i];
	return NULL;
}

struct host_point *points_named(const struct host *host, uint16_t name)
{
	const struct logic *logic = &host->logic;

	for (uint16_t i = 0; i < logic->head->points; i++)
		if (strcmp(logic_name(logic, logic->points[i].name), logic_name(logic, name)) == 0)
			return &host->points[i];
	return NULL;
}

/* What cannot be read now is as it was, and not topical. */
static void read_foreign(const struct host *host, struct host_point *point)
{
	for (unsigned i = 0; i < TRIES; i++)
		if (map_read(host->map, point->point, &point->sample))
			return;
	point->sample.quality |= MAP_NOT_TOPICAL;
}

void points_freeze(struct host *host)
{
	const struct logic *logic = &host->logic;
	struct map_clock clock = map_clock_read(host->map);

	map_begin_cycle(host->map);
	for (uint16_t i = 0; i < logic->head->points; i++) {
		struct host_point *point = &host->points[i];
		struct logic_value value;

		if (logic->points[i].written)
			continue;
		if (!point->own)
			read_foreign(host, point);
		logic_take_sample(point->type, logic->points[i].type, &point->sample, &value);
		value.time_us = map_wall_ns(clock, point->sample.time_ns) / 1000;
		logic_set(&host->logic, &logic->points[i], &value);
	}
}

static void take_output(struct host *host, uint16_t number, int64_t now_ns)
{
	const struct logic_point *output = &host->logic.points[number];
	struct host_point *point = &host->points[number];
	struct logic_value value;

	logic_get(&host->logic, output, &value);
	logic_make_sample(point->type, output->type, &value, &point->sample);
	point->sample.time_ns = now_ns;
}

void points_publish(struct host *host, int64_t now_ns)
{
	size_t count = 0;

	for (uint16_t i = 0; i < host->logic.head->points; i++) {
		struct host_point *point = &host->points[i];

		if (!point->own)
			continue;
		if (host->logic.points[i].written)
			take_output(host, i, now_ns);
		host->updates[count++] = (struct map_update){
		    .point = point->point, .cause = point->cause, .sample = point->sample};
		point->cause = MAP_SPONTANEOUS;
	}
	map_publish(host->map, host->updates, count);
}

void points_set(struct host_point *point, union map_value value, uint8_t cause)
{
	point->sample = (struct map_sample){.value = value, .time_ns = map_now_ns()};
	point->cause = cause;
}

void points_publish_set(struct host *host, struct host_point *point)
{
	const struct map_update update = {
	    .point = point->point, .cause = point->cause, .sample = point->sample};

	map_publish(host->map, &update, 1);
	point->cause = MAP_SPONTANEOUS;
}
