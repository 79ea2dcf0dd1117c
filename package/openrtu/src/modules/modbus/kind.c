/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Modbus lines: a module for each process number among them. */
#include <stdio.h>

#include "modbus/config.h"
#include "modbus/config_part.h"
#include "modbus/stats.h"
#include "modules/calls.h"
#include "modules/kind.h"
#include "synch/config.h"

#define FIRST_USER 3 /* those before are of modules that there is one of */

static const struct call_rule calls[] = {
    CALL(pread64), /* what the scheduler counts of this process (modules/heartbeat.c) */
    CALL(epoll_wait),  CALL(epoll_pwait),    CALL(epoll_ctl), CALL(timerfd_settime64), CALL(timerfd_settime),
    SERIAL_PORT_CALLS, TCP_CONNECTION_CALLS, CALL(poll),      CALL(ppoll_time64),      CALL(ppoll),
};

static const struct kind_program program = {
    .name = "rtu-modbus",
    .calls = calls,
    .call_count = sizeof(calls) / sizeof(calls[0]),
};

static int priority(const struct map_config *config)
{
	return modbus_settings(config)->priority;
}

static uint32_t lines_of(const struct map_config *config, uint16_t process)
{
	uint32_t lines = 0;

	for (uint32_t i = 0; i < modbus_port_count(config); i++)
		lines += modbus_ports(config)[i].process == process;
	return lines;
}

static bool plan(struct map_config *config)
{
	const uint32_t limit_ms = modbus_settings(config)->heartbeat_limit_ms;
	struct map_module_plan module = {
	    .kind = MODBUS_KIND,
	    .flags = MAP_MAY_OWN,
	    .rings = {.requests = 1, .answers = 256, .events = config->settings.event_ring, .log = 128},
	    .heartbeat_limit_ms = limit_ms ? limit_ms : MAP_HEARTBEAT_LIMIT_MS,
	    .section_size = (uint32_t)modbus_stats_size(config),
	    .user = FIRST_USER,
	};

	for (uint32_t i = 0; i < modbus_port_count(config); i++) {
		uint32_t before = config->module_count, number;
		char line[MAP_NAME_SIZE];

		snprintf(module.name, sizeof(module.name), "rtu-modbus-%u", modbus_ports(config)[i].process);
		module.counters = MODBUS_LINE_COUNTERS * lines_of(config, modbus_ports(config)[i].process);
		number = map_plan_module(config, &module);
		if (number == MAP_NONE)
			return false;
		modbus_ports(config)[i].module = (uint16_t)number;
		module.user += config->module_count - before;
		snprintf(line, sizeof(line), "line%u", modbus_ports(config)[i].port);
		synch_bind(config, line, number);
	}
	for (uint32_t i = 0; i < modbus_slave_count(config); i++)
		config->sets[i].module = modbus_ports(config)[modbus_slaves(config)[i].port].module;
	return true;
}

const struct kind modbus_kind = {
    .name = MODBUS_KIND,
    .part = &modbus_part,
    .plan = plan,
    .programs = &program,
    .program_count = 1,
    .priority = priority,
    .group = "dialout", /* to which Debian and Buildroot give serial devices */
};
