/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/kinds.h"

#include <string.h>

/*
 * The table: a line for each kind, whose record is modules/NAME/kind.c. rtud is the first module of a map. The order of the
 * others is that of rtuctl's list, and means nothing.
 */
#define KINDS(KIND)                                                                                          \
	KIND(rtud)                                                                                           \
	KIND(iec104)                                                                                         \
	KIND(rtuctl)                                                                                         \
	KIND(modbus)                                                                                         \
	KIND(journal)                                                                                        \
	KIND(gps)                                                                                            \
	KIND(goose)                                                                                          \
	KIND(iec104m)                                                                                        \
	KIND(logic)                                                                                          \
	KIND(snmp)                                                                                           \
	KIND(iec61850)                                                                                       \
	KIND(web)                                                                                            \
	KIND(foreign)                                                                                        \
	KIND(synch)

#define DECLARE(name)  extern const struct kind name##_kind;
#define POINT_TO(name) &name##_kind,

KINDS(DECLARE)

static const struct kind *const kinds[] = {KINDS(POINT_TO)};

#define COUNT (sizeof(kinds) / sizeof(kinds[0]))
_Static_assert(COUNT <= KINDS_MAX, "kinds_parts has room for KINDS_MAX");

/* ---- rtud itself, and rtuctl, which people run -------------------------------------------- */

static bool plan_rtud(struct map_config *config)
{
	const struct map_module_plan module = {
	    .name = "rtud",
	    .kind = "supervisor",
	    .flags = MAP_IS_SUPERVISOR,
	    .rings = {.requests = 1, .answers = 256, .events = 256, .log = 128},
	    .heartbeat_limit_ms = MAP_IDLE_HEARTBEAT_LIMIT_MS,
	};

	return map_plan_module(config, &module) == MAP_RTUD;
}

static bool plan_rtuctl(struct map_config *config)
{
	const struct map_module_plan module = {
	    .name = "rtuctl",
	    .kind = "rtuctl",
	    .flags = MAP_MAY_REQUEST | MAP_IS_LOCAL,
	    .rings = {.requests = 256, .answers = 1, .events = 1, .log = 1},
	    .heartbeat_limit_ms = MAP_IDLE_HEARTBEAT_LIMIT_MS,
	    .section_size = MAP_PATH_SIZE,
	};

	return map_plan_module(config, &module) != MAP_NONE;
}

const struct kind rtud_kind = {.name = "supervisor", .plan = plan_rtud};
const struct kind rtuctl_kind = {.name = "rtuctl", .plan = plan_rtuctl};

/* ---- what rtud asks ---------------------------------------------------------------------- */

size_t kinds_parts(const struct config_part *parts[KINDS_MAX])
{
	size_t count = 0;

	for (size_t i = 0; i < COUNT; i++)
		if (kinds[i]->part != NULL)
			parts[count++] = kinds[i]->part;
	return count;
}

bool kinds_plan(struct map_config *config)
{
	for (size_t i = 0; i < COUNT; i++)
		if (!kinds[i]->plan(config))
			return false;
	return true;
}

const struct kind *kinds_find(const char *name)
{
	for (size_t i = 0; i < COUNT; i++)
		if (strcmp(kinds[i]->name, name) == 0)
			return kinds[i];
	return NULL;
}

static const struct kind_program *program_of(const struct kind *kind, const struct map_config *config)
{
	if (kind->programs == NULL)
		return NULL;
	return kind->choose == NULL ? &kind->programs[0] : kind->choose(config);
}

static int priority_of(const struct kind *kind, const struct map_config *config)
{
	return kind->priority == NULL ? 0 : kind->priority(config);
}

struct kind_run kinds_run(const struct map_module *module, const struct map_config *config)
{
	const struct kind *kind = kinds_find(module->kind);
	struct kind_run run = {.program = program_of(kind, config), .priority = priority_of(kind, config)};

	if (kind->run != NULL)
		kind->run(config, module->name, &run);
	return run;
}

kind_opener *kinds_opens(const char *name, const char *module, const struct map_config *config)
{
	const struct kind *kind = kinds_find(name);
	struct kind_port port;

	return kind->listens == NULL || kind->listens(config, module, &port) ? kind->open : NULL;
}

int kinds_highest_priority(const struct map_config *config)
{
	int highest = 0;

	for (size_t i = 0; i < COUNT; i++)
		if (priority_of(kinds[i], config) > highest)
			highest = priority_of(kinds[i], config);
	return highest;
}
