/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A map that rtud has created, with two lines in two processes, and the modules that a test starts on it. */
#ifndef OPENRTU_MAP_TEST_STAGE_H
#define OPENRTU_MAP_TEST_STAGE_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "map/layout.h"
#include "map/supervise.h"
#include "map/test_modules.h"

#define POINTS 8
#define FIRST  "rtu-modbus-1"
#define SECOND "rtu-modbus-2"

struct stage {
	char dir[64];
	struct map_set sets[2];
	uint16_t processes[2]; /* of these */
	struct map_point points[POINTS];
	struct map_config config;
	struct map_module_plan modules[MAP_MODULES_MAX];
	struct map_retained_plan retained; /* of the first line */
	/* There is a module "others", which may command points 1 and 3 alone, and "page", which may ask rtud for MAP_SETUP alone. */
	bool with_listed;
	struct map *rtud;
};

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

/* Two lines in two processes, a device each, four points a device. */
int set_up(void **state);
int tear_down(void **state);

/* Takes the map away and makes another of the stage's configuration as it is now. */
void make_again(struct stage *stage);

/* The module's number. */
uint32_t index_of(const struct stage *stage, const char *name);
/* As the process with this map sees it. */
void set_heartbeat_limit(struct map *map, uint32_t module, uint32_t limit_ms);
/* A new generation of a module, in this process. */
struct map *start(struct stage *stage, const char *name);

struct map_update scaled(uint32_t point, int32_t value, uint8_t quality, int64_t time_ns);
void assert_sample(const struct map *map, uint32_t point, int32_t value, uint8_t quality);

/* Who carries out the commands for the first line's points, and who asks for them. */
struct command_stage {
	struct map *owner, *requester;
};

struct command_stage start_commands(struct stage *stage);
void end_commands(struct command_stage *commands);

/* A request of now, with a second to carry it out. */
struct map_request request(uint32_t point, enum map_action action, uint32_t session, int32_t value);
/* Posts it and lets the owner take it. Returns whether the owner shall execute. */
bool post(struct command_stage *commands, struct map_request wish);
void assert_answer(struct command_stage *commands, enum map_command_state state,
		   enum map_command_result result);

#endif
