/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Other stations of IEC 60870-5-104 as a southbound: one module for all, if the configuration has "outstations". */
#include "modules/kind.h"
#include "iec104/config_outstations.h"
#include "iec104/outstation_stats.h"
#include "iec104/outstations.h"
#include "modules/calls.h"

#define USER               14   /* docs/architecture.md: from 15 down */
#define HEARTBEAT_LIMIT_MS 1000 /* a station that is lost is noticed after seconds */

static const struct call_rule calls[] = {
    CALL(poll), CALL(ppoll_time64), CALL(ppoll), CALL(send), CALL(sendto), TCP_CONNECTION_CALLS,
};

static const struct kind_program program = {
    .name = "rtu-104m",
    .calls = calls,
    .call_count = sizeof(calls) / sizeof(calls[0]),
};

static bool plan(struct map_config *config)
{
	const uint32_t count = map_record_count(config, IEC104_OUTSTATIONS);
	const struct iec104_outstation_set *sets = iec104_outstation_sets(config);
	const struct map_module_plan module = {
	    .name = "rtu-104m",
	    .kind = IEC104_OUTSTATIONS_KIND,
	    .flags = MAP_MAY_OWN,
	    .rings = {.requests = 1, .answers = 256, .events = config->settings.event_ring, .log = 128},
	    .heartbeat_limit_ms = HEARTBEAT_LIMIT_MS,
	    .section_size = (uint32_t)(count * sizeof(struct iec104_outstation_stats)),
	    .counters = (uint32_t)(count * IEC104_OUTSTATION_COUNTERS),
	    .user = USER,
	};
	uint32_t number;

	if (count == 0)
		return true;
	number = map_plan_module(config, &module);
	for (uint32_t i = 0; i < map_record_count(config, IEC104_OUTSTATION_SETS); i++)
		config->sets[sets[i].set].module = (uint16_t)number;
	return number != MAP_NONE;
}

const struct kind iec104m_kind = {
    .name = IEC104_OUTSTATIONS_KIND,
    .part = &iec104_outstations_part,
    .plan = plan,
    .programs = &program,
    .program_count = 1,
};
