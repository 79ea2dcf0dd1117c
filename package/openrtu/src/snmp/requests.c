/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the owners of points, and rtud, answer to requests: to ours, and to those of others, which managers are told. */
#include "snmp/agent.h"

static void take(struct snmp_agent *agent, const struct map_answer *answer)
{
	const bool ours = answer->requester == map_self(agent->map);

	switch ((enum map_action)answer->action) {
	case MAP_SELECT:
	case MAP_EXECUTE:
	case MAP_CANCEL:
		if (ours)
			snmp_command_answered(agent, answer);
		else
			snmp_command_of_others(agent, answer);
		break;
	case MAP_FREEZE:
		if (ours)
			snmp_freeze_answered(agent, answer);
		break;
	case MAP_PARAMETER:
		if (ours)
			snmp_parameter_answered(agent, answer);
		break;
	case MAP_SET_CLOCK:
		if (ours)
			snmp_clock_answered(agent, answer);
		break;
	case MAP_RELEASE:
	case MAP_RESTART:
	case MAP_RELOAD:
	case MAP_MODULE:
	case MAP_FORCE:
	case MAP_SETUP:
		break;
	}
}

bool snmp_tick(struct snmp_agent *agent)
{
	struct map_answer answer;
	bool busy;

	while (map_answer_of_any_next(agent->map, &answer))
		take(agent, &answer);
	snmp_stations_tick(agent);
	snmp_cyclic_tick(agent);
	snmp_links_tick(agent);
	busy = snmp_commands_tick(agent);
	busy |= snmp_freezes_tick(agent);
	busy |= snmp_parameters_tick(agent);
	busy |= snmp_clock_tick(agent);
	return busy;
}
