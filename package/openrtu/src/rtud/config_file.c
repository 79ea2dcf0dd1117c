/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The file's outermost object: the settings of all modules, and the parts of the kinds. */
#include <stdlib.h>
#include <string.h>

#include "config/zone.h"
#include "modbus/config_part.h"
#include "rtud/config_parts.h"

#define EVENT_RING_LEAST  64
#define SELECT_TIMEOUT_S  30
#define COMMAND_TIMEOUT_S 10
#define FORCE_MAX_S       604800 /* a week */

/* 0: iec104, where these were first, may say it too. */
enum { COMMANDS_SELECT_TIMEOUT, COMMANDS_COMMAND_TIMEOUT, COMMANDS_KEYS };
static const struct config_rule commands_rules[COMMANDS_KEYS] = {
    [COMMANDS_SELECT_TIMEOUT] = {"select_timeout", CONFIG_INTEGER, .low = 1, .high = 3600,
				 CONFIG_SAYS("Seconds until a selection ends that was not executed; it also "
					     "ends with its requester's connection.",
					     .otherwise = SELECT_TIMEOUT_S, .unit = "s")},
    [COMMANDS_COMMAND_TIMEOUT] =
	{"command_timeout", CONFIG_INTEGER, .low = 1, .high = 3600,
	 CONFIG_SAYS(
	     "Seconds: the oldest acceptable time tag of a command, and the longest wait for the device.",
	     .otherwise = COMMAND_TIMEOUT_S, .unit = "s")},
};
CONFIG_TABLE(commands_table, .name = "commands", .rules = commands_rules, .count = COMMANDS_KEYS);

static const char *const clocks[] = {
    [MAP_CLOCK_GATEWAY] = "gateway", [MAP_CLOCK_MASTERS] = "masters", [MAP_CLOCK_SYSTEM] = "system", NULL};

enum {
	FILE_CLOCK,
	FILE_TIMEZONE,
	FILE_EVENT_RING,
	FILE_COMMANDS,
	FILE_FORCE_MAX,
	FILE_INCLUDE,
	FILE_TEMPLATES,
	FILE_KEYS
};
static const struct config_rule file_rules[FILE_KEYS] = {
    [FILE_CLOCK] = {"clock", CONFIG_CHOICE, .choices = clocks,
		    CONFIG_SAYS(
			"Where the gateway's time is from: the system's clock while that is synchronised, "
			"else a clock synchronisation (gateway); clock synchronisations alone (masters); "
			"always the system's clock, which a clock synchronisation sets as well (system).")},
    [FILE_TIMEZONE] =
	{"timezone", CONFIG_TEXT, .low = 4, .high = 63,
	 CONFIG_SAYS(
	     "Time zone of the time tags on the wire, as a POSIX TZ string with its rules. Without it, UTC.",
	     .pattern =
		 "^([A-Za-z]{3,}|<[A-Za-z0-9+-]{3,}>)[+-]?([01]?[0-9]|2[0-4])(:[0-5][0-9]){0,2}(([A-Za-z]{3,}"
		 "|<[A-Za-z0-9+-]{3,}>)([+-]?([01]?[0-9]|2[0-4])(:[0-5][0-9]){0,2})?(,M(1[0-2]|0?[1-9])\\.[1-"
		 "5]\\.[0-6](/[+-]?(1[0-5][0-9]|16[0-7]|[0-9]{1,2})(:[0-5][0-9]){0,2})?){2})?$",
	     .json = CONFIG_JSON({
		     "examples" : [ "UTC0", "CET-1CEST,M3.5.0,M10.5.0/3", "<-03>3<-02>,M3.5.0/-2,M10.5.0/-1" ]
	     }))},
    [FILE_EVENT_RING] =
	{"event_ring", CONFIG_INTEGER, .low = EVENT_RING_LEAST, .high = 65536, .fallback = 4096,
	 CONFIG_SAYS("Events each module keeps for readers that are late, one less than this.",
		     .json = CONFIG_JSON(
			 {"enum" : [ 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768, 65536 ]}))},
    [FILE_COMMANDS] = {"commands", CONFIG_OBJECT,
		       CONFIG_SAYS("What holds for the commands of all protocols.",
				   .table = &commands_table)},
    [FILE_FORCE_MAX] =
	{"force_max_s", CONFIG_INTEGER, .low = 1, .high = FORCE_MAX_S,
	 CONFIG_SAYS("So many seconds `rtuctl force` may force a point at most; without the key, it may not.",
		     .see = "telecontrol.md#forced-points", .json = CONFIG_JSON({"examples" : [3600]}))},
    [FILE_INCLUDE] = {CONFIG_KEY_INCLUDE, CONFIG_ARRAY, .high = CONFIG_FILES_MAX,
		      CONFIG_SAYS("Files whose templates this one uses, by names relative to its folder. "
				  "Each has templates, include and about alone.",
				  .see = "configuration.md#templates",
				  .json = CONFIG_JSON(
				      {"items" : {"type" : "string", "minLength" : 1}, "examples" : [[]]}))},
    [FILE_TEMPLATES] =
	{CONFIG_KEY_TEMPLATES, CONFIG_OBJECT, .page = true, .inside = &modbus_templates_inside,
	 CONFIG_SAYS(
	     "Devices that are described once, by name. Each is a slave without its id.",
	     .see = "configuration.md#templates", .forms = CONFIG_FORMS(&modbus_template_table),
	     .json = CONFIG_JSON({
		     "additionalProperties" : {"$ref" : "#/$defs/template"},
		     "examples" : [ {}, {"relay" : {"period_ms" : 1000, "coils" : [ {"address" : 0} ]}} ]
	     }))},
};

static void read_commands(struct config_loader *loader, const struct config_place *file,
			  const struct config_value *value)
{
	const struct config_place here = config_key_of(file, file_rules[FILE_COMMANDS].name);
	struct map_settings *settings = &loader->config->settings;
	struct config_value values[COMMANDS_KEYS];

	config_read_keys(&loader->report, &here, value->given ? value->json : NULL, commands_rules,
			 COMMANDS_KEYS, values);
	settings->select_timeout_s = (uint16_t)values[COMMANDS_SELECT_TIMEOUT].integer;
	settings->command_timeout_s = (uint16_t)values[COMMANDS_COMMAND_TIMEOUT].integer;
}

/* What nobody gave. */
static void complete_commands(struct map_settings *settings)
{
	if (settings->select_timeout_s == 0)
		settings->select_timeout_s = SELECT_TIMEOUT_S;
	if (settings->command_timeout_s == 0)
		settings->command_timeout_s = COMMAND_TIMEOUT_S;
}

static void read_event_ring(struct config_loader *loader, const struct config_place *file,
			    const struct config_value *value)
{
	const struct config_place here = config_key_of(file, file_rules[FILE_EVENT_RING].name);

	loader->config->settings.event_ring = (uint32_t)value->integer;
	if (value->given && (value->integer & (value->integer - 1)) != 0)
		config_error(&loader->report, &here,
			     "%lld is not a power of two, expected 64, 128, ... 65536",
			     (long long)value->integer);
}

static void read_timezone(struct config_loader *loader, const struct config_place *file,
			  const struct config_value *value)
{
	const struct config_place here = config_key_of(file, file_rules[FILE_TIMEZONE].name);

	if (value->given && !config_read_zone(value->text, &loader->config->settings.zone))
		config_error(&loader->report, &here,
			     "is not a time zone, expected one like UTC0 or CET-1CEST,M3.5.0,M10.5.0/3");
}

size_t config_file_rules(const struct config_part *const parts[], size_t part_count,
			 struct config_rule rules[CONFIG_FILE_KEYS_MAX])
{
	size_t count = FILE_KEYS;

	memcpy(rules, file_rules, sizeof(file_rules));
	for (size_t i = 0; i < part_count; i++) {
		const struct config_part *part = parts[i];

		if (count + part->key_count > CONFIG_FILE_KEYS_MAX)
			abort(); /* the table of kinds outgrew CONFIG_FILE_KEYS_MAX */
		memcpy(&rules[count], part->keys, part->key_count * sizeof(*rules));
		count += part->key_count;
	}
	return count;
}

bool config_begin_file(struct rtud_loader *loader, const json_t *root)
{
	struct config_loader *files = &loader->files;
	struct map_config *config = files->config;
	struct map_unit *units = config_allocate(MAP_UNITS_MAX, sizeof(*units));
	bool begun = units != NULL;

	map_add_section(config, MAP_UNITS, sizeof(*units), 0, units);
	loader->part_count = kinds_parts(loader->parts);
	for (size_t i = 0; begun && i < loader->part_count; i++) {
		loader->own[i] = config_allocate((uint32_t)loader->parts[i]->own_size, 1);
		begun = loader->own[i] != NULL && (loader->parts[i]->begin == NULL ||
						   loader->parts[i]->begin(files, loader->own[i], root));
	}
	config->sets = config_allocate(files->sets_max, sizeof(struct map_set));
	config->points = config_allocate(files->points_max, sizeof(struct map_point));
	config->names = config_allocate(files->points_max + 1, MAP_NAME_SIZE);
	config->names_size = 1;
	config->modules = config_allocate(MAP_MODULES_MAX, sizeof(struct map_module_plan));
	return begun && config->sets != NULL && config->points != NULL && config->names != NULL &&
	       config->modules != NULL;
}

bool config_read_file(struct rtud_loader *loader, const json_t *root)
{
	const struct config_place file = {.in = NULL};
	struct config_loader *files = &loader->files;
	struct config_rule rules[CONFIG_FILE_KEYS_MAX];
	struct config_value values[CONFIG_FILE_KEYS_MAX];
	const size_t count = config_file_rules(loader->parts, loader->part_count, rules);
	size_t next = FILE_KEYS;
	bool good = true;

	config_read_keys(&files->report, &file, root, rules, count, values);
	if (!json_is_object(root))
		return true;
	files->config->settings.clock = (uint8_t)values[FILE_CLOCK].integer;
	files->config->settings.force_max_s = (uint32_t)values[FILE_FORCE_MAX].integer;
	read_event_ring(files, &file, &values[FILE_EVENT_RING]);
	read_timezone(files, &file, &values[FILE_TIMEZONE]);
	read_commands(files, &file, &values[FILE_COMMANDS]);
	config_check_included(files);
	for (size_t i = 0; i < loader->part_count; i++) {
		if (loader->parts[i]->read != NULL)
			loader->parts[i]->read(files, loader->own[i], &values[next]);
		next += loader->parts[i]->key_count;
	}
	complete_commands(&files->config->settings);
	for (size_t i = 0; good && i < loader->part_count; i++)
		good = loader->parts[i]->finish == NULL || loader->parts[i]->finish(files, loader->own[i]);
	for (size_t i = 0; good && i < loader->part_count; i++)
		good = loader->parts[i]->link == NULL || loader->parts[i]->link(files, loader->own[i]);
	return good;
}

void config_end_file(struct rtud_loader *loader)
{
	config_index_free(&loader->files.index);
	for (size_t i = 0; i < loader->part_count; i++) {
		if (loader->own[i] != NULL && loader->parts[i]->end != NULL)
			loader->parts[i]->end(loader->own[i]);
		free(loader->own[i]);
	}
}
