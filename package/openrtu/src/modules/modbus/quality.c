/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/modbus/quality.h"

/* With the value that the point has. */
static struct map_update update_of(uint32_t point, uint8_t is, int64_t now_ns)
{
	return (struct map_update){
	    .point = point, .flags = MAP_UPDATE_KEEPS_VALUE, .sample = {.quality = is, .time_ns = now_ns}};
}

struct map_update quality_lost(const struct quality *quality, uint32_t point, enum map_quality how,
			       int64_t now_ns)
{
	uint8_t own = quality->points[point].own;

	return update_of(point, (uint8_t)((own & MAP_OVERFLOW) | (own & MAP_INVALID ? MAP_INVALID : how)),
			 now_ns);
}

/* Some of those that have extras are about a status bit. */
static bool may_have_status(const struct modbus_point *point)
{
	return point->extra != 0;
}

void quality_init(struct quality *quality, struct map *map, struct quality_of_point *points)
{
	const struct map_config *config = map_config(map);

	*quality = (struct quality){.map = map, .points = points, .wire = modbus_points(config)};
	for (uint32_t i = 0; i < map_record_count(config, MODBUS_POINTS); i++) {
		points[i] = (struct quality_of_point){.own = MAP_INVALID, .published = MAP_INVALID};
		quality->with_status |= may_have_status(&quality->wire[i]);
	}
}

static uint8_t quality_of(const struct quality *quality, const struct map_set *device, uint32_t point)
{
	static const uint8_t says[] = {[MODBUS_BLOCKED_BY] = MAP_BLOCKED,
				       [MODBUS_SUBSTITUTED_BY] = MAP_SUBSTITUTED,
				       [MODBUS_NOT_TOPICAL_BY] = MAP_NOT_TOPICAL};
	const struct modbus_extra *extra = modbus_extra_of(map_config(quality->map), &quality->wire[point]);
	uint8_t is = quality->points[point].own;

	if ((is & MAP_INVALID) || extra == NULL)
		return is;
	for (unsigned i = 0; i < MODBUS_STATUS_BITS; i++) {
		const struct quality_of_point *bit;

		if (extra->links[i] == 0)
			continue;
		bit = &quality->points[device->first_point + extra->links[i] - 1];
		if (bit->own != MAP_GOOD)
			is |= MAP_NOT_TOPICAL;
		else if (bit->on)
			is |= says[i];
	}
	return is;
}

static void take_updates(struct quality *quality, const struct map_update *updates, size_t count)
{
	for (size_t i = 0; i < count; i++) {
		struct quality_of_point *point = &quality->points[updates[i].point];

		point->own = updates[i].sample.quality;
		if (!(updates[i].flags & MAP_UPDATE_KEEPS_VALUE))
			point->on = updates[i].sample.value.u != 0;
		point->updated = true;
	}
}

size_t quality_complete(struct quality *quality, const struct map_set *device, struct map_update *updates,
			size_t count, int64_t now_ns)
{
	size_t updated = count;

	take_updates(quality, updates, count);
	for (uint32_t i = 0; quality->with_status && i < device->point_count; i++) {
		uint32_t number = device->first_point + i;
		struct quality_of_point *point = &quality->points[number];

		if (point->updated || !may_have_status(&quality->wire[number]) ||
		    quality_of(quality, device, number) == point->published)
			continue;
		point->published = quality_of(quality, device, number);
		updates[count++] = update_of(number, point->published, now_ns);
	}
	for (size_t i = 0; i < updated; i++) {
		struct quality_of_point *point = &quality->points[updates[i].point];

		updates[i].sample.quality = point->published = quality_of(quality, device, updates[i].point);
		point->updated = false;
	}
	return count;
}
