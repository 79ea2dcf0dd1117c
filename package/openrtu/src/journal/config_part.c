/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The object "journal": where it is, how much it writes, and whether the flash bears it. */
#include "journal/config_part.h"

#include <stdlib.h>

#include "journal/config.h"
#include "journal/record.h"
#include "journal/wear.h"

#define PATH_DEFAULT "/data/openrtu/journal"

enum { JOURNAL_PATH, JOURNAL_SIZE, JOURNAL_INTERVAL, JOURNAL_VOLUME, JOURNAL_CYCLES, JOURNAL_KEYS };
static const struct config_rule journal_rules[JOURNAL_KEYS] = {
    [JOURNAL_PATH] =
	{"path", CONFIG_TEXT, .low = 1, .high = MAP_FILE_SIZE - 1,
	 CONFIG_SAYS(
	     "Absolute path of the folder of the journal, which rtud makes and gives to rtu-journal's user.",
	     .otherwise_text = PATH_DEFAULT, .pattern = "^/[^\\u0000-\\u001f\\u007f]*$")},
    [JOURNAL_SIZE] = {"size_kb", CONFIG_INTEGER, .low = 64, .high = 8192, .fallback = 384,
		      CONFIG_SAYS(
			  "KiB of its file, at most. A record has a quarter of it, 36 events a KiB.")},
    [JOURNAL_INTERVAL] =
	{"interval_s", CONFIG_INTEGER, .low = 1, .high = 3600, .fallback = 30,
	 CONFIG_SAYS("Seconds between two records, at least: a power cut may lose the events of this time.")},
    /* The least that the data volume of this family of boards has, and the least that its makers warrant. */
    [JOURNAL_VOLUME] = {"volume_mb", CONFIG_INTEGER, .low = 1, .high = 1048576, .fallback = 47,
			CONFIG_SAYS("MiB of flash over which the file system spreads the writes.")},
    [JOURNAL_CYCLES] = {"cycles", CONFIG_INTEGER, .low = 1000, .high = 10000000, .fallback = 60000,
			CONFIG_SAYS("How often a block of this flash may be erased.")},
};
CONFIG_TABLE(journal_table, .name = "journal", .rules = journal_rules, .count = JOURNAL_KEYS);

static const struct config_rule file_rule = {
    .name = "journal",
    .kind = CONFIG_OBJECT,
    CONFIG_SAYS(
	"Keeps the events that a controlling station has not acknowledged, retained points, and retained "
	"variables of programs, over a power cut. Without it, a power cut deletes all of them.",
	.table = &journal_table)};

static void check_life(struct config_loader *loader, const struct config_place *place,
		       const struct journal_settings *journal)
{
	double years = journal_life_years(journal);

	if (years < JOURNAL_LIFE_YEARS)
		config_error(&loader->report, place,
			     "may wear out %u MiB of flash with %u cycles in %.1f years, expected at least "
			     "%d: a longer "
			     "interval_s, a smaller size_kb, or volume_mb and cycles as they really are",
			     journal->volume_mb, journal->cycles, years, JOURNAL_LIFE_YEARS);
}

static void read_path(struct config_loader *loader, const struct config_place *place,
		      const struct config_value *value, char out[MAP_FILE_SIZE])
{
	const struct config_place here = config_key_of(place, journal_rules[JOURNAL_PATH].name);
	const char *path = value->given ? value->text : PATH_DEFAULT;

	if (path[0] == '/')
		snprintf(out, MAP_FILE_SIZE, "%s", path);
	else if (!value->wrong)
		config_error(&loader->report, &here,
			     "is not an absolute path, expected one like /data/openrtu/journal");
}

static void read_settings(struct config_loader *loader, const struct config_place *place, const json_t *json)
{
	struct journal_settings *journal = calloc(1, sizeof(*journal));
	unsigned errors = loader->report.errors;
	struct config_value values[JOURNAL_KEYS];

	if (journal == NULL) {
		config_out_of_memory(&loader->report);
		return;
	}
	map_add_section(loader->config, JOURNAL_SETTINGS, sizeof(*journal), 1, journal);
	config_read_keys(&loader->report, place, json, journal_rules, JOURNAL_KEYS, values);
	read_path(loader, place, &values[JOURNAL_PATH], journal->path);
	journal->size_kb = (uint32_t)values[JOURNAL_SIZE].integer;
	journal->interval_s = (uint32_t)values[JOURNAL_INTERVAL].integer;
	journal->volume_mb = (uint32_t)values[JOURNAL_VOLUME].integer;
	journal->cycles = (uint32_t)values[JOURNAL_CYCLES].integer;
	if (loader->report.errors == errors)
		check_life(loader, place, journal);
}

static void read_part(struct config_loader *loader, void *own, const struct config_value *values)
{
	const struct config_place file = {.in = NULL};
	const struct config_place place = config_key_of(&file, file_rule.name);

	(void)own;
	if (values->given)
		read_settings(loader, &place, values->json);
}

/* Each record has all retained points and values, and at least a quarter of it is for events. */
static bool check_room(struct config_loader *loader, void *own)
{
	const struct config_place file = {.in = NULL};
	const struct config_place place = config_key_of(&file, file_rule.name);
	const struct journal_settings *journal = journal_settings(loader->config);
	const uint32_t values = map_record_count(loader->config, MAP_RETAINED);
	uint32_t points = 0, modules = loader->config->module_count + MAP_GONE_MAX;

	(void)own;
	if (modules > MAP_MODULES_MAX)
		modules = MAP_MODULES_MAX;
	for (uint32_t i = 0; i < loader->config->point_count; i++)
		points += (loader->config->points[i].flags & MAP_POINT_RETAIN) != 0;
	if (journal != NULL && points + values != 0 &&
	    JOURNAL_QUEUES_OF(modules) + (points + values) * JOURNAL_EVENT_SIZE >
		journal_record_max(journal) / 4 * 3)
		config_error(
		    &loader->report, &place,
		    "has no room for %u retained points and %u retained values of programs in a record "
		    "of size_kb / 4: increase size_kb, or retain fewer",
		    points, values);
	return true;
}

const struct config_part journal_part = {
    .keys = &file_rule, .key_count = 1, .read = read_part, .link = check_room};
