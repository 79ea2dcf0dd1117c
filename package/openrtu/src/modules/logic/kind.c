/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Programs of Structured Text: a module for each element of "logic". */
#include <stdio.h>

#include "logic/config_part.h"
#include "logic/stats.h"
#include "modules/calls.h"
#include "modules/kind.h"
#include "modules/users.h"
#include "synch/config.h"

/* A program never holds its module up for longer than its budget, which is some 500 ms on the board at most. */
#define HEARTBEAT_LIMIT_MS 1000

static const struct call_rule calls[] = {CALL(poll), CALL(ppoll_time64), CALL(ppoll)};

static const struct kind_program program = {
    .name = "rtu-logic",
    .calls = calls,
    .call_count = sizeof(calls) / sizeof(calls[0]),
};

static bool plan(struct map_config *config)
{
	struct logic_instance *instances = logic_instances(config);

	for (uint32_t i = 0; i < map_record_count(config, LOGIC_INSTANCES); i++) {
		struct map_module_plan module = {
		    .kind = LOGIC_KIND,
		    .flags = MAP_MAY_OWN | MAP_MAY_REQUEST,
		    .rings = {.requests = 64,
			      .answers = 256,
			      .events = config->settings.event_ring,
			      .log = 128},
		    .heartbeat_limit_ms = HEARTBEAT_LIMIT_MS,
		    .section_size = (uint32_t)logic_section_size(&instances[i]),
		    .counters = LOGIC_COUNTERS,
		    .user = free_user(config),
		};

		snprintf(module.name, sizeof(module.name), "rtu-logic-%s", instances[i].name);
		instances[i].module = map_plan_module(config, &module);
		if (instances[i].module == MAP_NONE)
			return false;
		config->sets[instances[i].set].module = (uint16_t)instances[i].module;
		synch_bind(config, instances[i].name, instances[i].module);
	}
	return true;
}

const struct kind logic_kind = {
    .name = LOGIC_KIND,
    .part = &logic_part,
    .plan = plan,
    .programs = &program,
    .program_count = 1,
};
