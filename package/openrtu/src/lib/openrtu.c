/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A module's beginning and end, its points by name, its log. */
#include "lib/openrtu.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <unistd.h>

#include "lib/handle.h"
#include "map/type.h"
#include "process/module.h"

#define OWN_PREFIX "rtu" /* of the names of the gateway's own modules */

static char error[MAP_ERROR_SIZE + MAP_FILE_SIZE];

__attribute__((format(printf, 1, 2))) static void fail(const char *format, ...)
{
	va_list arguments;

	va_start(arguments, format);
	vsnprintf(error, sizeof(error), format, arguments);
	va_end(arguments);
}

const char *openrtu_error(void)
{
	return error;
}

const char *openrtu_version(void)
{
	return OPENRTU_VERSION;
}

/* ---- begin and end ----------------------------------------------------------------------- */

/* The word behind an option, wherever it is: the rest of the line is the program's own. */
static const char *argument(int argc, char *const *argv, const char *option)
{
	for (int i = 1; i + 1 < argc; i++)
		if (strcmp(argv[i], option) == 0)
			return argv[i + 1];
	return NULL;
}

static struct map *attach(const char *dir, const char *name)
{
	char reason[MAP_ERROR_SIZE];
	struct map *map;

	if (dir == NULL || name == NULL) {
		fail("a module is started by rtud: --map DIR and --module NAME are missing");
		return NULL;
	}
	if (strncmp(name, OWN_PREFIX, strlen(OWN_PREFIX)) == 0) {
		fail("%s is a module of the gateway itself", name);
		return NULL;
	}
	if (map_attach(&map, dir, name, reason) < 0) {
		fail("%s: %s", dir, reason);
		return NULL;
	}
	return map;
}

static bool allocate(struct openrtu *rtu)
{
	const uint32_t most = rtu->input_count + rtu->own_count + rtu->command_count;

	rtu->points = calloc(most + 1, sizeof(*rtu->points));
	rtu->types = calloc(most + 1, sizeof(*rtu->types));
	rtu->samples = calloc(most + 1, sizeof(*rtu->samples));
	rtu->names = calloc(most + 1, sizeof(*rtu->names));
	rtu->command_of = calloc(most + 1, sizeof(*rtu->command_of));
	rtu->fresh = calloc(rtu->input_count + 1, sizeof(*rtu->fresh));
	rtu->sets = calloc(rtu->input_count + 1, sizeof(*rtu->sets));
	rtu->outputs = calloc(rtu->own_count + 1, sizeof(*rtu->outputs));
	rtu->updates = calloc(rtu->own_count + 1, sizeof(*rtu->updates));
	rtu->asked = calloc(rtu->own_count + 1, sizeof(*rtu->asked));
	rtu->commands = calloc(rtu->command_count + 1, sizeof(*rtu->commands));
	return rtu->points && rtu->types && rtu->samples && rtu->names && rtu->command_of && rtu->fresh &&
	       rtu->sets && rtu->outputs && rtu->updates && rtu->asked && rtu->commands;
}

static void add_point(struct openrtu *rtu, uint32_t map_point)
{
	const struct map_config *config = map_config(rtu->map);
	const uint32_t number = rtu->point_count++;

	rtu->points[number] = map_point;
	rtu->types[number] = config->points[map_point].type;
	rtu->command_of[number] = MAP_NONE;
	map_point_name(config, &config->points[map_point], rtu->names[number]);
	rtu->samples[number].quality = MAP_INVALID;
	if (map_owner(rtu->map, map_point) == map_self(rtu->map))
		rtu->samples[number] = map_own_sample(rtu->map, map_point);
	else
		map_read(rtu->map, map_point, &rtu->samples[number]);
}

/* A point that it reads and commands has one number. */
static void add_command(struct openrtu *rtu, uint32_t command, uint32_t map_point)
{
	uint32_t number = 0;

	while (number < rtu->point_count && rtu->points[number] != map_point)
		number++;
	if (number == rtu->point_count)
		add_point(rtu, map_point);
	rtu->command_of[number] = command;
}

/* Inputs are in the order of the map, so that those of a set are neighbours. */
static void find_sets(struct openrtu *rtu)
{
	const struct map_point *points = map_config(rtu->map)->points;

	for (uint32_t i = 0; i < rtu->input_count; i++) {
		if (i == 0 || points[rtu->points[i]].set != points[rtu->points[i - 1]].set)
			rtu->sets[rtu->set_count++].first = i;
		rtu->sets[rtu->set_count - 1].end = i + 1;
	}
}

static void find_points(struct openrtu *rtu)
{
	const struct map_config *config = map_config(rtu->map);
	const uint32_t *reads = map_records(config, FOREIGN_READS, sizeof(uint32_t));
	const uint32_t *listed = map_records(config, MAP_LISTED, sizeof(uint32_t));

	for (uint32_t i = 0; i < rtu->input_count; i++)
		add_point(rtu, reads[rtu->module->first_read + i]);
	for (uint32_t i = 0; i < rtu->own_count; i++)
		add_point(rtu, config->sets[rtu->module->set].first_point + i);
	for (uint32_t i = 0; i < rtu->command_count; i++)
		add_command(rtu, i, listed[rtu->module->first_command + i]);
	find_sets(rtu);
}

static bool prepare(struct openrtu *rtu, const char *name)
{
	const struct map_config *config = map_config(rtu->map);

	rtu->stop_fd = -1;
	rtu->module = foreign_find(config, name);
	rtu->scans = map_section(rtu->map, map_self(rtu->map), sizeof(*rtu->scans));
	if (rtu->module == NULL || rtu->scans == NULL) {
		fail("the map's \"modules\" are of another version: restart rtud, and build with its "
		     "libopenrtu");
		return false;
	}
	rtu->input_count = rtu->module->read_count;
	rtu->command_count = rtu->module->command_count;
	if (rtu->module->set != FOREIGN_NO_SET)
		rtu->own_count = config->sets[rtu->module->set].point_count;
	rtu->stop_fd = module_stop_fd();
	if (rtu->stop_fd < 0 || !allocate(rtu)) {
		fail("cannot begin: %s", strerror(errno));
		return false;
	}
	map_name_counter(rtu->map, &rtu->scans->count, "scans");
	map_name_counter(rtu->map, &rtu->scans->missed, "missed periods");
	find_points(rtu);
	requests_begin(rtu);
	events_begin(rtu);
	scan_publish_initial(rtu);
	synched_begin(&rtu->synched, rtu->map, name);
	prctl(PR_SET_NAME, name); /* or all scripts would be called as their interpreter */
	return true;
}

struct openrtu *openrtu_attach(int argc, char *const *argv)
{
	const char *name = argument(argc, argv, "--module");
	struct map *map = attach(argument(argc, argv, "--map"), name);
	struct openrtu *rtu;

	if (map == NULL)
		return NULL;
	rtu = calloc(1, sizeof(*rtu));
	if (rtu == NULL) {
		map_detach(map);
		fail("out of memory");
		return NULL;
	}
	rtu->map = map;
	if (prepare(rtu, name))
		return rtu;
	openrtu_detach(rtu);
	return NULL;
}

void openrtu_detach(struct openrtu *rtu)
{
	if (rtu == NULL)
		return;
	map_detach(rtu->map);
	if (rtu->stop_fd >= 0)
		close(rtu->stop_fd);
	free(rtu->points);
	free(rtu->types);
	free(rtu->samples);
	free(rtu->names);
	free(rtu->fresh);
	free(rtu->sets);
	free(rtu->outputs);
	free(rtu->updates);
	free(rtu->asked);
	free(rtu->commands);
	free(rtu->command_of);
	free(rtu);
}

const char *openrtu_name(const struct openrtu *rtu)
{
	return rtu->module->name;
}

const char *openrtu_config(const struct openrtu *rtu)
{
	return foreign_text(map_config(rtu->map), rtu->module->config);
}

uint32_t openrtu_period_ms(const struct openrtu *rtu)
{
	return rtu->module->period_ms;
}

/* ---- points ------------------------------------------------------------------------------ */

int openrtu_point_count(const struct openrtu *rtu)
{
	return (int)rtu->point_count;
}

int openrtu_point(const struct openrtu *rtu, const char *name)
{
	for (int i = 0; i < openrtu_point_count(rtu); i++)
		if (strcmp(rtu->names[i], name) == 0)
			return i;
	return -ENOENT;
}

bool openrtu_point_is_own(const struct openrtu *rtu, int point)
{
	return is_own(rtu, point);
}

const char *openrtu_point_name(const struct openrtu *rtu, int point)
{
	return is_point(rtu, point) ? rtu->names[point] : NULL;
}

const char *openrtu_point_type(const struct openrtu *rtu, int point)
{
	return is_point(rtu, point) ? map_types[type_of(rtu, point)].name : NULL;
}

const char *openrtu_point_unit(const struct openrtu *rtu, int point)
{
	const struct map_config *config = map_config(rtu->map);

	return is_point(rtu, point) ? map_unit_of(config, &config->points[rtu->points[point]]) : NULL;
}

const char *openrtu_point_description(const struct openrtu *rtu, int point)
{
	const struct map_config *config = map_config(rtu->map);
	const struct foreign_point *found;

	if (!is_point(rtu, point))
		return NULL;
	found = foreign_point_of(config, rtu->points[point]);
	return found != NULL ? foreign_text(config, found->description) : "";
}

/* ---- log and time ------------------------------------------------------------------------ */

void openrtu_log(struct openrtu *rtu, enum openrtu_log_level level, const char *text)
{
	map_log(rtu->map, level > OPENRTU_DEBUG ? MAP_LOG_DEBUG : (enum map_log_level)level, "%s", text);
}

int64_t openrtu_wall_ns(const struct openrtu *rtu, int64_t time_ns)
{
	return map_wall_ns(map_clock_read(rtu->map), time_ns);
}
