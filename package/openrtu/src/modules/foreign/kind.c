/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Programs that others wrote, on libopenrtu: one module for each entry of "modules". */
#include <stdio.h>

#include "foreign/config.h"
#include "foreign/config_part.h"
#include "map/users.h"
#include "modules/kind.h"
#include "synch/config.h"

#define MIB (1024u * 1024u)

static bool plan(struct map_config *config)
{
	struct foreign_module *modules = foreign_modules(config);

	for (uint32_t i = 0; i < foreign_count(config); i++) {
		const bool owns = modules[i].set != FOREIGN_NO_SET;
		const bool commands = modules[i].command_count > 0;
		struct map_module_plan module = {
		    .kind = FOREIGN_KIND,
		    .flags = MAP_SHOWS_SCANS | (owns ? MAP_MAY_OWN : 0) |
			     (commands ? MAP_MAY_REQUEST | MAP_REQUESTS_LISTED : 0),
		    .first_listed = modules[i].first_command,
		    .listed_count = modules[i].command_count,
		    .rings = {.requests = commands ? 64 : 1, .answers = owns ? 64 : 1, .log = 128},
		    .heartbeat_limit_ms = modules[i].heartbeat_limit_ms,
		    .section_size = sizeof(struct map_scans),
		    .counters = FOREIGN_COUNTERS,
		    .user = FIRST_FOREIGN_USER + i,
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

static bool same_points(const struct map_config *a, const struct foreign_module *of_a,
			const struct map_config *b, const struct foreign_module *of_b)
{
	const struct foreign_point *in_a = map_records(a, FOREIGN_POINTS, sizeof(*in_a));
	const struct foreign_point *in_b = map_records(b, FOREIGN_POINTS, sizeof(*in_b));
	const uint32_t count = of_a->set == FOREIGN_NO_SET ? 0 : a->sets[of_a->set].point_count;

	for (uint32_t i = 0; i < count; i++) {
		const struct foreign_point *point = &in_a[of_a->first_point + i];
		const struct foreign_point *other = &in_b[of_b->first_point + i];
		const uint32_t number = a->sets[of_a->set].first_point + i;
		const uint32_t now = b->sets[of_b->set].first_point + i;

		if (strcmp(map_unit_of(a, &a->points[number]), map_unit_of(b, &b->points[now])) != 0 ||
		    strcmp(foreign_text(a, point->description), foreign_text(b, other->description)) != 0 ||
		    memcmp(&point->initial, &other->initial, sizeof(point->initial)) != 0)
			return false;
	}
	return true;
}

static bool same(const struct map_config *a, const struct map_config *b, uint32_t module, const char *name)
{
	const struct foreign_module *of_a = foreign_find(a, name), *of_b = foreign_find(b, name);

	(void)module;
	return strcmp(of_a->program, of_b->program) == 0 && strcmp(of_a->user, of_b->user) == 0 &&
	       of_a->period_ms == of_b->period_ms && of_a->memory_mb == of_b->memory_mb &&
	       of_a->priority == of_b->priority && of_a->read_count == of_b->read_count &&
	       of_a->command_count == of_b->command_count &&
	       strcmp(foreign_text(a, of_a->config), foreign_text(b, of_b->config)) == 0 &&
	       same_points(a, of_a, b, of_b);
}

/* What it reads, then what it may command. */
static uint32_t reads(const struct map_config *config, const char *module, uint32_t i)
{
	const struct foreign_module *foreign = foreign_find(config, module);
	const uint32_t *points = map_records(config, FOREIGN_READS, sizeof(*points));
	const uint32_t *listed = map_records(config, MAP_LISTED, sizeof(*listed));

	if (i < foreign->read_count)
		return points[foreign->first_read + i];
	i -= foreign->read_count;
	return i < foreign->command_count ? listed[foreign->first_command + i] : MAP_NONE;
}

const struct kind foreign_kind = {
    .name = FOREIGN_KIND,
    .part = &foreign_part,
    .plan = plan,
    .priority = highest_priority,
    .run = run,
    .same = same,
    .reads = reads,
};
