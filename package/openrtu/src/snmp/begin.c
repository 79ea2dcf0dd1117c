/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The agent as a whole: its tables in their order, its lists of points. */
#include "snmp/agent.h"

#include <stdlib.h>
#include <string.h>

#include "map/hash.h"

/* ---- the tree ---------------------------------------------------------------------------- */

static const struct snmp_table *const system_tables[] = {
    &snmp_system_scalars[0], &snmp_system_scalars[1], &snmp_system_scalars[2],
    &snmp_system_scalars[3], &snmp_system_scalars[4], &snmp_system_scalars[5],
    &snmp_system_scalars[6], &snmp_resources_changed, &snmp_resource_table};

/* Of mib-2, behind system. */
static const struct snmp_table *const mib_2_tables[] = {
    &snmp_interface_count,     &snmp_interface_tables[0], &snmp_interface_tables[1],
    &snmp_interface_tables[2], &snmp_interface_tables[3], &snmp_message_groups[0],
    &snmp_message_groups[1],   &snmp_message_groups[2],   &snmp_machine_uptime,
    &snmp_memory_size,         &snmp_storage_table,       &snmp_interface_extras[0],
    &snmp_interface_extras[1], &snmp_interface_extras[2], &snmp_interface_extras[3],
    &snmp_interfaces_changed};
static const struct snmp_table *const dispatch_tables[] = {&snmp_dispatch_group};
static const struct snmp_table *const context_tables[] = {&snmp_context_group};
static const struct snmp_table *const usm_tables[] = {&snmp_usm_group};

static const struct snmp_table *const engine_tables[] = {&snmp_engine_scalars[0], &snmp_engine_scalars[1],
							 &snmp_engine_scalars[2], &snmp_engine_scalars[3]};

static const struct snmp_table *const station_tables[] = {
    &snmp_station_scalars[0], &snmp_station_scalars[1], &snmp_station_scalars[2], &snmp_station_scalars[3],
    &snmp_station_scalars[4], &snmp_device_table,       &snmp_initialised_table,  &snmp_point_table,
    &snmp_value_tables[0],    &snmp_value_tables[1],    &snmp_value_tables[2],    &snmp_value_tables[3],
    &snmp_value_tables[4],    &snmp_value_tables[5],    &snmp_command_table,      &snmp_command_scalars[0],
    &snmp_command_scalars[1], &snmp_command_scalars[2], &snmp_total_table,        &snmp_freeze_table,
    &snmp_cyclic_last,        &snmp_cyclic_table,       &snmp_poll_table,         &snmp_parameter_table,
    &snmp_clock_group,        &snmp_event_scalars[0],   &snmp_event_scalars[1],   &snmp_event_scalars[2],
    &snmp_event_scalars[3],   &snmp_event_table,        &snmp_sink_table,         &snmp_module_table,
    &snmp_counter_table,      &snmp_health_scalars[0],  &snmp_health_scalars[1],  &snmp_health_scalars[2],
    &snmp_image_table,        &snmp_group_table,
};

#define COUNT(tables) (sizeof(tables) / sizeof((tables)[0]))

/* Of all but the station's own, which is the configuration's. */
#define ROOT(own, ...)                                                                                       \
	{                                                                                                    \
		.ids = {__VA_ARGS__}, .length = sizeof((uint32_t[]){__VA_ARGS__}) / sizeof(uint32_t),        \
		.tables = own, .count = COUNT(own)                                                           \
	}
static const struct snmp_root roots[SNMP_ROOTS] = {
    ROOT(system_tables, 1, 3, 6, 1, 2, 1, 1),
    ROOT(mib_2_tables, 1, 3, 6, 1, 2, 1),
    {.tables = station_tables, .count = COUNT(station_tables)},
    ROOT(engine_tables, 1, 3, 6, 1, 6, 3, 10, 2, 1),
    ROOT(dispatch_tables, 1, 3, 6, 1, 6, 3, 11, 2),
    ROOT(context_tables, 1, 3, 6, 1, 6, 3, 12),
    ROOT(usm_tables, 1, 3, 6, 1, 6, 3, 15, 1),
};

static void plant(struct snmp_agent *agent)
{
	for (unsigned i = 0; i < SNMP_ROOTS; i++) {
		agent->roots[i] = roots[i];
		if (roots[i].tables != station_tables)
			continue;
		agent->roots[i].length = agent->settings->base_length;
		memcpy(agent->roots[i].ids, agent->settings->base, sizeof(agent->settings->base));
	}
}

/* ---- lists ------------------------------------------------------------------------------- */

static bool belongs(const struct map_point *point, enum snmp_list list)
{
	const enum map_class class = map_class_of(point);

	switch (list) {
	case SNMP_ALL:
		return true;
	case SNMP_SINGLES:
		return point->type == MAP_SINGLE;
	case SNMP_DOUBLES:
		return point->type == MAP_DOUBLE;
	case SNMP_STEPS:
		return class == MAP_CLASS_POSITION;
	case SNMP_BITSTRINGS:
		return class == MAP_CLASS_PATTERN;
	case SNMP_MEASURED:
		return class == MAP_CLASS_MEASURED;
	case SNMP_TOTALS:
		return class == MAP_CLASS_TOTAL;
	case SNMP_TEXTS:
		return (point->flags & MAP_POINT_TEXT) != 0;
	case SNMP_COMMANDS:
		return (point->flags & MAP_POINT_COMMAND) != 0;
	case SNMP_CYCLIC:
		return point->send_period_ms != 0;
	case SNMP_GROUPED:
		return point->group != 0;
	case SNMP_LISTS:
		break;
	}
	return false;
}

static int by_address(const void *a, const void *b, void *context)
{
	const struct snmp_agent *agent = context;
	const uint32_t one = *(const uint32_t *)a, other = *(const uint32_t *)b;
	const uint16_t ca = snmp_ca(agent, one), other_ca = snmp_ca(agent, other);

	if (ca != other_ca)
		return ca < other_ca ? -1 : 1;
	return agent->config->points[one].ioa < agent->config->points[other].ioa ? -1 : 1;
}

static int by_group(const void *a, const void *b, void *context)
{
	const struct snmp_agent *agent = context;
	const uint8_t one = agent->config->points[*(const uint32_t *)a].group,
		      other = agent->config->points[*(const uint32_t *)b].group;

	return one != other ? one - other : by_address(a, b, context);
}

static bool make_list(struct snmp_agent *agent, enum snmp_list number)
{
	const struct snmp_points *all = &agent->lists[SNMP_ALL];
	struct snmp_points *list = &agent->lists[number];
	uint32_t count = 0;

	for (uint32_t i = 0; i < agent->config->point_count; i++)
		count += belongs(&agent->config->points[i], number);
	list->points = malloc((count + 1) * sizeof(*list->points));
	if (list->points == NULL)
		return false;
	for (uint32_t i = 0; i < agent->config->point_count; i++) {
		const uint32_t point = number == SNMP_ALL ? i : all->points[i];

		if (belongs(&agent->config->points[point], number))
			list->points[list->count++] = point;
	}
	if (number == SNMP_ALL)
		qsort_r(list->points, count, sizeof(*list->points), by_address, agent);
	if (number == SNMP_GROUPED)
		qsort_r(list->points, count, sizeof(*list->points), by_group, agent);
	return true;
}

static bool go_together(const struct snmp_agent *agent, enum snmp_list list, uint32_t one, uint32_t other)
{
	return snmp_ca(agent, one) == snmp_ca(agent, other) &&
	       (list != SNMP_GROUPED ||
		agent->config->points[one].group == agent->config->points[other].group);
}

/* As many points of one station, and of one group, as a row takes, in their order. */
static bool make_images(const struct snmp_agent *agent, enum snmp_list list, struct snmp_images *images)
{
	const struct snmp_points *points = &agent->lists[list];
	struct snmp_image *image = NULL;

	images->images = malloc((points->count + 1) * sizeof(*images->images));
	if (images->images == NULL)
		return false;
	for (uint32_t i = 0; i < points->count; i++) {
		if (image == NULL || image->count == SNMP_IMAGE_POINTS ||
		    !go_together(agent, list, points->points[image->first], points->points[i])) {
			image = &images->images[images->count++];
			*image = (struct snmp_image){.first = i};
		}
		image->count++;
	}
	return true;
}

/* Over what a manager keeps of the points. */
static uint32_t number_of_configuration(const struct snmp_agent *agent)
{
	uint32_t hash = MAP_HASH_BASIS;

	for (uint32_t i = 0; i < agent->config->point_count; i++) {
		const struct map_point *point = &agent->config->points[i];
		char name[MAP_NAME_SIZE] = "";
		const uint32_t words[] = {snmp_ca(agent, i), point->ioa,   point->type,
					  point->flags,      point->group, snmp_decimals(point)};
		const float limits[] = {point->min, point->max};

		map_point_name(agent->config, point, name);
		hash = map_hash_octets(hash, words, sizeof(words));
		hash = map_hash_octets(hash, limits, sizeof(limits));
		hash = map_hash_octets(hash, name, strlen(name));
		hash = map_hash_octets(hash, map_unit_of(agent->config, point),
				       strlen(map_unit_of(agent->config, point)));
	}
	return hash;
}

/* ---- begin, end -------------------------------------------------------------------------- */

bool snmp_begin(struct snmp_agent *agent, struct map *map, struct snmp_shared *shared)
{
	*agent = (struct snmp_agent){.map = map,
				     .config = map_config(map),
				     .settings = snmp_settings(map_config(map)),
				     .shared = shared,
				     .started_ns = map_now_ns(),
				     .sampled = MAP_NONE};
	plant(agent);
	for (unsigned i = 0; i < SNMP_LISTS; i++)
		if (!make_list(agent, (enum snmp_list)i))
			return false;
	agent->commands = calloc(agent->lists[SNMP_COMMANDS].count + 1, sizeof(*agent->commands));
	if (agent->commands == NULL || !make_images(agent, SNMP_ALL, &agent->images) ||
	    !make_images(agent, SNMP_GROUPED, &agent->group_images) || !snmp_freezes_begin(agent) ||
	    !snmp_parameters_begin(agent) || !snmp_stations_begin(agent) || !snmp_cyclic_begin(agent))
		return false;
	agent->clock_setting.spin = snmp_first_spin(agent, 0);
	agent->configuration = number_of_configuration(agent);
	snmp_new_message(agent);
	snmp_events_begin(agent);
	snmp_sinks_begin(agent);
	snmp_commands_begin(agent);
	return true;
}

void snmp_end(struct snmp_agent *agent)
{
	for (unsigned i = 0; i < SNMP_LISTS; i++)
		free(agent->lists[i].points);
	free(agent->commands);
	free(agent->freezes);
	free(agent->parameters);
	free(agent->stations);
	snmp_cyclic_end(agent);
	free(agent->images.images);
	free(agent->group_images.images);
}
