/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/config.h"

#include <malloc.h>
#include <stdlib.h>
#include <string.h>

#include "journal/wear.h"
#include "rtud/config_parts.h"
#include "rtud/limit.h"

static uint32_t count_objects(const json_t *slave)
{
	size_t count = 0;

	for (size_t table = 0; table < CONFIG_TABLES; table++)
		count += json_array_size(json_object_get(slave, config_table_names[table]));
	return (uint32_t)count;
}

/* Of a slave, with those of its template. */
static uint64_t count_all_objects(const struct config_loader *loader, const json_t *slave)
{
	const char *name = json_string_value(json_object_get(slave, CONFIG_KEY_TEMPLATE));
	const struct config_template *template = name == NULL ? NULL : config_find_template(loader, name);

	return count_objects(slave) + (uint64_t)(template == NULL ? 0 : count_objects(template->json));
}

/* How many lines, devices and points the file can have at most, with every array as its rule allows it. */
static void count_records(const struct config_loader *loader, const json_t *root, struct map_config *counts)
{
	const json_t *ports = json_object_get(root, CONFIG_KEY_PORTS);
	const json_t *port, *slave;
	uint64_t points = 0;
	size_t i, j;

	if (json_array_size(ports) > CONFIG_PORTS_MAX)
		return;
	json_array_foreach(ports, i, port)
	{
		const json_t *slaves = json_object_get(port, CONFIG_KEY_SLAVES);

		counts->line_count++;
		if (json_array_size(slaves) > CONFIG_UNIT_MAX + 1)
			continue;
		json_array_foreach(slaves, j, slave)
		{
			counts->device_count++;
			points += count_all_objects(loader, slave);
		}
	}
	counts->point_count = points > CONFIG_POINTS_MAX ? CONFIG_POINTS_MAX : (uint32_t)points;
}

/* An array of at least one element, so that NULL means no memory. */
static void *allocate(uint32_t count, size_t size)
{
	return calloc(count > 0 ? count : 1, size);
}

static bool allocate_records(struct config_loader *loader, const json_t *root)
{
	struct map_config counts = {.line_count = 0};

	count_records(loader, root, &counts);
	loader->entries_max = counts.point_count;
	loader->entries = allocate(counts.point_count, sizeof(*loader->entries));
	loader->config->lines = allocate(counts.line_count + 1, sizeof(struct map_line));
	loader->config->devices = allocate(counts.device_count + 1, sizeof(struct map_device));
	loader->config->points =
	    allocate(counts.point_count + CONFIG_OWN_POINTS_MAX, sizeof(struct map_point));
	loader->config->names = allocate(counts.point_count + CONFIG_OWN_POINTS_MAX + 1, MAP_NAME_SIZE);
	return loader->entries != NULL && loader->config->lines != NULL && loader->config->devices != NULL &&
	       loader->config->points != NULL && loader->config->names != NULL;
}

/* In the order in which the map wants them; only a name that was given is kept. */
static void keep_points(struct map_config *config, const struct config_entry *entries)
{
	config->names_size = 1;
	for (uint32_t i = 0; i < config->point_count; i++) {
		config->points[i] = entries[i].point;
		if (entries[i].named)
			config_keep_name(config, &config->points[i], entries[i].name);
	}
}

static enum config_result out_of_memory(struct config_loader *loader)
{
	config_out_of_memory(loader);
	return CONFIG_UNUSABLE;
}

static enum config_result build(struct config_loader *loader, const json_t *root,
				struct config_modules modules)
{
	if (!allocate_records(loader, root))
		return out_of_memory(loader);
	config_read_file(loader, root);
	config_check_collisions(loader);
	config_resolve_status(loader);
	keep_points(loader->config, loader->entries);
	if (loader->report.errors == 0 && !config_check_periods(loader))
		return out_of_memory(loader);
	config_add_own_station(loader);
	if (loader->report.errors > 0)
		return CONFIG_WRONG;
	config_check_modules(loader, root, modules);
	return loader->report.errors == 0 ? CONFIG_GOOD : CONFIG_UNUSABLE;
}

/* Fills loader->config. The loader's files and entries are there until end. */
static enum config_result load(struct config_loader *loader, const char *path, struct config_modules modules)
{
	enum config_result result = CONFIG_UNUSABLE;

	*loader->config = (struct map_config){.line_count = 0};
	if (config_read_files(loader, path))
		result = build(loader, loader->files[0].root, modules);
	config_report_end(&loader->report);
	if (result != CONFIG_GOOD)
		config_free(loader->config);
	return result;
}

/* The file's text and JSON are many small pieces: a process that goes on for years gives the memory back. */
static void end(struct config_loader *loader)
{
	free(loader->entries);
	config_free_files(loader);
	free(loader);
	malloc_trim(0);
}

static struct config_loader *begin(struct map_config *out, FILE *messages)
{
	struct config_loader *loader = calloc(1, sizeof(*loader));

	*out = (struct map_config){.line_count = 0};
	if (loader != NULL) {
		loader->report.messages = messages;
		loader->config = out;
	} else {
		fputs("out of memory\n", messages);
	}
	return loader;
}

enum config_result config_load(const char *path, struct config_modules modules, struct map_config *out,
			       FILE *messages)
{
	struct config_loader *loader = begin(out, messages);
	enum config_result result;

	if (loader == NULL)
		return CONFIG_UNUSABLE;
	result = load(loader, path, modules);
	end(loader);
	return result;
}

int config_points(const char *path, struct config_modules modules, enum config_list list)
{
	struct map_config config;
	struct config_loader *loader = begin(&config, stderr);
	enum config_result result;

	if (loader == NULL)
		return CONFIG_UNUSABLE;
	result = load(loader, path, modules);
	if (result == CONFIG_GOOD && !config_list_points(loader, list, stdout)) {
		fputs("out of memory\n", stderr);
		result = CONFIG_UNUSABLE;
	}
	end(loader);
	config_free(&config);
	return (int)result;
}

void config_free(struct map_config *config)
{
	free(config->lines);
	free(config->devices);
	free(config->points);
	free(config->names);
	free(config->knots);
	*config = (struct map_config){.line_count = 0};
}

static void print_wear(const struct map_journal *journal)
{
	printf(
	    "journal: at most %.1f MiB a day reach the flash, which %u MiB with %u cycles can take for %.0f "
	    "years\n",
	    (double)journal_bytes_a_day(journal) / 1048576, journal->volume_mb, journal->cycles,
	    journal_life_years(journal));
}

int config_check(const char *path, struct config_modules modules, bool requests)
{
	struct map_config config;
	enum config_result result = config_load(path, modules, &config, stderr);

	if (result == CONFIG_GOOD) {
		printf("%s: good: lines %u, devices %u, points %u\n", path, map_modbus_lines(&config),
		       map_slaves(&config), config.point_count);
		if (map_journal_used(&config.settings))
			print_wear(&config.settings.journal);
		if (!limit_print(&config, requests, stdout)) {
			fputs("out of memory\n", stderr);
			result = CONFIG_UNUSABLE;
		}
	}
	config_free(&config);
	return (int)result;
}
