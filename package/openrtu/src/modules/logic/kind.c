/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Programs of Structured Text: a module for each element of "logic". */
#include <stdio.h>
#include <string.h>

#include "logic/config_part.h"
#include "logic/stats.h"
#include "map/users.h"
#include "modules/kind.h"
#include "modules/logic/carry.h"
#include "process/calls.h"
#include "synch/config.h"

/* A program never holds its module up for longer than its budget, which is some 500 ms on the board at most. */
#define HEARTBEAT_LIMIT_MS 1000

static const struct call_rule calls[] = {CALL(poll), CALL(ppoll_time64), CALL(ppoll), RENEWAL_CALLS};

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
		    .flags = MAP_SHOWS_SCANS | MAP_MAY_OWN | MAP_MAY_REQUEST,
		    .rings = {.requests = 64,
			      .answers = 256,
			      .events = config->settings.event_ring,
			      .log = 128},
		    .heartbeat_limit_ms = HEARTBEAT_LIMIT_MS,
		    .section_size = (uint32_t)logic_section_size(&instances[i]),
		    .retained = {.at = sizeof(struct logic_stats),
				 .values = logic_kept_count(&instances[i]),
				 .first = instances[i].first_retained,
				 .names = instances[i].retained},
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

static const struct logic_instance *find(const struct map_config *config, const char *module)
{
	const struct logic_instance *instances = logic_instances(config);
	uint32_t i = 0;

	while (strcmp(instances[i].name, module + strlen("rtu-logic-")) != 0)
		i++;
	return &instances[i];
}

static uint32_t links_of(const struct map_config *config, const struct logic_instance *instance)
{
	const bool last = instance == &logic_instances(config)[map_record_count(config, LOGIC_INSTANCES) - 1];

	return (last ? map_record_count(config, LOGIC_LINKS) : instance[1].first_link) - instance->first_link;
}

static bool same_initials(const struct map_config *a, const struct logic_instance *of_a,
			  const struct map_config *b, const struct logic_instance *of_b)
{
	for (uint32_t i = 0; i < links_of(a, of_a); i++) {
		const struct logic_link *in_a = &logic_links(a)[of_a->first_link + i];
		const struct logic_link *in_b = &logic_links(b)[of_b->first_link + i];

		if (in_a->has_initial != in_b->has_initial ||
		    memcmp(&in_a->initial, &in_b->initial, sizeof(in_a->initial)) != 0)
			return false;
	}
	return true;
}

static uint32_t reads(const struct map_config *config, const char *module, uint32_t i)
{
	const struct logic_instance *instance = find(config, module);

	return i < links_of(config, instance) ? logic_links(config)[instance->first_link + i].point
					      : MAP_NONE;
}

static bool same(const struct map_config *a, const struct map_config *b, uint32_t module, const char *name)
{
	const struct logic_instance *of_a = find(a, name), *of_b = find(b, name);

	(void)module;
	return of_a->period_ms == of_b->period_ms && of_a->budget == of_b->budget &&
	       of_a->size == of_b->size && of_a->set_points == of_b->set_points &&
	       memcmp(logic_programs(a) + of_a->program, logic_programs(b) + of_b->program, of_a->size) ==
		   0 &&
	       links_of(a, of_a) == links_of(b, of_b) && same_initials(a, of_a, b, of_b);
}

static void carry(const struct map_config *before, const void *from, const struct map_config *now, void *to,
		  const char *module)
{
	logic_carry_kept(before, find(before, module), from, now, find(now, module), to);
}

const struct kind logic_kind = {
    .name = LOGIC_KIND,
    .part = &logic_part,
    .plan = plan,
    .programs = &program,
    .program_count = 1,
    .same = same,
    .reads = reads,
    .carry = carry,
};
