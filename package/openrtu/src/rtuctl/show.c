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
#include "rtuctl/data.h"
#include "rtuctl/learned.h"
#include "rtuctl/listing.h"
#include "rtuctl/words.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

json_t *rtuctl_point_name(const struct map_config *config, uint32_t point)
{
	char name[MAP_NAME_SIZE];

	map_point_name(config, &config->points[point], name);
	return json_string(name);
}

bool rtuctl_matches(const struct map_config *config, uint32_t point, const char *pattern)
{
	char name[MAP_NAME_SIZE];

	if (pattern == NULL)
		return true;
	map_point_name(config, &config->points[point], name);
	return fnmatch(pattern, name, 0) == 0;
}

/* Seconds since a time of the map; null when there was none. */
static json_t *age_of(int64_t time_ns)
{
	return time_ns == 0 ? json_null() : json_real((double)(map_now_ns() - time_ns) / NS_PER_S);
}

static json_t *module_name(const struct map *map, uint32_t index)
{
	struct map_module module;

	if (index >= map_module_count(map))
		return json_null();
	map_module(map, index, &module);
	return json_string(module.name);
}

static int found(const struct listing *listing, const char *what, const char *pattern)
{
	if (listing->rows > 0 || pattern == NULL)
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

json_t *rtuctl_point_row(const struct map *map, uint32_t index)
{
	const struct map_config *config = map_config(map);
	const struct map_point *point = &config->points[index];
	const struct map_set *set = &config->sets[point->set];
	struct map_sample sample = {.quality = MAP_INVALID};
	json_t *row = json_object();
	char quality[WORDS_SIZE];

	map_read(map, index, &sample);
	words_quality(sample.quality, quality);
	json_object_set_new(row, "name", rtuctl_point_name(config, index));
	json_object_set_new(row, "type", json_string(words_type(point->type)));
	json_object_set_new(row, "value",
			    sample.time_ns != 0 ? words_value(point->type, &sample.value) : json_null());
	if (point->type == MAP_STEP)
		json_object_set_new(row, "transient", json_boolean(sample.detail & 1));
	json_object_set_new(row, "quality", json_string(quality));
	json_object_set_new(row, "age_s", age_of(sample.time_ns));
	json_object_set_new(row, "owner", module_name(map, map_owner(map, index)));
	json_object_set_new(row, "ca", json_integer(set->ca));
	json_object_set_new(row, "ioa", json_integer(point->ioa));
	json_object_set_new(row, "broadcast", json_boolean(set->never_read));
	json_object_set_new(row, "forced", rtuctl_force_row(map, index));
	return row;
}

int rtuctl_points(struct map *map, const struct rtuctl_request *request)
{
	const struct map_config *config = map_config(map);
	const char *pattern = request->arguments[0];
	struct listing listing;

	listing_begin(&listing, point_columns, COUNT(point_columns), request->json);
	for (uint32_t i = 0; i < config->point_count; i++)
		if (rtuctl_matches(config, i, pattern))
			listing_add(&listing, rtuctl_point_row(map, i));
	listing_end(&listing);
	if (!request->json)
		rtuctl_print_forces(map, stdout);
	return found(&listing, "point", pattern);
}

/* ---- commands ---------------------------------------------------------------------------- */

static const struct listing_column command_columns[] = {
    {"name", "NAME", LISTING_TEXT},     {"state", "STATE", LISTING_TEXT},
    {"result", "RESULT", LISTING_TEXT}, {"value", "VALUE", LISTING_RIGHT},
    {"age_s", "AGE", LISTING_AGE},      {"requester", "REQUESTER", LISTING_TEXT},
};

static json_t *command_row(const struct map *map, uint32_t index)
{
	const struct map_point *point = &map_config(map)->points[index];
	struct map_command command = {.state = MAP_INACTIVE};
	bool used = map_command_read(map, index, &command) && command.time_ns != 0;
	json_t *row = json_object();

	json_object_set_new(row, "name", rtuctl_point_name(map_config(map), index));
	json_object_set_new(row, "type", json_string(words_type(point->type)));
	json_object_set_new(row, "state", json_string(map_command_state_name(command.state)));
	json_object_set_new(row, "result", json_string(map_command_result_name(command.result)));
	if (command.result == MAP_RESULT_EXCEPTION)
		json_object_set_new(row, "exception", json_integer(command.detail));
	json_object_set_new(row, "value", used ? words_value(point->type, &command.value) : json_null());
	json_object_set_new(row, "age_s", age_of(command.time_ns));
	json_object_set_new(row, "requester", used ? module_name(map, command.requester) : json_null());
	json_object_set_new(row, "select", json_boolean(point->flags & MAP_POINT_SELECT));
	return row;
}

int rtuctl_commands(struct map *map, const struct rtuctl_request *request)
{
	const struct map_config *config = map_config(map);
	const char *pattern = request->arguments[0];
	struct listing listing;

	listing_begin(&listing, command_columns, COUNT(command_columns), request->json);
	for (uint32_t i = 0; i < config->point_count; i++)
		if ((config->points[i].flags & MAP_POINT_COMMAND) && rtuctl_matches(config, i, pattern))
			listing_add(&listing, command_row(map, i));
	listing_end(&listing);
	return found(&listing, "command", pattern);
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

static json_t *journal_state(const struct map *map)
{
	const struct journal_stats *stats = journal_stats_of(map);
	uint32_t written_s = stats->written_s;
	json_t *state = json_object();

	json_object_set_new(state, "events", json_integer(stats->events));
	json_object_set_new(state, "written_s", age_of(written_s * NS_PER_S));
	json_object_set_new(state, "records", json_integer(stats->records));
	json_object_set_new(state, "kib", json_integer(stats->kib));
	json_object_set_new(state, "longest_ms", json_integer(stats->longest_ms));
	json_object_set_new(state, "left_out", json_integer(stats->left_out));
	json_object_set_new(state, "failures", json_integer(stats->failures));
	json_object_set_new(state, "failing", json_boolean(stats->failing));
	return state;
}

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

static json_t *module_row(const struct map *map, uint32_t index)
{
	struct map_module module;
	json_t *row = json_object();

	map_module(map, index, &module);
	json_object_set_new(row, "name", json_string(module.name));
	json_object_set_new(row, "kind", json_string(module.kind));
	json_object_set_new(row, "state", json_string(words_module_state(module.state)));
	json_object_set_new(row, "alive", json_boolean(module.alive));
	json_object_set_new(row, "pid", module.pid != 0 ? json_integer(module.pid) : json_null());
	json_object_set_new(row, "up_s", module.alive ? age_of(module.started_ns) : json_null());
	json_object_set_new(row, "starts", json_integer(module.generation));
	json_object_set_new(row, "restarts", json_integer(module.restarts));
	json_object_set_new(row, "points", json_integer(module.point_count));
	json_object_set_new(row, "lost_events", json_integer(module.lost_events));
	if (strcmp(module.kind, JOURNAL_KIND) == 0)
		json_object_set_new(row, "journal", journal_state(map));
	return row;
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
			listing_add(&listing, module_row(map, i));
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

/* As engineers write it: 19200 8N2, TCP 502 */
static json_t *line_format(const struct modbus_port *line)
{
	static const char parities[] = {
	    [MODBUS_PARITY_NONE] = 'N', [MODBUS_PARITY_ODD] = 'O', [MODBUS_PARITY_EVEN] = 'E'};

	if (modbus_is_tcp(line))
		return json_sprintf("TCP %u", line->tcp_port);
	return json_sprintf("%u 8%c%u", line->baud, parities[line->parity], line->stop_bits);
}

static json_t *line_devices(const struct map *map, const struct modbus_port *line)
{
	json_t *devices = json_array();

	for (uint32_t i = 0; i < line->device_count; i++)
		json_array_append_new(devices, rtuctl_device_row(map, line->first_device + i));
	return devices;
}

static json_t *line_row(const struct map *map, uint32_t index)
{
	const struct modbus_port *line = &modbus_ports(map_config(map))[index];
	const struct modbus_line_stats *stats = modbus_line_stats(map, index);
	json_t *row = json_object();

	json_object_set_new(row, "port", json_integer(line->port));
	json_object_set_new(row, "device", json_string(line->device));
	json_object_set_new(row, "format", line_format(line));
	json_object_set_new(row, "module", module_name(map, line->module));
	json_object_set_new(row, "open", json_boolean(stats->open));
	json_object_set_new(row, "scan_ms", rtuctl_milliseconds(stats->scan_us));
	json_object_set_new(row, "requests", json_integer(stats->requests));
	json_object_set_new(row, "answers", json_integer(stats->answers));
	json_object_set_new(row, "exceptions", json_integer(stats->exceptions));
	json_object_set_new(row, "timeouts", json_integer(stats->timeouts));
	json_object_set_new(row, "crc_errors", json_integer(stats->crc_errors));
	json_object_set_new(row, "late_answers", json_integer(stats->late_answers));
	json_object_set_new(row, "wrong_units", json_integer(stats->wrong_units));
	json_object_set_new(row, "wrong_functions", json_integer(stats->wrong_functions));
	json_object_set_new(row, "wrong_lengths", json_integer(stats->wrong_lengths));
	json_object_set_new(row, "wrong_answers", json_integer(stats->wrong_answers));
	json_object_set_new(row, "unasked_frames", json_integer(stats->unasked_frames));
	json_object_set_new(row, "echoes", json_integer(stats->echoes));
	json_object_set_new(row, "noise_bytes", json_integer(stats->noise_bytes));
	json_object_set_new(row, "stuck_s", json_integer(stats->stuck_s));
	json_object_set_new(row, "commands", json_integer(stats->commands));
	json_object_set_new(row, "port_errors", json_integer(stats->port_errors));
	json_object_set_new(row, "devices", line_devices(map, line));
	return row;
}

static void list_lines(const struct map *map, const struct listing_column *columns, size_t count, bool json)
{
	struct listing listing;

	listing_begin(&listing, columns, count, json);
	for (uint32_t i = 0; i < modbus_port_count(map_config(map)); i++)
		listing_add(&listing, line_row(map, i));
	listing_end(&listing);
}

static void list_devices(const struct map *map)
{
	struct listing listing;

	listing_begin(&listing, device_columns, COUNT(device_columns), false);
	for (uint32_t i = 0; i < modbus_slave_count(map_config(map)); i++)
		listing_add(&listing, rtuctl_device_row(map, i));
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
	}
	return RTUCTL_DONE;
}
