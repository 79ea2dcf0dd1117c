/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A command through the state machine, as any protocol gives it. */
#include "rtuctl/rtuctl.h"

#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include <jansson.h>

#include "map/time_ns.h"
#include "rows/words.h"
#include "rtuctl/listing.h"

#define MARGIN_MS        4000 /* the device's answer may come just before the deadline, its read-back 3 s later */
#define EXPLANATION_SIZE 96
#define LOOK_MS          100 /* how often the owner's life is looked at */

uint32_t rtuctl_find_point(const struct map_config *config, const char *name)
{
	char known[MAP_NAME_SIZE];

	for (uint32_t i = 0; i < config->point_count; i++) {
		map_point_name(config, &config->points[i], known);
		if (strcmp(known, name) == 0)
			return i;
	}
	fprintf(stderr, "rtuctl: there is no point \"%s\": \"rtuctl points\" lists them all\n", name);
	return MAP_NONE;
}

static struct map_answer no_answer(enum map_command_result result)
{
	return (struct map_answer){.state = MAP_REFUSED_COMMAND, .result = (uint8_t)result};
}

/* Whoever waited before this rtuctl left its answers unread: the id tells. */
static bool take_answer(struct map *map, uint32_t id, struct map_answer *out)
{
	map_bell_clear(map);
	while (map_answer_next(map, out))
		if (out->id == id && out->state != MAP_EXECUTING)
			return true;
	return false;
}

static struct map_answer await(struct map *map, const struct map_request *request, uint32_t id)
{
	struct pollfd bell = {.fd = map_bell_fd(map), .events = POLLIN};
	int64_t limit_ns =
	    request->deadline_ns * 2 - request->time_ns + (MARGIN_MS + request->pulse_ms) * NS_PER_MS;
	struct map_answer answer;

	while (map_now_ns() < limit_ns) {
		bool owner_alive = map_alive(map, map_owner(map, request->point));

		if (take_answer(map, id, &answer))
			return answer;
		if (!owner_alive)
			return no_answer(MAP_RESULT_UNKNOWN_FATE);
		poll(&bell, 1, LOOK_MS);
	}
	return no_answer(MAP_RESULT_TIMEOUT);
}

/* Posts one step of the command and waits for its end. */
static struct map_answer step(struct map *map, struct map_request request, enum map_action action)
{
	int64_t patience_ns = map_command_timeout_s(map) * NS_PER_S;
	uint32_t id;

	if (!(map_config(map)->points[request.point].flags &
	      MAP_POINT_COMMAND)) /* its owner may take no requests */
		return no_answer(MAP_RESULT_NOT_COMMANDABLE);
	request.action = (uint8_t)action;
	request.time_ns = map_now_ns();
	request.deadline_ns = request.time_ns + patience_ns;
	id = map_request_post(map, request);
	return id == 0 ? no_answer(MAP_RESULT_NONE) : await(map, &request, id);
}

static struct map_answer run(struct map *map, const struct map_request *request, bool select)
{
	struct map_answer answer;

	if (select) {
		answer = step(map, *request, MAP_SELECT);
		if (answer.state != MAP_ACCEPTED_SELECTION)
			return answer;
	}
	answer = step(map, *request, MAP_EXECUTE);
	if (answer.id != 0)
		map_request_post(map, (struct map_request){.point = request->point,
							   .session = request->session,
							   .action = MAP_RELEASE});
	return answer;
}

/* ---- what came of it --------------------------------------------------------------------- */

/* out: EXPLANATION_SIZE bytes */
static void explain(const struct map_answer *answer, char *out)
{
	if (answer->id == 0 && answer->result == MAP_RESULT_NONE)
		snprintf(out, EXPLANATION_SIZE,
			 "the module that owns the point does not run: see \"rtuctl modules\"");
	else if (answer->result == MAP_RESULT_EXCEPTION)
		snprintf(out, EXPLANATION_SIZE, "the device answered with exception %u", answer->detail);
	else if (answer->result == MAP_RESULT_NOT_SELECTED)
		snprintf(out, EXPLANATION_SIZE, "not selected: the point needs --select");
	else
		snprintf(out, EXPLANATION_SIZE, "%s", map_command_result_name(answer->result));
}

static void print_outcome(const struct map_answer *answer, const char *name, const char *value)
{
	char why[EXPLANATION_SIZE];

	explain(answer, why);
	printf("%s = %s: %s: %s\n", name, value, map_command_state_name(answer->state), why);
}

static json_t *outcome_row(const struct map_answer *answer, const char *name, const char *value)
{
	char why[EXPLANATION_SIZE];
	json_t *row;

	explain(answer, why);
	row = json_pack("{s:s, s:s, s:s, s:s, s:s}", "name", name, "value", value, "state",
			map_command_state_name(answer->state), "result",
			map_command_result_name(answer->result), "text", why);
	if (answer->result == MAP_RESULT_EXCEPTION)
		json_object_set_new(row, "exception", json_integer(answer->detail));
	return row;
}

static bool name_point(const struct map *map, const char *name, struct map_request *request)
{
	request->session = (uint32_t)getpid();
	request->point = rtuctl_find_point(map_config(map), name);
	return request->point != MAP_NONE;
}

static int carry_out(struct map *map, const struct rtuctl_request *arguments,
		     const struct map_request *request)
{
	const char *name = arguments->arguments[0], *value = arguments->arguments[1];
	struct map_answer answer = run(map, request, arguments->select);

	if (arguments->json)
		listing_print_json(outcome_row(&answer, name, value));
	else
		print_outcome(&answer, name, value);
	return answer.result == MAP_RESULT_DONE ? RTUCTL_DONE : RTUCTL_FAILED;
}

/* The duration of a pulse by its name; 0: there is none. */
static uint16_t pulse_ms_of(const struct map_point *point, const char *pulse)
{
	if (strcmp(pulse, "short") == 0)
		return point->short_pulse_ms;
	return strcmp(pulse, "long") == 0 ? point->long_pulse_ms : 0;
}

int rtuctl_set(struct map *map, const struct rtuctl_request *arguments)
{
	const struct map_config *config = map_config(map);
	const char *name = arguments->arguments[0], *value = arguments->arguments[1];
	struct map_request request = {0};
	char expected[WORDS_LONG_SIZE];
	enum map_type type;

	if (!name_point(map, name, &request))
		return RTUCTL_FAILED;
	type = config->points[request.point].type;
	if (!words_parse_point(config, request.point, value, &request.value)) {
		fprintf(stderr, "rtuctl: \"%s\" is not a value of type %s, expected %s\n", value,
			words_type(type), words_expected_of(config, request.point, expected));
		return RTUCTL_USAGE;
	}
	if (arguments->pulse != NULL) {
		request.pulse_ms = pulse_ms_of(&config->points[request.point], arguments->pulse);
		if (request.pulse_ms == 0) {
			fprintf(
			    stderr,
			    "rtuctl: \"%s\" is not a pulse of %s: the configuration gives it short_pulse_ms "
			    "and long_pulse_ms\n",
			    arguments->pulse, name);
			return RTUCTL_USAGE;
		}
	}
	return carry_out(map, arguments, &request);
}

int rtuctl_step(struct map *map, const struct rtuctl_request *arguments)
{
	const char *direction = arguments->arguments[1];
	struct map_request request = {.step = strcmp(direction, "higher") == 0 ? 1 : -1};

	if (request.step < 0 && strcmp(direction, "lower") != 0) {
		fprintf(stderr, "rtuctl: \"%s\" is not a direction, expected higher or lower\n", direction);
		return RTUCTL_USAGE;
	}
	if (!name_point(map, arguments->arguments[0], &request))
		return RTUCTL_FAILED;
	return carry_out(map, arguments, &request);
}
