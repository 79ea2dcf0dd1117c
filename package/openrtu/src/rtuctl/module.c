/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Stopping and starting a module's process. */
#include <poll.h>
#include <stdio.h>
#include <string.h>

#include "map/time_ns.h"
#include "rows/words.h"
#include "rtuctl/ask.h"
#include "rtuctl/rtuctl.h"

#define ANSWER_MS  2000
#define OUTCOME_MS 15000 /* rtud kills what does not end after 3 s, or does not start within 10 s */
#define LOOK_MS    20

static const char *const wishes[] = {
    [MAP_WISH_STOP] = "stop", [MAP_WISH_START] = "start", [MAP_WISH_RESTART] = "restart"};

#define WISHES (sizeof(wishes) / sizeof(wishes[0]))

static bool find_wish(const char *name, uint8_t *wish)
{
	for (*wish = 0; *wish < WISHES; ++*wish)
		if (strcmp(wishes[*wish], name) == 0)
			return true;
	fprintf(stderr, "rtuctl: \"%s\" is nothing to do with a module, expected stop, start or restart\n",
		name);
	return false;
}

static bool find_module(const struct map *map, const char *name, uint32_t *number)
{
	struct map_module module;

	for (*number = 0; *number < map_module_count(map); ++*number) {
		map_module(map, *number, &module);
		if (strcmp(module.name, name) == 0 && !(module.flags & MAP_IS_GONE))
			return true;
	}
	fprintf(stderr, "rtuctl: there is no module \"%s\": \"rtuctl modules\" lists them all\n", name);
	return false;
}

/* before: the generation that ran when it was asked. */
static bool has_come_true(const struct map *map, const struct map_request *request, uint32_t before)
{
	struct map_module module;

	map_module(map, request->point, &module);
	switch ((enum map_wish)request->detail) {
	case MAP_WISH_STOP:
		return module.state == MAP_MODULE_STOPPED;
	case MAP_WISH_START:
		return module.state == MAP_MODULE_RUNNING && module.alive;
	case MAP_WISH_RESTART:
		return module.state == MAP_MODULE_RUNNING && module.alive && module.generation != before;
	}
	return false;
}

static bool await_outcome(const struct map *map, const struct map_request *request, uint32_t before)
{
	const int64_t limit_ns = map_now_ns() + OUTCOME_MS * NS_PER_MS;

	while (!has_come_true(map, request, before)) {
		if (map_now_ns() > limit_ns || !map_alive(map, MAP_RTUD))
			return false;
		poll(NULL, 0, LOOK_MS);
	}
	return true;
}

static void print_outcome(const char *name, const char *state, bool as_json)
{
	json_t *row;

	if (!as_json) {
		printf("%s: %s\n", name, state);
		return;
	}
	row = json_pack("{s:s, s:s}", "name", name, "state", state);
	json_dumpf(row, stdout, JSON_COMPACT);
	putchar('\n');
	json_decref(row);
}

int rtuctl_module(struct map *map, const struct rtuctl_request *arguments)
{
	const char *name = arguments->arguments[0];
	struct map_request request = {.action = MAP_MODULE};
	struct map_module before, after;
	struct map_answer answer;
	bool done;

	if (!find_wish(arguments->arguments[1], &request.detail))
		return RTUCTL_USAGE;
	if (!find_module(map, name, &request.point))
		return RTUCTL_FAILED;
	map_module(map, request.point, &before);
	if (!rtuctl_ask(map, request, ANSWER_MS, &answer)) {
		fputs("rtuctl: rtud does not answer: see its log\n", stderr);
		return RTUCTL_FAILED;
	}
	if (answer.result != MAP_RESULT_DONE) {
		fprintf(stderr, "rtuctl: rtud starts no process for %s\n", name);
		return RTUCTL_FAILED;
	}
	done = await_outcome(map, &request, before.generation);
	map_module(map, request.point, &after);
	print_outcome(name, words_module_state(after.state), arguments->json);
	if (!done)
		fprintf(stderr, "rtuctl: %s did not %s: see \"rtuctl log\"\n", name, wishes[request.detail]);
	return done ? RTUCTL_DONE : RTUCTL_FAILED;
}
