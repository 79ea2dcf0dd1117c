/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Many points in one object: rtuImage. */
#include "snmp/agent.h"

#include <string.h>

#define POINT_SIZE 12
_Static_assert(SNMP_IMAGE_POINTS *POINT_SIZE <= SNMP_OCTETS_MAX, "a row is one value");

enum { IMAGE_EVENT = 3, IMAGE_TIME, IMAGE_DATA };
enum { GROUP_EVENT = 4, GROUP_TIME, GROUP_DATA };

static uint32_t count_images(const struct snmp_agent *agent)
{
	return agent->images.count;
}

static uint32_t count_groups(const struct snmp_agent *agent)
{
	return agent->group_images.count;
}

static uint32_t first_of(const struct snmp_agent *agent, const struct snmp_images *images,
			 enum snmp_list list, uint32_t row)
{
	return agent->lists[list].points[images->images[row].first];
}

static void index_image(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	const uint32_t first = first_of(agent, &agent->images, SNMP_ALL, row);

	out[0] = snmp_ca(agent, first);
	out[1] = agent->config->points[first].ioa;
}

static void index_group(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	const uint32_t first = first_of(agent, &agent->group_images, SNMP_GROUPED, row);

	out[0] = agent->config->points[first].group;
	out[1] = snmp_ca(agent, first);
	out[2] = agent->config->points[first].ioa;
}

static void put_big_endian(uint8_t *out, uint32_t number, unsigned size)
{
	for (unsigned i = 0; i < size; i++)
		out[i] = (uint8_t)(number >> 8 * (size - 1 - i));
}

/* Address, type, value, quality, age: the most significant octet first. */
static void pack(struct snmp_agent *agent, uint32_t point, uint8_t out[POINT_SIZE])
{
	const struct map_point *object = &agent->config->points[point];
	struct map_sample sample;
	int64_t age_ms;

	if (!map_read(agent->map, point, &sample))
		sample = (struct map_sample){.quality = MAP_INVALID};
	age_ms = sample.time_ns == 0 ? UINT32_MAX : (agent->now_ns - sample.time_ns) / NS_PER_MS;
	if (age_ms < 0)
		age_ms = 0;
	put_big_endian(out, object->ioa, 3);
	out[3] = (uint8_t)snmp_type_number(object->type);
	put_big_endian(out + 4, sample.value.u, 4);
	out[8] = sample.quality;
	put_big_endian(out + 9, age_ms > 0xffffff ? 0xffffff : (uint32_t)age_ms, 3);
}

static void put_points(struct snmp_agent *agent, enum snmp_list list, const struct snmp_image *image,
		       struct snmp_value *out)
{
	out->syntax = SNMP_OCTETS;
	out->size = (uint16_t)(image->count * POINT_SIZE);
	for (uint32_t i = 0; i < image->count; i++)
		pack(agent, agent->lists[list].points[image->first + i],
		     &out->octets[(size_t)i * POINT_SIZE]);
}

static bool read_image(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	switch (column) {
	case IMAGE_EVENT:
		snmp_put_number(out, SNMP_GAUGE, agent->position.last);
		return true;
	case IMAGE_TIME:
		snmp_put_moment(agent, out, agent->now_ns);
		return true;
	default:
		put_points(agent, SNMP_ALL, &agent->images.images[row], out);
		return true;
	}
}

static bool read_group(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	if (column != GROUP_DATA)
		return read_image(agent, column - GROUP_EVENT + IMAGE_EVENT, row, out);
	put_points(agent, SNMP_GROUPED, &agent->group_images.images[row], out);
	return true;
}

const struct snmp_table snmp_image_table = {.prefix = {1, 10, 1},
					    .prefix_length = 3,
					    .first = IMAGE_EVENT,
					    .last = IMAGE_DATA,
					    .indexes = 2,
					    .count = count_images,
					    .index = index_image,
					    .read = read_image};

const struct snmp_table snmp_group_table = {.prefix = {1, 10, 2},
					    .prefix_length = 3,
					    .first = GROUP_EVENT,
					    .last = GROUP_DATA,
					    .indexes = 3,
					    .count = count_groups,
					    .index = index_group,
					    .read = read_group};
