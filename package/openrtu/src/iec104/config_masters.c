/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Controlling stations: who may connect, who may command, and which of them are redundant. */
#include "iec104/config_readers.h"

#include <string.h>

#include "config/address.h"

#define QUEUE_LEAST 100
#define QUEUE_MOST  65535

enum { GROUP_NAME, GROUP_MASTERS, GROUP_QUEUE, GROUP_KEYS };
static const struct config_rule group_rules[GROUP_KEYS] = {
    [GROUP_NAME] = {"name", CONFIG_TEXT, .required = true, .low = 1, .high = MAP_NAME_SIZE - 1,
		    CONFIG_SAYS("Name of the group, once in the file; `rtuctl iec104 queues` shows it.")},
    [GROUP_MASTERS] = {"masters", CONFIG_ARRAY, .required = true, .high = IEC104_GROUP_MASTERS_MAX,
		       CONFIG_SAYS(
			   "IP addresses of the group's controlling stations, each in one group only. With "
			   "the file's `masters`, they must be there too.",
			   .json = CONFIG_JSON({"minItems" : 1, "items" : {"$ref" : "#/$defs/ip_address"}}))},
    [GROUP_QUEUE] = {"queue", CONFIG_INTEGER, .low = QUEUE_LEAST, .high = QUEUE_MOST,
		     CONFIG_SAYS("Events that may wait for the group, less than `event_ring`. Without it, as "
				 "many as the modules keep.")},
};
CONFIG_SHARED_TABLE(iec104_group_table, .name = "redundancy_group", .rules = group_rules,
		    .count = GROUP_KEYS);

/* An empty list could mean everybody as well as nobody. */
static bool is_empty(struct config_loader *loader, const struct config_place *array, const json_t *json)
{
	if (json_array_size(json) > 0)
		return false;
	config_error(&loader->report, array, "is empty, expected at least one element");
	return true;
}

void iec104_read_masters(struct config_loader *loader, const struct config_place *array, const json_t *json)
{
	struct iec104_settings *settings = iec104_settings(loader->config);

	if (!is_empty(loader, array, json))
		settings->master_count =
		    config_read_addresses(&loader->report, array, json, settings->masters);
}

/* ---- redundancy groups ------------------------------------------------------------------- */

static void check_name(struct config_loader *loader, const struct config_place *group,
		       const struct map_queue_plan *queues, uint32_t index)
{
	const struct config_place here = config_key_of(group, group_rules[GROUP_NAME].name);

	for (uint32_t i = 0; i < index; i++)
		if (queues[index].name[0] != '\0' && strcmp(queues[i].name, queues[index].name) == 0)
			config_error(&loader->report, &here,
				     "is also the name of redundancy_groups[%u], expected another one", i);
}

/* A controlling station is in one group at most: its events have one queue. */
static void check_masters(struct config_loader *loader, const struct config_place *array,
			  const struct iec104_group *groups, uint32_t index)
{
	for (uint32_t master = 0; master < groups[index].master_count; master++) {
		const struct config_place here = config_element_of(array, master);

		for (uint32_t i = 0; i <= index; i++)
			for (uint32_t j = 0; j < (i < index ? groups[i].master_count : master); j++)
				if (config_is_same_address(groups[i].masters[j],
							   groups[index].masters[master]))
					config_error(&loader->report, &here,
						     "is also redundancy_groups[%u].masters[%u], expected "
						     "each address once",
						     i, j);
	}
}

static uint32_t read_queue(struct config_loader *loader, const struct config_place *group,
			   const struct config_value *value)
{
	const struct config_place here = config_key_of(group, group_rules[GROUP_QUEUE].name);
	uint32_t most = loader->config->settings.event_ring - 1;

	if (value->given && value->integer > most)
		config_error(&loader->report, &here,
			     "%lld is more than the modules keep, expected less than event_ring (%u)",
			     (long long)value->integer, most + 1);
	return value->given ? (uint32_t)value->integer : most;
}

static void read_group(struct config_loader *loader, const struct config_place *place, const json_t *json,
		       uint32_t index)
{
	const struct config_place array = config_key_of(place, group_rules[GROUP_MASTERS].name);
	struct iec104_group *groups = iec104_settings(loader->config)->groups, *group = &groups[index];
	struct map_queue_plan *queues = loader->config->settings.queues, *queue = &queues[index];
	struct config_value values[GROUP_KEYS];

	config_read_keys(&loader->report, place, json, group_rules, GROUP_KEYS, values);
	queue->slot = index;
	queue->limit = read_queue(loader, place, &values[GROUP_QUEUE]);
	if (values[GROUP_NAME].given) {
		snprintf(queue->name, sizeof(queue->name), "%s", values[GROUP_NAME].text);
		check_name(loader, place, queues, index);
	}
	if (!values[GROUP_MASTERS].given || is_empty(loader, &array, values[GROUP_MASTERS].json))
		return;
	group->master_count =
	    config_read_addresses(&loader->report, &array, values[GROUP_MASTERS].json, group->masters);
	check_masters(loader, &array, groups, index);
}

void iec104_read_groups(struct config_loader *loader, const struct config_place *array, const json_t *json)
{
	const json_t *group;
	size_t i;

	json_array_foreach(json, i, group)
	{
		const struct config_place place = config_element_of(array, i);

		read_group(loader, &place, group, (uint32_t)i);
	}
	loader->config->settings.queue_count = (uint8_t)json_array_size(json);
}

/* ---- both -------------------------------------------------------------------------------- */

static bool is_among(const char *address, const char (*list)[MAP_ADDRESS_SIZE], uint32_t count)
{
	for (uint32_t i = 0; i < count; i++)
		if (config_is_same_address(list[i], address))
			return true;
	return false;
}

static void check_group(struct config_loader *loader, const struct config_place *place,
			const struct iec104_group *group)
{
	const struct config_place array = config_key_of(place, group_rules[GROUP_MASTERS].name);
	const struct iec104_settings *settings = iec104_settings(loader->config);

	for (uint32_t i = 0; i < group->master_count; i++) {
		const struct config_place here = config_element_of(&array, i);

		if (group->masters[i][0] != '\0' &&
		    !is_among(group->masters[i], settings->masters, settings->master_count))
			config_error(&loader->report, &here,
				     "may not connect, expected one of \"masters\", or add it there");
	}
}

static bool is_lone(const struct iec104_settings *settings, uint32_t groups, uint32_t master)
{
	for (uint32_t i = 0; i < groups; i++)
		if (is_among(settings->masters[master], settings->groups[i].masters,
			     settings->groups[i].master_count))
			return false;
	return !is_among(settings->masters[master], settings->masters, master); /* said once more */
}

void iec104_check_masters(struct config_loader *loader, const struct config_place *groups)
{
	struct iec104_settings *settings = iec104_settings(loader->config);

	for (uint32_t i = 0; settings->master_count > 0 && i < loader->config->settings.queue_count; i++) {
		const struct config_place place = config_element_of(groups, i);

		check_group(loader, &place, &settings->groups[i]);
	}
	for (uint32_t i = 0; i < settings->master_count; i++)
		settings->lone_masters += is_lone(settings, loader->config->settings.queue_count, i);
}

/* ---- originators ------------------------------------------------------------------------- */

void iec104_read_originators(struct config_loader *loader, const struct config_place *array,
			     const json_t *json)
{
	uint32_t *refused = iec104_settings(loader->config)->originators_refused;
	const json_t *originator;
	size_t i;

	if (is_empty(loader, array, json))
		return;
	memset(refused, 0xff, sizeof(iec104_settings(loader->config)->originators_refused));
	json_array_foreach(json, i, originator)
	{
		const struct config_place place = config_element_of(array, i);
		json_int_t address = json_integer_value(originator);

		if (!json_is_integer(originator) || address < 0 || address > UINT8_MAX)
			config_error(&loader->report, &place,
				     "is not an originator address, expected 0 to 255");
		else
			refused[address / 32] &= ~(1u << address % 32);
	}
}
