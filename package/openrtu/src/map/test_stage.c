/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/test_stage.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "map/retained.h"

static void plan_listed(struct stage *stage)
{
	static uint32_t listed[] = {0, 1, 3, 5}; /* the first and the last are for nobody */
	uint32_t number =
	    plan_module(&stage->config, "others", "foreign", MAP_MAY_REQUEST | MAP_REQUESTS_LISTED,
			(struct map_rings){64, 1, 1, 16});

	stage->modules[number].first_listed = 1;
	stage->modules[number].listed_count = 2;
	plan_module(&stage->config, "page", "web", MAP_MAY_REQUEST | MAP_ASKS_SETUP | MAP_REQUESTS_LISTED,
		    (struct map_rings){64, 1, 1, 16});
	map_add_section(&stage->config, MAP_LISTED, sizeof(*listed), 4, listed);
}

static void plan_retained(struct stage *stage)
{
	struct map_module_plan *first = &stage->modules[stage->sets[0].module];

	first->retained = stage->retained;
	first->section_size = stage->retained.at + (uint32_t)map_retained_size(stage->retained.values);
}

static void make(struct stage *stage)
{
	char error[MAP_ERROR_SIZE];

	plan_modules(&stage->config, stage->modules, stage->processes);
	if (stage->retained.values != 0)
		plan_retained(stage);
	if (stage->with_listed)
		plan_listed(stage);
	if (map_create(&stage->rtud, stage->dir, &stage->config, 0, error) < 0)
		fail_msg("%s", error);
}

int set_up(void **state)
{
	struct stage *stage = calloc(1, sizeof(*stage));

	assert_non_null(stage);
	for (uint16_t i = 0; i < 2; i++) {
		stage->sets[i] = (struct map_set){
		    .ca = (uint16_t)(1000 * (i + 1) + 1), .first_point = i * 4u, .point_count = 4};
		stage->processes[i] = i + 1;
	}
	for (uint16_t i = 0; i < POINTS; i++)
		stage->points[i] = (struct map_point){.set = i / 4,
						      .type = MAP_SCALED,
						      .flags = i % 4 ? MAP_POINT_COMMAND : 0,
						      .ioa = 40001u + i % 4};
	stage->points[3].flags |= MAP_POINT_SELECT;
	stage->config = (struct map_config){
	    .settings = {.event_ring = 64, .select_timeout_s = 30, .command_timeout_s = 10},
	    .set_count = 2,
	    .point_count = POINTS,
	    .sets = stage->sets,
	    .points = stage->points};
	strcpy(stage->dir, "/tmp/test_map.XXXXXX");
	assert_non_null(mkdtemp(stage->dir));
	make(stage);
	*state = stage;
	return 0;
}

void make_again(struct stage *stage)
{
	map_remove(stage->rtud);
	map_detach(stage->rtud);
	make(stage);
}

int tear_down(void **state)
{
	struct stage *stage = *state;

	map_remove(stage->rtud);
	map_detach(stage->rtud);
	assert_int_equal(rmdir(stage->dir), 0); /* nothing of the map is left behind */
	free(stage);
	return 0;
}

uint32_t index_of(const struct stage *stage, const char *name)
{
	for (uint32_t i = 0; i < map_module_count(stage->rtud); i++) {
		struct map_module module;

		map_module(stage->rtud, i, &module);
		if (strcmp(module.name, name) == 0)
			return i;
	}
	fail_msg("no module %s", name);
	return MAP_NONE;
}

void set_heartbeat_limit(struct map *map, uint32_t module, uint32_t limit_ms)
{
	map->modules[module].plan.heartbeat_limit_ms = limit_ms;
}

struct map *start(struct stage *stage, const char *name)
{
	char error[MAP_ERROR_SIZE];
	struct map *map;

	map_module_starting(stage->rtud, index_of(stage, name));
	if (map_attach(&map, stage->dir, name, error) < 0)
		fail_msg("%s", error);
	return map;
}

struct map_update scaled(uint32_t point, int32_t value, uint8_t quality, int64_t time_ns)
{
	return (struct map_update){.point = point,
				   .sample = {.value.i = value, .quality = quality, .time_ns = time_ns}};
}

void assert_sample(const struct map *map, uint32_t point, int32_t value, uint8_t quality)
{
	struct map_sample sample;

	assert_true(map_read(map, point, &sample));
	assert_int_equal(sample.value.i, value);
	assert_int_equal(sample.quality, quality);
}

struct command_stage start_commands(struct stage *stage)
{
	return (struct command_stage){start(stage, FIRST), start(stage, "rtu-iec104")};
}

void end_commands(struct command_stage *commands)
{
	map_detach(commands->owner);
	map_detach(commands->requester);
}

struct map_request request(uint32_t point, enum map_action action, uint32_t session, int32_t value)
{
	return (struct map_request){.point = point,
				    .action = (uint8_t)action,
				    .session = session,
				    .value.i = value,
				    .time_ns = map_now_ns(),
				    .deadline_ns = map_now_ns() + 1000000000};
}

bool post(struct command_stage *commands, struct map_request wish)
{
	struct map_request taken;

	assert_int_not_equal(map_request_post(commands->requester, wish), 0);
	assert_true(map_request_next(commands->owner, &taken));
	return map_command_request(commands->owner, &taken);
}

void assert_answer(struct command_stage *commands, enum map_command_state state,
		   enum map_command_result result)
{
	struct map_answer answer;

	assert_true(map_answer_next(commands->requester, &answer));
	assert_int_equal(answer.state, state);
	assert_int_equal(answer.result, result);
}
