/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/config.h"

#include <stdlib.h>

#include "journal/config.h"
#include "journal/wear.h"
#include "map/hash.h"
#include "map/heap.h"
#include "modbus/config.h"
#include "modbus/limit.h"
#include "rtud/config_parts.h"
#include "synch/check.h"

static enum config_result out_of_memory(struct rtud_loader *loader)
{
	config_out_of_memory(&loader->files.report);
	return CONFIG_UNUSABLE;
}

static enum config_result build(struct rtud_loader *loader, const json_t *root, struct config_modules modules)
{
	const struct config_report *report = &loader->files.report;

	if (!config_begin_file(loader, root) || !config_read_file(loader, root))
		return out_of_memory(loader);
	if (report->errors > 0)
		return CONFIG_WRONG;
	config_check_modules(&loader->files, root, modules);
	return report->errors == 0 ? CONFIG_GOOD : CONFIG_UNUSABLE;
}

/* Fills the loader's config. Its files and entries are there until end. */
static enum config_result load(struct rtud_loader *loader, const char *path, const char *instead,
			       struct config_modules modules)
{
	struct config_loader *files = &loader->files;
	enum config_result result = CONFIG_UNUSABLE;

	*files->config = (struct map_config){.set_count = 0};
	if (config_read_files(files, path, instead)) {
		const struct config_source *source = &files->report.source;

		files->config->text = map_hash_octets(MAP_HASH_BASIS, source->text, source->length);
		result = build(loader, files->files[0].root, modules);
	}
	config_report_end(&files->report);
	if (result != CONFIG_GOOD)
		config_free(files->config);
	return result;
}

/* The file's text and JSON are many small pieces: a process that goes on for years gives the memory back. */
static void end(struct rtud_loader *loader)
{
	config_end_file(loader);
	config_free_files(&loader->files);
	free(loader);
	malloc_trim(0);
}

static struct rtud_loader *begin(struct map_config *out, FILE *messages)
{
	struct rtud_loader *loader = calloc(1, sizeof(*loader));

	*out = (struct map_config){.set_count = 0};
	if (loader != NULL) {
		loader->files.report.messages = messages;
		loader->files.config = out;
	} else {
		fputs("out of memory\n", messages);
	}
	return loader;
}

enum config_result config_load(const char *path, const char *instead, struct config_modules modules,
			       struct map_config *out, FILE *messages)
{
	struct rtud_loader *loader = begin(out, messages);
	enum config_result result;

	if (loader == NULL)
		return CONFIG_UNUSABLE;
	result = load(loader, path, instead, modules);
	end(loader);
	return result;
}

int config_points(const char *path, struct config_modules modules, enum config_list list)
{
	struct map_config config;
	struct rtud_loader *loader = begin(&config, stderr);
	enum config_result result;

	if (loader == NULL)
		return CONFIG_UNUSABLE;
	result = load(loader, path, NULL, modules);
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
	for (uint32_t i = 0; i < config->section_count; i++)
		free(config->sections[i].records);
	free(config->sets);
	free(config->points);
	free(config->names);
	free(config->modules);
	*config = (struct map_config){.set_count = 0};
}

static void print_wear(const struct journal_settings *journal)
{
	printf(
	    "journal: at most %.1f MiB a day reach the flash, which %u MiB with %u cycles can take for %.0f "
	    "years\n",
	    (double)journal_bytes_a_day(journal) / 1048576, journal->volume_mb, journal->cycles,
	    journal_life_years(journal));
}

int config_print(const char *path, const struct map_config *config, bool requests)
{
	printf("%s: good: lines %u, devices %u, points %u\n", path, modbus_port_count(config),
	       modbus_slave_count(config), config->point_count);
	if (journal_settings(config) != NULL)
		print_wear(journal_settings(config));
	if (modbus_limit_print(config, requests, stdout) && synch_print(config, stdout))
		return CONFIG_GOOD;
	fputs("out of memory\n", stderr);
	return CONFIG_UNUSABLE;
}
