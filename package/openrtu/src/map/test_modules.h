/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The modules of a map for tests: rtud, one that reads and requests ("rtu-iec104"), one for people ("rtuctl"), and one for
 * each process of sets ("rtu-modbus-1" and so on). The map knows no more of them than this.
 */
#ifndef OPENRTU_MAP_TEST_MODULES_H
#define OPENRTU_MAP_TEST_MODULES_H

#include <stdio.h>

#include "map/map.h"

#define TEST_HEARTBEAT_LIMIT_MS 60000 /* a busy host gives a test no time for longer than a real limit */

static inline uint32_t plan_module(struct map_config *config, const char *name, const char *kind,
				   uint32_t flags, struct map_rings rings)
{
	struct map_module_plan module = {.flags = flags,
					 .rings = rings,
					 .heartbeat_limit_ms = MAP_IDLE_HEARTBEAT_LIMIT_MS,
					 .user = config->module_count};

	snprintf(module.name, sizeof(module.name), "%s", name);
	snprintf(module.kind, sizeof(module.kind), "%s", kind);
	return map_plan_module(config, &module);
}

/* modules: room for MAP_MODULES_MAX. processes: of each set; NULL: set i has process i + 1. */
static inline void plan_modules(struct map_config *config, struct map_module_plan *modules,
				const uint16_t *processes)
{
	config->modules = modules;
	config->module_count = 0;
	plan_module(config, "rtud", "supervisor", MAP_IS_SUPERVISOR, (struct map_rings){1, 256, 256, 128});
	plan_module(config, "rtu-iec104", "iec104", MAP_MAY_REQUEST | MAP_HEARS_EVENTS | MAP_KEEPS_QUEUES,
		    (struct map_rings){256, 1, 1, 128});
	plan_module(config, "rtuctl", "rtuctl", MAP_MAY_REQUEST | MAP_IS_LOCAL,
		    (struct map_rings){256, 1, 1, 1});
	for (uint32_t i = 0; i < config->set_count; i++) {
		char name[MAP_NAME_SIZE];
		uint32_t number;

		snprintf(name, sizeof(name), "rtu-modbus-%u", processes ? processes[i] : i + 1);
		number = plan_module(config, name, "modbus", MAP_MAY_OWN,
				     (struct map_rings){1, 256, config->settings.event_ring, 128});
		config->sets[i].module = (uint16_t)number;
		modules[number].heartbeat_limit_ms = TEST_HEARTBEAT_LIMIT_MS;
		modules[number].section_size = 3 * sizeof(uint32_t);
		modules[number].counters = 2;
	}
}

#endif
