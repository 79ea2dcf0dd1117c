/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Programs that others wrote, on libopenrtu: one module for each entry of "modules". */
#include <stdio.h>

#include "foreign/config.h"
#include "foreign/config_part.h"
#include "foreign/stats.h"
#include "modules/kind.h"
#include "synch/config.h"

#define FIRST_USER 21 /* behind those of our own kinds */
#define MIB        (1024u * 1024u)

static bool plan(struct map_config *config)
{
	struct foreign_module *modules = foreign_modules(config);

	for (uint32_t i = 0; i < foreign_count(config); i++) {
		const bool owns = modules[i].set != FOREIGN_NO_SET;
		struct map_module_plan module = {
		    .kind = FOREIGN_KIND,
		    .flags = owns ? MAP_MAY_OWN : 0,
		    .rings = {.requests = 1, .answers = owns ? 64 : 1, .log = 128},
		    .heartbeat_limit_ms = modules[i].heartbeat_limit_ms,
		    .section_size = sizeof(struct foreign_stats),
		    .counters = FOREIGN_COUNTERS,
		    .user = FIRST_USER + i,
		};
		uint32_t number;

		module.rings.events = owns ? config->settings.event_ring : 1;
		snprintf(module.name, sizeof(module.name), "%s", modules[i].name);
		number = map_plan_module(config, &module);
		if (number == MAP_NONE)
			return false;
		if (owns)
			config->sets[modules[i].set].module = (uint16_t)number;
		synch_bind(config, modules[i].name, number);
	}
	return true;
}

static int highest_priority(const struct map_config *config)
{
	const struct foreign_module *modules = foreign_modules(config);
	int highest = 0;

	for (uint32_t i = 0; i < foreign_count(config); i++)
		if (modules[i].priority > highest)
			highest = modules[i].priority;
	return highest;
}

static void run(const struct map_config *config, const char *module, struct kind_run *out)
{
	const struct foreign_module *foreign = foreign_find(config, module);

	out->path = foreign->program;
	out->user = foreign->user[0] == '\0' ? NULL : foreign->user;
	out->priority = foreign->priority;
	out->memory = (size_t)foreign->memory_mb * MIB;
}

const struct kind foreign_kind = {
    .name = FOREIGN_KIND,
    .part = &foreign_part,
    .plan = plan,
    .priority = highest_priority,
    .run = run,
};
