/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The array "logic": each element is a program with its points, and a module that runs it. */
#include "logic/config_part.h"

#include <stdlib.h>
#include <string.h>

#include "config/names.h"
#include "config/scanners.h"
#include "logic/config_readers.h"

enum {
	LOGIC_NAME,
	LOGIC_PROGRAM,
	LOGIC_PERIOD,
	LOGIC_BUDGET_KEY,
	LOGIC_CA,
	LOGIC_POINTS,
	LOGIC_NAMES,
	LOGIC_KEYS
};
static const struct config_rule rules[LOGIC_KEYS] = {
    [LOGIC_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1, .high = LOGIC_NAME_SIZE - 1,
		    CONFIG_SAYS("Name of the instance, of a-z, 0-9, - and _; its module is rtu-logic-NAME.",
				.pattern = "^[a-z0-9_-]*$")},
    [LOGIC_PROGRAM] = {"program", CONFIG_TEXT, .required = true, .low = 1, .high = 255,
		       CONFIG_SAYS("File that openrtu logic compile has written, by its name relative to the "
				   "folder of the configuration.")},
    [LOGIC_PERIOD] = {"period_ms", CONFIG_INTEGER, .low = 10, .high = 3600000, .fallback = 100,
		      CONFIG_SAYS("Milliseconds from scan to scan.")},
    [LOGIC_BUDGET_KEY] = {"budget", CONFIG_INTEGER, .low = 1000, .high = 1000000,
			  .fallback = LOGIC_BUDGET_DEFAULT,
			  CONFIG_SAYS(
			      "Instructions of a scan, at most: more end it, and its results are invalid.")},
    [LOGIC_CA] = {"ca", CONFIG_INTEGER, .required = true, .low = 1, .high = 65534,
		  CONFIG_SAYS("Common address of the program's own points; no device has it.")},
    [LOGIC_POINTS] = {"points", CONFIG_ARRAY, .required = true, .high = 1000,
		      CONFIG_SAYS("The points that are the program's own: what it writes, and what "
				  "controlling stations command at it.",
				  .table = &logic_point_table)},
    [LOGIC_NAMES] =
	{"names", CONFIG_OBJECT,
	 CONFIG_SAYS("Points of others that the program calls by another name: its name, and the point's.",
		     .json = CONFIG_JSON({"additionalProperties" : {"type" : "string"}}))},
};
CONFIG_TABLE(program_table, .name = "program", .rules = rules, .count = LOGIC_KEYS);

static const struct config_rule file_rule = {
    LOGIC_KEY, CONFIG_ARRAY, .high = LOGIC_INSTANCES_MAX,
    CONFIG_SAYS("Programs of Structured Text that the gateway runs.", .table = &program_table)};

static bool begin(struct config_loader *loader, void *own, const json_t *root)
{
	const json_t *array = json_object_get(root, LOGIC_KEY);
	const json_t *instance;
	struct logic_instance *instances = config_allocate(LOGIC_INSTANCES_MAX, sizeof(*instances));
	size_t i;

	(void)own;
	if (json_array_size(array) > LOGIC_INSTANCES_MAX)
		array = NULL;
	json_array_foreach(array, i, instance)
	{
		loader->sets_max++;
		loader->points_max += (uint32_t)json_array_size(json_object_get(instance, "points"));
	}
	map_add_section(loader->config, LOGIC_INSTANCES, sizeof(*instances), 0, instances);
	return instances != NULL;
}

/* Its module's name is made of it. */
static void read_name(struct config_loader *loader, struct logic_reading *reading, const char *name)
{
	const struct map_config *config = loader->config;
	struct logic_place place;
	const struct config_place *here = logic_place_key(&place, reading, CONFIG_KEY_NAME);

	if (name[strspn(name, "abcdefghijklmnopqrstuvwxyz0123456789-_")] != '\0')
		config_error(
		    &loader->report, here,
		    "\"%s\" has other signs than a-z, 0-9, - and _, of which a module's name is made", name);
	for (const struct logic_instance *other = logic_instances(config); other < reading->instance; other++)
		if (strcmp(other->name, name) == 0)
			config_error(&loader->report, here, "\"%s\" is the name of another program", name);
	snprintf(reading->instance->name, LOGIC_NAME_SIZE, "%s", name);
}

/* Each name that is given is one of the program's, and its point a text. */
static void check_given_names(struct config_loader *loader, const struct logic_reading *reading)
{
	struct logic_place place;
	const struct config_place *names = logic_place_key(&place, reading, rules[LOGIC_NAMES].name);
	const char *name;
	json_t *point;

	json_object_foreach((json_t *)(uintptr_t)reading->names, name, point)
	{
		const struct config_place here = config_key_of(names, name);

		if (logic_find_point(&reading->logic, name) == NULL)
			config_error(&loader->report, &here, "is no point of the program");
		else if (!json_is_string(point))
			config_error(&loader->report, &here, "expected the name of a point");
	}
}

static void read_instance(struct config_loader *loader, struct logic_readings *readings, size_t element,
			  const json_t *json)
{
	struct logic_reading *reading = &readings->readings[readings->count++];
	struct config_value values[LOGIC_KEYS];
	struct logic_place place;

	reading->element = element;
	reading->instance = map_next_record(loader->config, LOGIC_INSTANCES);
	logic_place_key(&place, reading, "");
	config_read_keys(&loader->report, &place.instance, json, rules, LOGIC_KEYS, values);
	reading->ca = (uint16_t)values[LOGIC_CA].integer;
	reading->instance->period_ms = (uint32_t)values[LOGIC_PERIOD].integer;
	reading->instance->period_given = values[LOGIC_PERIOD].given;
	reading->instance->budget = (uint32_t)values[LOGIC_BUDGET_KEY].integer;
	if (values[LOGIC_NAME].given)
		read_name(loader, reading, values[LOGIC_NAME].text);
	config_add_scanner(loader, reading->instance->name, true, 0);
	if (!values[LOGIC_PROGRAM].given || !logic_read_program(loader, reading, values[LOGIC_PROGRAM].text))
		return;
	if (values[LOGIC_NAMES].given) {
		reading->names = values[LOGIC_NAMES].json;
		check_given_names(loader, reading);
	}
	if (values[LOGIC_POINTS].given)
		logic_read_points(loader, reading, values[LOGIC_POINTS].json);
}

static void read_part(struct config_loader *loader, void *own, const struct config_value *values)
{
	const json_t *instance;
	size_t i;

	if (!values->given)
		return;
	json_array_foreach(values->json, i, instance)
	{
		read_instance(loader, own, i, instance);
	}
}

/* One behind the other, each at a multiple of 4, as its sections are. False: no memory. */
static bool keep_programs(struct map_config *config, struct logic_readings *readings)
{
	uint32_t size = 0;
	uint8_t *programs;

	for (uint32_t i = 0; i < readings->count; i++)
		size += (readings->readings[i].instance->size + 3) / 4 * 4;
	programs = config_allocate(size, 1);
	map_add_section(config, LOGIC_PROGRAMS, 1, size, programs);
	size = 0;
	for (uint32_t i = 0; programs != NULL && i < readings->count; i++) {
		struct logic_instance *instance = readings->readings[i].instance;

		instance->program = size;
		memcpy(programs + size, readings->readings[i].file, instance->size);
		size += (instance->size + 3) / 4 * 4;
	}
	return programs != NULL;
}

static bool finish(struct config_loader *loader, void *own)
{
	struct logic_readings *readings = own;

	for (uint32_t i = 0; loader->report.errors == 0 && i < readings->count; i++)
		logic_add_set(loader, &readings->readings[i]);
	return loader->report.errors > 0 || logic_name_retained(loader, readings);
}

static bool link_programs(struct config_loader *loader, void *own)
{
	struct logic_readings *readings = own;

	if (loader->report.errors > 0 || readings->count == 0)
		return true;
	return logic_link(loader, readings) && keep_programs(loader->config, readings);
}

static void end(void *own)
{
	struct logic_readings *readings = own;

	for (uint32_t i = 0; i < readings->count; i++) {
		free(readings->readings[i].file);
		free(readings->readings[i].memory);
		free(readings->readings[i].points);
	}
}

const struct config_part logic_part = {
    .keys = &file_rule,
    .key_count = 1,
    .own_size = sizeof(struct logic_readings),
    .begin = begin,
    .read = read_part,
    .finish = finish,
    .link = link_programs,
    .end = end,
};
