/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Letting a point show a value of ours instead of its owner's, and ending that. */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "map/time_ns.h"
#include "rows/rows.h"
#include "rows/words.h"
#include "rtuctl/ask.h"
#include "rtuctl/listing.h"
#include "rtuctl/rtuctl.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

#define ANSWER_MS  2000
#define OUTCOME_MS 2000 /* an owner looks at each of its heartbeats */
#define LOOK_MS    10
#define USUAL_S    600 /* without --for */

/* ---- asking ------------------------------------------------------------------------------ */

/* 90s, 10m, 2h; false: it is none of these. */
static bool parse_duration(const char *text, int64_t *out_s)
{
	static const struct {
		const char *name;
		int64_t s;
	} units[] = {{"s", 1}, {"m", 60}, {"h", 3600}};
	char *end;
	const unsigned long number = strtoul(text, &end, 10);

	for (size_t i = 0; i < COUNT(units); i++)
		if (isdigit((unsigned char)text[0]) && strcmp(end, units[i].name) == 0 && number > 0 &&
		    number <= 1000000) {
			*out_s = (int64_t)number * units[i].s;
			return true;
		}
	fprintf(stderr, "rtuctl: \"%s\" is no time, expected one like 90s, 10m or 2h\n", text);
	return false;
}

static int find_duration(const struct map_config *config, const char *text, int64_t *out_s)
{
	const int64_t max_s = config->settings.force_max_s;

	if (text == NULL) {
		*out_s = max_s < USUAL_S ? max_s : USUAL_S;
		return RTUCTL_DONE;
	}
	if (!parse_duration(text, out_s))
		return RTUCTL_USAGE;
	if (*out_s <= max_s)
		return RTUCTL_DONE;
	fprintf(stderr, "rtuctl: %s is longer than the configuration allows: force_max_s is %lld s\n", text,
		(long long)max_s);
	return RTUCTL_FAILED;
}

static bool find_forceable(const struct map *map, const char *name, uint32_t *point)
{
	const struct map_config *config = map_config(map);
	const char *why;

	if (config->settings.force_max_s == 0) {
		fputs("rtuctl: the configuration allows no forcing: its key force_max_s says for how long "
		      "at most\n",
		      stderr);
		return false;
	}
	*point = rtuctl_find_point(config, name);
	if (*point == MAP_NONE)
		return false;
	why = map_unforceable(config, *point);
	if (why != NULL)
		fprintf(stderr, "rtuctl: %s cannot be forced: it %s\n", name, why);
	return why == NULL;
}

static bool ask(struct map *map, const struct map_request *request, const char *name)
{
	struct map_answer answer;

	if (!rtuctl_ask(map, *request, ANSWER_MS, &answer))
		fputs("rtuctl: rtud does not answer: see its log\n", stderr);
	else if (answer.result == MAP_RESULT_DONE)
		return true;
	else if (answer.result == MAP_RESULT_NOT_SELECTED)
		fprintf(stderr, "rtuctl: %s is not forced: \"rtuctl forces\" lists what is\n", name);
	else if (answer.result == MAP_RESULT_OUT_OF_RANGE)
		fprintf(stderr, "rtuctl: %d points are forced already: unforce one first\n", MAP_FORCES_MAX);
	else
		fputs("rtuctl: rtud refuses it: its configuration was changed meanwhile\n", stderr);
	return false;
}

/* The owner has seen it. */
static bool has_come_true(const struct map *map, uint32_t point, const union map_value *value)
{
	struct map_sample sample, below;
	const bool covered = map_read_below(map, point, &below);

	if (value == NULL)
		return !covered;
	return covered && map_read(map, point, &sample) && sample.value.u == value->u &&
	       (sample.quality & MAP_SUBSTITUTED);
}

static bool await(const struct map *map, uint32_t point, const union map_value *value)
{
	const struct timespec look = {.tv_nsec = LOOK_MS * NS_PER_MS};
	const int64_t limit_ns = map_now_ns() + OUTCOME_MS * NS_PER_MS;

	while (map_now_ns() < limit_ns) {
		if (has_come_true(map, point, value))
			return true;
		nanosleep(&look, NULL);
	}
	return false;
}

static int finish(const struct map *map, const struct map_request *request, const union map_value *value,
		  bool json)
{
	struct map_module owner;

	if (!await(map, request->point, value)) {
		map_module(map, map_owner(map, request->point), &owner);
		fprintf(stderr, "rtuctl: it comes true when %s runs: see \"rtuctl modules\"\n", owner.name);
	}
	if (json)
		listing_print_json(rows_point(map, request->point));
	else
		rtuctl_print_forces(map, stdout);
	return RTUCTL_DONE;
}

int rtuctl_force(struct map *map, const struct rtuctl_request *arguments)
{
	const struct map_config *config = map_config(map);
	const char *name = arguments->arguments[0], *value = arguments->arguments[1];
	struct map_request request = {.action = MAP_FORCE, .session = map_epoch(map)};
	char expected[WORDS_LONG_SIZE];
	enum map_type type;
	int64_t hold_s = 0;
	int result;

	if (!find_forceable(map, name, &request.point))
		return RTUCTL_FAILED;
	type = config->points[request.point].type;
	if (!words_parse_point(config, request.point, value, &request.value)) {
		fprintf(stderr, "rtuctl: \"%s\" is not a value of type %s, expected %s\n", value,
			words_type(type), words_expected_of(config, request.point, expected));
		return RTUCTL_USAGE;
	}
	result = find_duration(config, arguments->duration, &hold_s);
	if (result != RTUCTL_DONE)
		return result;
	request.hold_ms = hold_s * MS_PER_S;
	if (!ask(map, &request, name))
		return RTUCTL_FAILED;
	return finish(map, &request, &request.value, arguments->json);
}

int rtuctl_unforce(struct map *map, const struct rtuctl_request *arguments)
{
	const char *name = arguments->arguments[0];
	struct map_request request = {.action = MAP_FORCE, .session = map_epoch(map)};

	if (!find_forceable(map, name, &request.point) || !ask(map, &request, name))
		return RTUCTL_FAILED;
	return finish(map, &request, NULL, arguments->json);
}
