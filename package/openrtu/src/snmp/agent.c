/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "snmp/agent.h"

void snmp_new_message(struct snmp_agent *agent)
{
	agent->now_ns = map_begin_cycle(agent->map);
	agent->clock = map_clock_read(agent->map);
	agent->sampled = MAP_NONE;
}

bool snmp_sample(struct snmp_agent *agent, uint32_t point, struct map_sample *out)
{
	if (agent->sampled != point) {
		agent->sampled = point;
		agent->sampled_good = map_read(agent->map, point, &agent->sample);
	}
	*out = agent->sample;
	return agent->sampled_good;
}
