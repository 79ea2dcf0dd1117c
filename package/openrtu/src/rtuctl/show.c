/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What is in the map now: points, commands, modules, lines. */
#include "rtuctl/rtuctl.h"

#include <fnmatch.h>
#include <stdio.h>
#include <string.h>

#include <jansson.h>

#include "journal/stats.h"
#include "map/time_ns.h"
#include "modbus/config.h"
#include "modbus/stats.h"
#include "rows/rows.h"
#include "rtuctl/data.h"
#include "rtuctl/identity_list.h"
#include "rtuctl/learned_list.h"
#include "rtuctl/listing.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

bool rtuctl_matches(const struct map_config *config, uint32_t point, const char *pattern)
{
	char name[MAP_NAME_SIZE];

	if (pattern == NULL)
		return true;
	map_point_name(config, &config->points[point], name);
	return fnmatch(pattern, name, 0) == 0;
}

static int end_matching(struct listing *listing, const char *what, const char *pattern)
{
	bool found = listing->rows > 0 || pattern == NULL;

	listing_end_found(listing, found);
	if (found)
		return RTUCTL_DONE;
	fprintf(stderr, "rtuctl: no %s matches \"%s\": \"rtuctl points\" lists them all\n", what, pattern);
	return RTUCTL_FAILED;
}

/* ---- points ------------------------------------------------------------------------------ */

static const struct listing_column point_columns[] = {
    {"name", "NAME", LISTING_TEXT}, {"ca", "CA", LISTING_RIGHT},       {"ioa", "IOA", LISTING_RIGHT},
    {"type", "TYPE", LISTING_TEXT}, {"value", "VALUE", LISTING_RIGHT}, {"quality", "QUALITY", LISTING_TEXT},
    {"age_s", "AGE", LISTING_AGE},  {"owner", "OWNER", LISTING_TEXT},
};

int rtuctl_points(struct map *map, const struct rtuctl_request *request)
{
	const struct map_config *config = map_config(map);
	const char *pattern = request->arguments[0];
	struct listing listing;
	int result;

	listing_begin(&listing, point_columns, COUNT(point_columns), request->json);
	for (uint32_t i = 0; i < config->point_count; i++)
		if (rtuctl_matches(config, i, pattern))
			listing_add(&listing, rows_point(map, i));
	result = end_matching(&listing, "point", pattern);
	if (!request->json)
		rtuctl_print_forces(map, stdout);
	return result;
}

/* ---- commands ---------------------------------------------------------------------------- */

static const struct listing_column command_columns[] = {
    {"name", "NAME", LISTING_TEXT},     {"state", "STATE", LISTING_TEXT},
    {"result", "RESULT", LISTING_TEXT}, {"value", "VALUE", LISTING_RIGHT},
    {"age_s", "AGE", LISTING_AGE},      {"requester", "REQUESTER", LISTING_TEXT},
};

int rtuctl_commands(struct map *map, const struct rtuctl_request *request)
{
	const struct map_config *config = map_config(map);
	const char *pattern = request->arguments[0];
	struct listing listing;

	listing_begin(&listing, command_columns, COUNT(command_columns), request->json);
	for (uint32_t i = 0; i < config->point_count; i++)
		if ((config->points[i].flags & MAP_POINT_COMMAND) && rtuctl_matches(config, i, pattern))
			listing_add(&listing, rows_command(map, i));
	return end_matching(&listing, "command", pattern);
}

/* ---- modules ----------------------------------------------------------------------------- */

static const struct listing_column module_columns[] = {
    {"name", "NAME", LISTING_TEXT},
    {"kind", "KIND", LISTING_TEXT},
    {"state", "STATE", LISTING_TEXT},
    {"alive", "ALIVE", LISTING_TEXT},
    {"pid", "PID", LISTING_RIGHT},
    {"up_s", "UP", LISTING_AGE},
    {"restarts", "RESTARTS", LISTING_RIGHT},
    {"points", "POINTS", LISTING_RIGHT},
    {"lost_events", "LOST EVENTS", LISTING_RIGHT},
};

static void print_journal(const struct map *map)
{
	const struct journal_stats *stats = journal_stats_of(map);
	uint32_t written_s = stats->written_s;

	printf("\njournal: %s%u events not acknowledged; %u records, %u KiB, %u failures",
	       stats->failing ? "FAILS, " : "", stats->events, stats->records, stats->kib, stats->failures);
	if (written_s != 0)
		printf("; the last %lld s ago, the slowest took %u ms",
		       (long long)(map_now_ns() / NS_PER_S - written_s), stats->longest_ms);
	putchar('\n');
}

static bool is_gone(const struct map *map, uint32_t index)
{
	struct map_module module;

	map_module(map, index, &module);
	return (module.flags & MAP_IS_GONE) != 0;
}

int rtuctl_modules(struct map *map, const struct rtuctl_request *request)
{
	char line[DATA_LINE_SIZE];
	struct listing listing;

	if (request->histogram)
		return rtuctl_scan_histogram(map, request);
	listing_begin(&listing, module_columns, COUNT(module_columns), request->json);
	for (uint32_t i = 0; i < map_module_count(map); i++)
		if (!is_gone(map, i))
			listing_add(&listing, rows_module(map, i));
	listing_end(&listing);
	if (!request->json && journal_stats_of(map) != NULL)
		print_journal(map);
	if (!request->json && data_line(request->dir, "/data", line))
		printf("\n%s\n", line);
	return RTUCTL_DONE;
}

/* ---- lines and their devices ------------------------------------------------------------- */

static const struct listing_column line_columns[] = {
    {"port", "PORT", LISTING_RIGHT},
    {"device", "DEVICE", LISTING_TEXT},
    {"format", "FORMAT", LISTING_TEXT},
    {"open", "OPEN", LISTING_TEXT},
    {"scan_ms", "SCAN MS", LISTING_RIGHT},
    {"requests", "REQUESTS", LISTING_RIGHT},
    {"answers", "ANSWERS", LISTING_RIGHT},
    {"commands", "COMMANDS", LISTING_RIGHT},
    {"port_errors", "PORT ERR", LISTING_RIGHT},
};

/* docs/faults.md says of each what it shows. */
static const struct listing_column fault_columns[] = {
    {"port", "PORT", LISTING_RIGHT},
    {"exceptions", "EXCEPT", LISTING_RIGHT},
    {"timeouts", "TIME-OUTS", LISTING_RIGHT},
    {"crc_errors", "CRC", LISTING_RIGHT},
    {"late_answers", "LATE", LISTING_RIGHT},
    {"wrong_units", "UNIT", LISTING_RIGHT},
    {"wrong_functions", "FUNCTION", LISTING_RIGHT},
    {"wrong_lengths", "LENGTH", LISTING_RIGHT},
    {"wrong_answers", "WRONG", LISTING_RIGHT},
    {"unasked_frames", "UNASKED", LISTING_RIGHT},
    {"echoes", "ECHO", LISTING_RIGHT},
    {"noise_bytes", "NOISE", LISTING_RIGHT},
    {"stuck_s", "STUCK S", LISTING_RIGHT},
};

static const struct listing_column device_columns[] = {
    {"port", "PORT", LISTING_RIGHT},
    {"id", "ID", LISTING_RIGHT},
    {"description", "DESCRIPTION", LISTING_TEXT},
    {"ca", "CA", LISTING_RIGHT},
    {"alive", "ALIVE", LISTING_TEXT},
    {"latency_ms", "LATENCY MS", LISTING_RIGHT},
    {"planned_requests", "READS", LISTING_RIGHT},
    {"missed_periods", "MISSED", LISTING_RIGHT},
    {"requests", "REQUESTS", LISTING_RIGHT},
    {"answers", "ANSWERS", LISTING_RIGHT},
    {"exceptions", "EXCEPT", LISTING_RIGHT},
    {"timeouts", "TIME-OUTS", LISTING_RIGHT},
    {"errors", "ERRORS", LISTING_RIGHT},
    {"next_probe_ms", "PROBE MS", LISTING_RIGHT},
};

static void list_lines(const struct map *map, const struct listing_column *columns, size_t count, bool json)
{
	struct listing listing;

	listing_begin(&listing, columns, count, json);
	for (uint32_t i = 0; i < modbus_port_count(map_config(map)); i++)
		listing_add(&listing, rows_line(map, i));
	listing_end(&listing);
}

static void list_devices(const struct map *map)
{
	struct listing listing;

	listing_begin(&listing, device_columns, COUNT(device_columns), false);
	for (uint32_t i = 0; i < modbus_slave_count(map_config(map)); i++)
		listing_add(&listing, rows_device(map, i));
	listing_end(&listing);
}

int rtuctl_lines(struct map *map, const struct rtuctl_request *request)
{
	if (request->histogram)
		return rtuctl_histogram(map, request);
	if (request->suggest)
		return rtuctl_suggest(map, request);
	list_lines(map, line_columns, COUNT(line_columns), request->json);
	if (!request->json) {
		putchar('\n');
		list_lines(map, fault_columns, COUNT(fault_columns), false);
		putchar('\n');
		list_devices(map);
		putchar('\n');
		learned_list(map);
		identity_list(map);
	}
	return RTUCTL_DONE;
}
