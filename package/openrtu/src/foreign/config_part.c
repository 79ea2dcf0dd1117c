/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The array "modules": programs that others wrote, with their points and what they read. */
#include "foreign/config_part.h"

#include <ctype.h>
#include <fnmatch.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "config/commands.h"
#include "config/names.h"
#include "config/scanners.h"
#include "config/sets.h"
#include "foreign/config.h"
#include "foreign/config_keys.h"
#include "map/type.h"

#define MODULES_MAX              48 /* a map has MAP_MODULES_MAX, with the gateway's own */
#define HEARTBEAT_LIMIT_LEAST_MS 100
#define HEARTBEAT_LIMIT_MOST_MS  5000
#define OWN_PREFIX               "rtu" /* of the names of our modules */

static const struct config_rule file_rule = {
    .name = "modules",
    .kind = CONFIG_ARRAY,
    .high = MODULES_MAX,
    CONFIG_SAYS("Programs that others wrote, with points of their own.", .table = &foreign_module_table)};

struct own {
	const json_t *modules;
	struct foreign_module *records;
	struct foreign_point *points;
	uint32_t point_count;
	uint32_t *reads;
	uint32_t read_count;
	uint32_t *listed; /* that modules may command */
	uint32_t listed_count;
	char *texts;
	size_t texts_size;
	struct config_value (*values)[MODULE_KEYS]; /* of each module */
	bool *is_named;                             /* by point, of the list that is read now */
	bool no_memory;
};

/* ---- names and texts --------------------------------------------------------------------- */

/* Returns the text's place. */
static uint32_t keep_text(struct own *own, const char *text)
{
	size_t size = strlen(text) + 1;
	char *grown = realloc(own->texts, own->texts_size + size);

	if (grown == NULL) {
		own->no_memory = true;
		return 0;
	}
	own->texts = grown;
	memcpy(own->texts + own->texts_size, text, size);
	own->texts_size += size;
	return (uint32_t)(own->texts_size - size);
}

/* It names files of the map, and one of our own kinds' would be taken for it. */
static void check_module_name(struct config_loader *loader, const struct config_place *place,
			      const struct own *own, const struct foreign_module *module)
{
	const struct config_place here = config_key_of(place, CONFIG_KEY_NAME);

	for (const char *c = module->name; *c != '\0'; c++)
		if (!isalnum((unsigned char)*c) && *c != '-' && *c != '_') {
			config_error(&loader->report, &here,
				     "has other characters than letters, digits, - and _");
			break;
		}
	if (strncmp(module->name, OWN_PREFIX, strlen(OWN_PREFIX)) == 0)
		config_error(&loader->report, &here,
			     "begins with \"" OWN_PREFIX "\", which is for the gateway's own modules");
	for (const struct foreign_module *other = own->records; other < module; other++)
		if (module->name[0] != '\0' && strcmp(other->name, module->name) == 0)
			config_error(&loader->report, &here, "\"%s\" is the name of another module",
				     module->name);
}

/* ---- what a module reads and commands ---------------------------------------------------- */

/* A list of a module with names and patterns of others' points. */
struct list {
	const struct config_rule *rule;
	bool (*has)(const struct map_point *point); /* NULL: any */
	const char *lack;                           /* of a point by its whole name that it may not have */
};

static bool has_value(const struct map_point *point)
{
	return (point->flags & MAP_POINT_NEVER_READ) == 0;
}

static bool takes_commands(const struct map_point *point)
{
	return point->flags & MAP_POINT_COMMAND;
}

static const struct list reads_list = {
    .rule = &foreign_module_rules[MODULE_READS], .has = has_value, .lack = "takes commands and has no value"};
static const struct list commands_list = {
    .rule = &foreign_module_rules[MODULE_COMMANDS], .has = takes_commands, .lack = "takes no commands"};

static void read_pattern(struct config_loader *loader, const struct config_place *here, struct own *own,
			 const struct foreign_module *module, const struct list *list, const char *pattern)
{
	const struct map_config *config = loader->config;
	bool found = false;
	char name[MAP_NAME_SIZE];

	for (uint32_t i = 0; i < config->point_count; i++) {
		map_point_name(config, &config->points[i], name);
		if (config->points[i].set == module->set || fnmatch(pattern, name, 0) != 0)
			continue;
		found = true;
		if (!list->has(&config->points[i]))
			config_error(&loader->report, here, "\"%s\" %s", name, list->lack);
		own->is_named[i] = true;
	}
	if (!found)
		config_error(&loader->report, here, "\"%s\" fits no name of another module's point", pattern);
}

/* Adds the points that are named to a table, and returns how many there are. */
static uint32_t keep_named(struct own *own, uint32_t point_count, uint32_t **table, uint32_t *count)
{
	const uint32_t first = *count;
	uint32_t *grown = realloc(*table, (first + point_count + 1) * sizeof(*grown));

	if (grown == NULL) {
		own->no_memory = true;
		return 0;
	}
	*table = grown;
	for (uint32_t i = 0; i < point_count; i++)
		if (own->is_named[i])
			grown[(*count)++] = i;
	return *count - first;
}

static void read_list(struct config_loader *loader, const struct config_place *place, struct own *own,
		      const struct foreign_module *module, const struct list *list,
		      const struct config_value *value)
{
	const struct config_place array = config_key_of(place, list->rule->name);
	const json_t *patterns = value->given ? value->json : NULL;

	memset(own->is_named, 0, loader->config->point_count * sizeof(*own->is_named));
	for (size_t i = 0; i < json_array_size(patterns); i++) {
		const struct config_place here = config_element_of(&array, i);
		const char *pattern = json_string_value(json_array_get(patterns, i));

		if (pattern == NULL || pattern[0] == '\0')
			config_error(&loader->report, &here,
				     "is no text, expected the name of a point or a pattern");
		else
			read_pattern(loader, &here, own, module, list, pattern);
	}
}

static void read_lists(struct config_loader *loader, const struct config_place *place, struct own *own,
		       struct foreign_module *module, const struct config_value *values)
{
	const uint32_t points = loader->config->point_count;

	read_list(loader, place, own, module, &reads_list, &values[MODULE_READS]);
	module->first_read = own->read_count;
	module->read_count = keep_named(own, points, &own->reads, &own->read_count);
	read_list(loader, place, own, module, &commands_list, &values[MODULE_COMMANDS]);
	module->first_command = own->listed_count;
	module->command_count = keep_named(own, points, &own->listed, &own->listed_count);
}

/* ---- points ------------------------------------------------------------------------------ */

static bool can_hold(enum map_type type, double value)
{
	const struct map_type_row *row = &map_types[type];
	union map_value ignored;

	if (type == MAP_FLOAT || type == MAP_ANGLE)
		return map_value_of(type, value, &ignored);
	return value >= row->low && value <= row->high && value == map_nearest(value);
}

static double initial_of(struct config_loader *loader, const struct config_place *place, enum map_type type,
			 const struct config_value *value)
{
	const struct config_place here = config_key_of(place, foreign_point_rules[POINT_INITIAL].name);

	if (!value->given)
		return NAN;
	if (!can_hold(type, value->number))
		config_error(&loader->report, &here, "%g is no value of a point of type %s", value->number,
			     map_types[type].name);
	return value->number;
}

#define BIT(type) (1u << (type))

/* By key of a point: the types that it has a meaning for, 0: all. */
static const unsigned point_key_types[POINT_KEYS] = {
    [POINT_COMMAND] = ~BIT(MAP_COUNTER),
    [POINT_SHORT_PULSE] = BIT(MAP_SINGLE) | BIT(MAP_DOUBLE),
    [POINT_LONG_PULSE] = BIT(MAP_SINGLE) | BIT(MAP_DOUBLE),
    [POINT_COUNTER_GROUP] = BIT(MAP_COUNTER),
    [POINT_FREEZE] = BIT(MAP_COUNTER),
};

static void check_keys(struct config_loader *loader, const struct config_place *place, enum map_type type,
		       const struct config_value *values)
{
	for (unsigned key = 0; key < POINT_KEYS; key++) {
		const struct config_place here = config_key_of(place, foreign_point_rules[key].name);

		if (values[key].given && point_key_types[key] != 0 && !(point_key_types[key] & BIT(type)))
			config_error(&loader->report, &here, "has no meaning for type %s",
				     map_types[type].name);
	}
}

static void add_point(struct config_loader *loader, const struct config_place *place, struct own *own,
		      const struct config_value *values)
{
	const enum map_type type = (enum map_type)values[POINT_TYPE].integer;
	const struct config_place name = config_key_of(place, CONFIG_KEY_NAME);
	const struct config_commands commands = {&values[POINT_COMMAND], &values[POINT_SELECT],
						 &values[POINT_SHORT_PULSE], &values[POINT_LONG_PULSE]};
	struct map_point *point = config_add_point(loader, place, values[POINT_NAME].text, type,
						   (uint32_t)values[POINT_IOA].integer);

	config_check_commands(&loader->report, place, &commands);
	check_keys(loader, place, type, values);
	config_check_name(&loader->report, &name, values[POINT_NAME].text);
	point->group = (uint8_t)values[POINT_GROUP].integer;
	point->deadband = (float)values[POINT_DEADBAND].number;
	point->flags |= values[POINT_RETAIN].integer ? MAP_POINT_RETAIN : 0;
	config_set_commands(&commands, point);
	point->counter_group = (uint8_t)values[POINT_COUNTER_GROUP].integer;
	point->freeze_s = (uint32_t)values[POINT_FREEZE].integer;
	if (values[POINT_LN].given)
		config_take_ln(loader, place, loader->config->point_count - 1, values[POINT_LN].text);
	if (values[POINT_UNIT].given)
		config_keep_unit(loader->config, point, values[POINT_UNIT].text);
	own->points[own->point_count++] = (struct foreign_point){
	    .description =
		values[POINT_DESCRIPTION].given ? keep_text(own, values[POINT_DESCRIPTION].text) : 0,
	    .initial = initial_of(loader, place, type, &values[POINT_INITIAL]),
	};
}

static void read_points(struct config_loader *loader, const struct config_place *place, struct own *own,
			const json_t *points)
{
	const struct config_place array = config_key_of(place, foreign_module_rules[MODULE_POINTS].name);

	for (size_t i = 0; i < json_array_size(points); i++) {
		const struct config_place here = config_element_of(&array, i);
		const unsigned errors = loader->report.errors;
		struct config_value values[POINT_KEYS];

		config_read_keys(&loader->report, &here, json_array_get(points, i), foreign_point_rules,
				 POINT_KEYS, values);
		if (loader->report.errors == errors)
			add_point(loader, &here, own, values);
	}
}

static void add_set(struct config_loader *loader, const struct config_place *place, struct own *own,
		    struct foreign_module *module, const struct config_value *values)
{
	const struct config_place here = config_key_of(place, foreign_module_rules[MODULE_CA].name);
	const struct config_place points = config_key_of(place, foreign_module_rules[MODULE_POINTS].name);

	module->set = FOREIGN_NO_SET;
	if (json_array_size(values[MODULE_POINTS].json) == 0)
		return;
	if (!values[MODULE_CA].given) {
		if (!values[MODULE_CA].wrong)
			config_error(&loader->report, &points, "need \"ca\", their common address");
		return;
	}
	module->set = (uint16_t)loader->config->set_count;
	module->first_point = own->point_count;
	config_add_set(loader, &here, (uint16_t)values[MODULE_CA].integer, module->name);
	read_points(loader, place, own, values[MODULE_POINTS].json);
}

/* ---- a module ---------------------------------------------------------------------------- */

static uint32_t heartbeat_limit_ms(const struct config_value *limit, uint32_t period_ms)
{
	if (limit->given)
		return (uint32_t)limit->integer;
	if (period_ms > HEARTBEAT_LIMIT_MOST_MS / 2)
		return HEARTBEAT_LIMIT_MOST_MS;
	return period_ms < HEARTBEAT_LIMIT_LEAST_MS / 2 ? HEARTBEAT_LIMIT_LEAST_MS : 2 * period_ms;
}

static void keep_value(char *out, size_t size, const struct config_value *value)
{
	snprintf(out, size, "%s", value->given ? value->text : "");
}

static uint32_t keep_config(struct own *own, const json_t *json)
{
	char *text = json == NULL ? strdup("{}") : json_dumps(json, JSON_COMPACT);
	uint32_t place = 0;

	if (text == NULL)
		own->no_memory = true;
	else
		place = keep_text(own, text);
	free(text);
	return place;
}

/* Two of one user could stop each other; root's could do anything. */
static void check_user(struct config_loader *loader, const struct config_place *place, const struct own *own,
		       const struct foreign_module *module)
{
	const struct config_place here = config_key_of(place, foreign_module_rules[MODULE_USER].name);

	if (strcmp(module->user, "root") == 0)
		config_error(&loader->report, &here, "is root, expected a user without rights");
	for (const struct foreign_module *other = own->records; other < module; other++)
		if (module->user[0] != '\0' && strcmp(other->user, module->user) == 0)
			config_error(&loader->report, &here, "\"%s\" is the user of another module",
				     module->user);
}

static void check_program(struct config_loader *loader, const struct config_place *place,
			  const struct config_value *value)
{
	const struct config_place here = config_key_of(place, foreign_module_rules[MODULE_PROGRAM].name);

	if (value->given && value->text[0] != '/')
		config_error(&loader->report, &here, "is not an absolute path");
}

static void read_module(struct config_loader *loader, const struct config_place *place, struct own *own,
			struct foreign_module *module, const struct config_value *values)
{
	keep_value(module->name, sizeof(module->name), &values[MODULE_NAME]);
	keep_value(module->program, sizeof(module->program), &values[MODULE_PROGRAM]);
	keep_value(module->user, sizeof(module->user), &values[MODULE_USER]);
	module->period_ms = (uint32_t)values[MODULE_PERIOD].integer;
	module->period_given = values[MODULE_PERIOD].given;
	module->priority = (uint16_t)values[MODULE_PRIORITY].integer;
	module->memory_mb = (uint32_t)values[MODULE_MEMORY].integer;
	module->heartbeat_limit_ms = heartbeat_limit_ms(&values[MODULE_HEARTBEAT_LIMIT], module->period_ms);
	module->config = keep_config(own, values[MODULE_CONFIG].given ? values[MODULE_CONFIG].json : NULL);
	check_module_name(loader, place, own, module);
	check_program(loader, place, &values[MODULE_PROGRAM]);
	check_user(loader, place, own, module);
	add_set(loader, place, own, module, values);
	config_add_scanner(loader, module->name, true, module->priority);
}

/* ---- the part ---------------------------------------------------------------------------- */

static bool begin(struct config_loader *loader, void *own_memory, const json_t *root)
{
	struct own *own = own_memory;
	uint32_t points = 0;
	const json_t *module;
	size_t i;

	own->modules = json_object_get(root, file_rule.name);
	json_array_foreach(own->modules, i, module) points +=
	    (uint32_t)json_array_size(json_object_get(module, "points"));
	own->records = config_allocate((uint32_t)json_array_size(own->modules), sizeof(*own->records));
	own->points = config_allocate(points, sizeof(*own->points));
	loader->sets_max += (uint32_t)json_array_size(own->modules);
	loader->points_max += points;
	keep_text(own, ""); /* of what is left out */
	return own->records != NULL && own->points != NULL && !own->no_memory;
}

static void read_part(struct config_loader *loader, void *own_memory, const struct config_value *values)
{
	struct own *own = own_memory;

	(void)loader;
	if (!values->given)
		own->modules = NULL;
}

/* Each room's records belong to the configuration from now on. */
static void add_sections(struct map_config *config, struct own *own, uint32_t count)
{
	map_add_section(config, FOREIGN_MODULES, sizeof(*own->records), count, own->records);
	map_add_section(config, FOREIGN_POINTS, sizeof(*own->points), own->point_count, own->points);
	map_add_section(config, FOREIGN_READS, sizeof(*own->reads), own->read_count, own->reads);
	map_add_section(config, MAP_LISTED, sizeof(*own->listed), own->listed_count, own->listed);
	map_add_section(config, FOREIGN_TEXTS, sizeof(char), (uint32_t)own->texts_size, own->texts);
	own->records = NULL;
	own->points = NULL;
	own->reads = NULL;
	own->listed = NULL;
	own->texts = NULL;
}

static bool finish(struct config_loader *loader, void *own_memory)
{
	const struct config_place file = {.in = NULL};
	const struct config_place array = config_key_of(&file, file_rule.name);
	struct own *own = own_memory;

	own->values = config_allocate((uint32_t)json_array_size(own->modules), sizeof(*own->values));
	if (own->values == NULL)
		return false;
	for (size_t i = 0; i < json_array_size(own->modules); i++) {
		const struct config_place place = config_element_of(&array, i);

		config_read_keys(&loader->report, &place, json_array_get(own->modules, i),
				 foreign_module_rules, MODULE_KEYS, own->values[i]);
		read_module(loader, &place, own, &own->records[i], own->values[i]);
	}
	return !own->no_memory;
}

static bool link_reads(struct config_loader *loader, void *own_memory)
{
	const struct config_place file = {.in = NULL};
	const struct config_place array = config_key_of(&file, file_rule.name);
	struct own *own = own_memory;
	const uint32_t count = (uint32_t)json_array_size(own->modules);

	own->is_named = config_allocate(loader->config->point_count, sizeof(*own->is_named));
	if (own->is_named == NULL)
		return false;
	for (uint32_t i = 0; i < count; i++) {
		const struct config_place place = config_element_of(&array, i);

		read_lists(loader, &place, own, &own->records[i], own->values[i]);
	}
	if (count > 0)
		add_sections(loader->config, own, count);
	return !own->no_memory;
}

static void end(void *own_memory)
{
	struct own *own = own_memory;

	free(own->records);
	free(own->points);
	free(own->reads);
	free(own->listed);
	free(own->texts);
	free(own->is_named);
	free(own->values);
}

const struct config_part foreign_part = {
    .keys = &file_rule,
    .key_count = 1,
    .own_size = sizeof(struct own),
    .begin = begin,
    .read = read_part,
    .finish = finish,
    .link = link_reads,
    .end = end,
};
