/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Controlling stations: who may connect, who may command, and which of them are redundant. */
#include "rtud/config_parts.h"

#include <string.h>

#include "map/address.h"

#define QUEUE_LEAST 100
#define QUEUE_MOST  65535

enum { GROUP_NAME, GROUP_MASTERS, GROUP_QUEUE, GROUP_KEYS };
static const struct config_rule group_rules[GROUP_KEYS] = {
    [GROUP_NAME] = {"name", CONFIG_TEXT, .required = true, .low = 1, .high = MAP_NAME_SIZE - 1},
    [GROUP_MASTERS] = {"masters", CONFIG_ARRAY, .required = true, .high = MAP_GROUP_MASTERS_MAX},
    [GROUP_QUEUE] = {"queue", CONFIG_INTEGER, .low = QUEUE_LEAST, .high = QUEUE_MOST},
};

/* ---- addresses --------------------------------------------------------------------------- */

bool config_is_same_address(const char *a, const char *b)
{
	struct in6_addr left, right;

	return map_address_parse(a, &left) && map_address_parse(b, &right) &&
	       memcmp(&left, &right, sizeof(left)) == 0;
}

void config_read_address(struct config_loader *loader, const struct config_place *place, const char *text,
			 char out[MAP_ADDRESS_SIZE])
{
	struct in6_addr parsed;

	if (map_address_parse(text, &parsed))
		snprintf(out, MAP_ADDRESS_SIZE, "%s", text);
	else
		config_error(&loader->report, place,
			     "is not an IP address, expected one like 192.0.2.1 or 2001:db8::1");
}

uint32_t config_read_addresses(struct config_loader *loader, const struct config_place *array,
			       const json_t *addresses, char (*out)[MAP_ADDRESS_SIZE])
{
	const json_t *json;
	size_t i;

	json_array_foreach(addresses, i, json)
	{
		const struct config_place place = config_element_of(array, i);

		if (json_is_string(json))
			config_read_address(loader, &place, json_string_value(json), out[i]);
		else
			config_error(&loader->report, &place, "is not a string, expected an IP address");
	}
	return (uint32_t)json_array_size(addresses);
}

/* An empty list could mean everybody as well as nobody. */
static bool is_empty(struct config_loader *loader, const struct config_place *array, const json_t *json)
{
	if (json_array_size(json) > 0)
		return false;
	config_error(&loader->report, array, "is empty, expected at least one element");
	return true;
}

void config_read_masters(struct config_loader *loader, const struct config_place *array, const json_t *json)
{
	struct map_settings *settings = &loader->config->settings;

	if (!is_empty(loader, array, json))
		settings->master_count = config_read_addresses(loader, array, json, settings->masters);
}

/* ---- redundancy groups ------------------------------------------------------------------- */

static void check_name(struct config_loader *loader, const struct config_place *group,
		       const struct map_group *groups, uint32_t index)
{
	const struct config_place here = config_key_of(group, group_rules[GROUP_NAME].name);

	for (uint32_t i = 0; i < index; i++)
		if (groups[index].name[0] != '\0' && strcmp(groups[i].name, groups[index].name) == 0)
			config_error(&loader->report, &here,
				     "is also the name of redundancy_groups[%u], expected another one", i);
}

/* A controlling station is in one group at most: its events have one queue. */
static void check_masters(struct config_loader *loader, const struct config_place *array,
			  const struct map_group *groups, uint32_t index)
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
	struct map_group *groups = loader->config->settings.groups, *group = &groups[index];
	struct config_value values[GROUP_KEYS];

	config_read_keys(&loader->report, place, json, group_rules, GROUP_KEYS, values);
	group->queue = read_queue(loader, place, &values[GROUP_QUEUE]);
	if (values[GROUP_NAME].given) {
		snprintf(group->name, sizeof(group->name), "%s", values[GROUP_NAME].text);
		check_name(loader, place, groups, index);
	}
	if (!values[GROUP_MASTERS].given || is_empty(loader, &array, values[GROUP_MASTERS].json))
		return;
	group->master_count =
	    config_read_addresses(loader, &array, values[GROUP_MASTERS].json, group->masters);
	check_masters(loader, &array, groups, index);
}

void config_read_groups(struct config_loader *loader, const struct config_place *array, const json_t *json)
{
	const json_t *group;
	size_t i;

	json_array_foreach(json, i, group)
	{
		const struct config_place place = config_element_of(array, i);

		read_group(loader, &place, group, (uint32_t)i);
	}
	loader->config->settings.group_count = (uint32_t)json_array_size(json);
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
			const struct map_group *group)
{
	const struct config_place array = config_key_of(place, group_rules[GROUP_MASTERS].name);
	const struct map_settings *settings = &loader->config->settings;

	for (uint32_t i = 0; i < group->master_count; i++) {
		const struct config_place here = config_element_of(&array, i);

		if (group->masters[i][0] != '\0' &&
		    !is_among(group->masters[i], settings->masters, settings->master_count))
			config_error(&loader->report, &here,
				     "may not connect, expected one of \"masters\", or add it there");
	}
}

static bool is_lone(const struct map_settings *settings, uint32_t master)
{
	for (uint32_t i = 0; i < settings->group_count; i++)
		if (is_among(settings->masters[master], settings->groups[i].masters,
			     settings->groups[i].master_count))
			return false;
	return !is_among(settings->masters[master], settings->masters, master); /* said once more */
}

void config_check_masters(struct config_loader *loader, const struct config_place *groups)
{
	struct map_settings *settings = &loader->config->settings;

	for (uint32_t i = 0; settings->master_count > 0 && i < settings->group_count; i++) {
		const struct config_place place = config_element_of(groups, i);

		check_group(loader, &place, &settings->groups[i]);
	}
	for (uint32_t i = 0; i < settings->master_count; i++)
		settings->lone_masters += is_lone(settings, i);
}

/* ---- originators ------------------------------------------------------------------------- */

void config_read_originators(struct config_loader *loader, const struct config_place *array,
			     const json_t *json)
{
	uint32_t *refused = loader->config->settings.originators_refused;
	const json_t *originator;
	size_t i;

	if (is_empty(loader, array, json))
		return;
	memset(refused, 0xff, sizeof(loader->config->settings.originators_refused));
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
