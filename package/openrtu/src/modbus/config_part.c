/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The part of the configuration file that is about Modbus, as a whole: how large it is, what all lines share. */
#include "modbus/config_part.h"

#include <stdlib.h>

#include "config/meanings.h"
#include "config/scanners.h"
#include "map/map.h"
#include "modbus/config_loader.h"

enum { MODBUS_PRIORITY, MODBUS_HEARTBEAT_LIMIT, MODBUS_KEYS };
static const struct config_rule modbus_rules[MODBUS_KEYS] = {
    [MODBUS_PRIORITY] = {"priority", CONFIG_INTEGER, .low = 0, .high = 99, .fallback = 45,
			 CONFIG_SAYS(
			     "Real-time priority (SCHED_FIFO) of the rtu-modbus processes; 0: none.")},
    [MODBUS_HEARTBEAT_LIMIT] =
	{"heartbeat_limit_ms", CONFIG_INTEGER, .low = MAP_HEARTBEAT_LIMIT_MS,
	 .high = MAP_IDLE_HEARTBEAT_LIMIT_MS, .fallback = MAP_HEARTBEAT_LIMIT_MS,
	 CONFIG_SAYS(
	     "Milliseconds without a heartbeat of a rtu-modbus process after which its points are invalid.")},
};
CONFIG_TABLE(modbus_table, .name = "modbus", .rules = modbus_rules, .count = MODBUS_KEYS);

enum { FILE_PORT, FILE_MODBUS, FILE_KEYS };
static const struct config_rule file_rules[FILE_KEYS] = {
    [FILE_PORT] =
	{MODBUS_KEY_PORTS, CONFIG_ARRAY, .page = true, .inside = &modbus_port_inside, .required = true,
	 .high = MODBUS_PORTS_MAX,
	 CONFIG_SAYS(
	     "The serial lines and the Modbus TCP connections. Not all ports of the board need be there.",
	     .forms = CONFIG_FORMS(&modbus_inactive_table, &modbus_tcp_table, &modbus_port_table),
	     .json = CONFIG_JSON({
		     "items" : {
			     "if" : {
				     "type" : "object",
				     "required" : ["active"],
				     "properties" : {"active" : {"const" : 0}}
			     },
			     "then" : {"$ref" : "#/$defs/inactive_port"},
			     "else" : {
				     "if" : {
					     "type" : "object",
					     "anyOf" :
						 [ {"required" : ["host"]}, {"required" : ["tcp_port"]} ]
				     },
				     "then" : {"$ref" : "#/$defs/tcp_connection"},
				     "else" : {"$ref" : "#/$defs/port"}
			     }
		     }
	     }))},
    [FILE_MODBUS] = {"modbus", CONFIG_OBJECT,
		     CONFIG_SAYS("What all Modbus lines share.", .table = &modbus_table)},
};

static void read_settings(struct modbus_loader *loader, const struct config_place *place, const json_t *json)
{
	struct modbus_settings *settings = modbus_settings(loader->config);
	struct config_value values[MODBUS_KEYS];

	config_read_keys(loader->report, place, json, modbus_rules, MODBUS_KEYS, values);
	settings->priority = (uint8_t)values[MODBUS_PRIORITY].integer;
	settings->heartbeat_limit_ms = (uint16_t)values[MODBUS_HEARTBEAT_LIMIT].integer;
}

static uint32_t count_objects(const json_t *slave)
{
	size_t count = 0;

	for (size_t table = 0; table < MODBUS_TABLES; table++)
		count += json_array_size(json_object_get(slave, modbus_table_names[table]));
	return (uint32_t)count;
}

/* Of a slave, with those of its template. */
static uint64_t count_all_objects(const struct config_loader *files, const json_t *slave)
{
	const char *name = json_string_value(json_object_get(slave, MODBUS_KEY_TEMPLATE));
	const struct config_template *template = name == NULL ? NULL : config_find_template(files, name);

	return count_objects(slave) + (uint64_t)(template == NULL ? 0 : count_objects(template->json));
}

/* How many lines, devices and points the file can have at most, with every array as its rule allows it. */
static void count_records(struct modbus_loader *loader, const json_t *root)
{
	const json_t *ports = json_object_get(root, MODBUS_KEY_PORTS);
	const json_t *port, *slave;
	uint64_t points = 0;
	size_t i, j;

	if (json_array_size(ports) > MODBUS_PORTS_MAX)
		return;
	json_array_foreach(ports, i, port)
	{
		const json_t *slaves = json_object_get(port, MODBUS_KEY_SLAVES);

		loader->ports_max++;
		if (json_array_size(slaves) > MODBUS_UNIT_MAX + 1)
			continue;
		json_array_foreach(slaves, j, slave)
		{
			loader->slaves_max++;
			points += count_all_objects(loader->files, slave);
		}
	}
	loader->entries_max = points > CONFIG_POINTS_MAX ? CONFIG_POINTS_MAX : (uint32_t)points;
}

static bool begin(struct config_loader *files, void *own, const json_t *root)
{
	struct modbus_loader *loader = own;
	struct map_config *config = files->config;
	void *settings, *points, *ports, *slaves, *passes;

	*loader = (struct modbus_loader){.files = files, .report = &files->report, .config = config};
	count_records(loader, root);
	files->sets_max += loader->slaves_max;
	files->points_max += loader->entries_max;
	loader->entries = config_allocate(loader->entries_max, sizeof(*loader->entries));
	settings = config_allocate(1, sizeof(struct modbus_settings));
	points = config_allocate(loader->entries_max, sizeof(struct modbus_point));
	ports = config_allocate(loader->ports_max, sizeof(struct modbus_port));
	slaves = config_allocate(loader->slaves_max, sizeof(struct modbus_slave));
	passes = config_allocate(loader->ports_max, sizeof(struct modbus_pass));
	map_add_section(config, MODBUS_SETTINGS, sizeof(struct modbus_settings), 1, settings);
	map_add_section(config, MODBUS_POINTS, sizeof(struct modbus_point), 0, points);
	map_add_section(config, MODBUS_KNOTS, sizeof(struct modbus_knot), 0, NULL);
	map_add_section(config, MODBUS_EXTRAS, sizeof(struct modbus_extra), 0, NULL);
	map_add_section(config, MODBUS_PORTS, sizeof(struct modbus_port), 0, ports);
	map_add_section(config, MODBUS_SLAVES, sizeof(struct modbus_slave), 0, slaves);
	map_add_section(config, MODBUS_PASSES, sizeof(struct modbus_pass), 0, passes);
	return passes != NULL && loader->entries != NULL && settings != NULL && points != NULL &&
	       ports != NULL && slaves != NULL;
}

static void check_point_count(struct modbus_loader *loader, const struct config_place *file)
{
	const struct config_place here = config_key_of(file, file_rules[FILE_PORT].name);

	if (loader->objects > CONFIG_POINTS_MAX)
		config_error(loader->report, &here, "has %u objects, expected at most %d", loader->objects,
			     CONFIG_POINTS_MAX);
}

/* In the order in which the map wants them; only a name that was given is kept. */
static void keep_points(struct modbus_loader *loader)
{
	struct map_config *config = loader->config;
	struct config_place links[MODBUS_ENTRY_LINKS];

	for (uint32_t i = 0; i < config->point_count; i++) {
		const struct modbus_entry *entry = &loader->entries[i];

		config->points[i] = entry->point;
		*(struct modbus_point *)map_next_record(config, MODBUS_POINTS) = entry->wire;
		if (entry->named)
			config_keep_name(config, &config->points[i], entry->name);
		if (entry->names != NULL)
			config_keep_meanings(loader->report, config, i, entry->names);
		if (entry->ln != NULL)
			config_take_ln(loader->files, modbus_entry_place(entry, links), i, entry->ln);
	}
}

static void read_part(struct config_loader *files, void *own, const struct config_value *values)
{
	const struct config_place file = {.in = NULL};
	const struct config_place settings = config_key_of(&file, file_rules[FILE_MODBUS].name);
	struct modbus_loader *loader = own;

	(void)files;
	read_settings(loader, &settings, values[FILE_MODBUS].given ? values[FILE_MODBUS].json : NULL);
	modbus_check_templates(loader);
	if (values[FILE_PORT].given)
		modbus_read_ports(loader, &file, values[FILE_PORT].json);
	check_point_count(loader, &file);
	modbus_check_collisions(loader);
	modbus_resolve_extras(loader);
	modbus_resolve_keeps(loader);
	keep_points(loader);
}

static bool finish(struct config_loader *files, void *own)
{
	char name[MAP_NAME_SIZE];

	for (uint32_t i = 0; i < modbus_port_count(files->config); i++) {
		snprintf(name, sizeof(name), "line%u", modbus_ports(files->config)[i].port);
		config_add_scanner(files, name, false, modbus_settings(files->config)->priority);
	}
	return files->report.errors > 0 || modbus_check_periods(own);
}

static void end(void *own)
{
	struct modbus_loader *loader = own;

	free(loader->entries);
}

const struct config_part modbus_part = {
    .keys = file_rules,
    .key_count = FILE_KEYS,
    .own_size = sizeof(struct modbus_loader),
    .begin = begin,
    .read = read_part,
    .finish = finish,
    .end = end,
};
