/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/config.h"

#include <ctype.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "journal/wear.h"
#include "rtud/config_parts.h"
#include "rtud/limit.h"

/* Reads up to CONFIG_FILE_SIZE_MAX + 1 bytes, so that the caller sees a larger file. NULL with errno when it cannot. */
static char *read_bytes(const char *path, size_t *length)
{
	FILE *file = fopen(path, "rbe");
	char *bytes = malloc(CONFIG_FILE_SIZE_MAX + 1);
	int error;

	if (file != NULL && bytes != NULL) {
		*length = fread(bytes, 1, CONFIG_FILE_SIZE_MAX + 1, file);
		if (!ferror(file)) {
			fclose(file);
			return bytes;
		}
	}
	error = errno;
	if (file != NULL)
		fclose(file);
	free(bytes);
	errno = error;
	return NULL;
}

static void report_json_error(struct config_report *report, const char *path, const json_error_t *error)
{
	fprintf(report->messages, "%s:%d:%d: ", path, error->line, error->column);
	for (const char *c = error->text; *c != '\0'; c++)
		fputc(iscntrl((unsigned char)*c) ? '?' : *c, report->messages);
	fputc('\n', report->messages);
}

/* A key that is given twice is an error, but not one that hides all others. */
static json_t *parse(struct config_report *report, const char *path, const char *bytes, size_t length)
{
	json_error_t error;
	json_t *root = json_loadb(bytes, length, JSON_REJECT_DUPLICATES, &error);

	if (root == NULL) {
		report_json_error(report, path, &error);
		report->errors++;
	}
	if (root == NULL && json_error_code(&error) == json_error_duplicate_key)
		root = json_loadb(bytes, length, 0, &error);
	return root;
}

static json_t *read_json(struct config_report *report, const char *path)
{
	size_t length;
	char *bytes = read_bytes(path, &length);
	json_t *root = NULL;

	if (bytes == NULL)
		fprintf(report->messages, "%s: cannot be read: %s\n", path, strerror(errno));
	else if (length > CONFIG_FILE_SIZE_MAX)
		fprintf(report->messages, "%s: is too large, expected at most %u bytes\n", path,
			CONFIG_FILE_SIZE_MAX);
	else
		root = parse(report, path, bytes, length);
	free(bytes);
	return root;
}

static uint32_t count_objects(const json_t *slave)
{
	size_t count = 0;

	for (size_t table = 0; table < CONFIG_TABLES; table++)
		count += json_array_size(json_object_get(slave, config_table_names[table]));
	return (uint32_t)count;
}

/* How many lines, devices and points the file can have at most, with every array as its rule allows it. */
static void count_records(const json_t *root, struct map_config *counts)
{
	const json_t *ports = json_object_get(root, CONFIG_KEY_PORTS);
	const json_t *port, *slave;
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
			counts->point_count += count_objects(slave);
		}
	}
	if (counts->point_count > CONFIG_POINTS_MAX)
		counts->point_count = CONFIG_POINTS_MAX;
}

/* An array of at least one element, so that NULL means no memory. */
static void *allocate(uint32_t count, size_t size)
{
	return calloc(count > 0 ? count : 1, size);
}

static bool allocate_records(struct config_loader *loader, const json_t *root)
{
	struct map_config counts = {.line_count = 0};

	count_records(root, &counts);
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

void config_keep_name(struct map_config *config, struct map_point *point, const char *name)
{
	point->name = config->names_size;
	strcpy(config->names + config->names_size, name);
	config->names_size += (uint32_t)strlen(name) + 1;
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
	fputs("out of memory\n", loader->report.messages);
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

enum config_result config_load(const char *path, struct config_modules modules, struct map_config *out,
			       FILE *messages)
{
	struct config_loader loader = {.report.messages = messages, .config = out};
	enum config_result result = CONFIG_UNUSABLE;
	json_t *root;

	*out = (struct map_config){.line_count = 0};
	root = read_json(&loader.report, path);
	if (root != NULL)
		result = build(&loader, root, modules);
	if (result != CONFIG_GOOD)
		config_free(out);
	free(loader.entries);
	json_decref(root);
	return result;
}

void config_free(struct map_config *config)
{
	free(config->lines);
	free(config->devices);
	free(config->points);
	free(config->names);
	*config = (struct map_config){.line_count = 0};
}

static void print_wear(const struct map_journal *journal)
{
	printf("journal: at most %.1f MiB a day reach the flash, which %u MiB with %u cycles bear for %.0f "
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
