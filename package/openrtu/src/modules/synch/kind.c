/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The coordinator of the modules' scans: one module, if the configuration has a net. */
#include "modules/kind.h"
#include "map/users.h"
#include "process/calls.h"
#include "synch/config.h"
#include "synch/config_part.h"
#include "synch/stats.h"

#define HEARTBEAT_LIMIT_MS 1000

static const struct call_rule calls[] = {CALL(poll), CALL(ppoll_time64), CALL(ppoll)};

static const struct kind_program program = {
    .name = "rtu-synch",
    .calls = calls,
    .call_count = sizeof(calls) / sizeof(calls[0]),
};

static bool plan(struct map_config *config)
{
	const struct map_module_plan module = {
	    .name = "rtu-synch",
	    .kind = SYNCH_KIND,
	    .flags = MAP_COORDINATES,
	    .rings = {.requests = 1, .answers = 1, .events = 1, .log = 128},
	    .heartbeat_limit_ms = HEARTBEAT_LIMIT_MS,
	    .section_size = sizeof(struct synch_stats),
	    .counters = SYNCH_TRANSITIONS_MAX,
	    .user = free_user(config),
	};

	return synch_tables(config) == NULL || map_plan_module(config, &module) != MAP_NONE;
}

static int priority(const struct map_config *config)
{
	return synch_tables(config) == NULL ? 0 : (int)synch_tables(config)->priority;
}

static bool same(const struct map_config *a, const struct map_config *b, uint32_t module, const char *name)
{
	(void)module, (void)name;
	return memcmp(synch_tables(a), synch_tables(b), sizeof(struct synch_tables)) == 0;
}

const struct kind synch_kind = {
    .name = SYNCH_KIND,
    .part = &synch_part,
    .plan = plan,
    .programs = &program,
    .program_count = 1,
    .priority = priority,
    .same = same,
};
