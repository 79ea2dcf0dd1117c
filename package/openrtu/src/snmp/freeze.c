/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Freezing and resetting integrated totals: rtuFreezeTable. One request goes to each owner of counters that are meant, and the
 * row has its last state when all have answered. The frozen readings are those that a counter interrogation gets.
 */
#include "snmp/agent.h"

#include <stdlib.h>

#define ALL_STATIONS 65535
#define GROUPS       4

enum { FREEZE_SPIN = SNMP_SPIN, FREEZE_ACTION, FREEZE_GROUP, FREEZE_STATE, FREEZE_RESULT };

static uint32_t counter_at(const struct snmp_agent *agent, uint32_t place)
{
	return agent->lists[SNMP_TOTALS].points[place];
}

/* A row for each station with counters, by its address, and one for all. */
bool snmp_freezes_begin(struct snmp_agent *agent)
{
	const uint32_t counters = agent->lists[SNMP_TOTALS].count;

	agent->freezes = calloc((size_t)counters + 1, sizeof(*agent->freezes));
	if (agent->freezes == NULL)
		return false;
	for (uint32_t i = 0; i < counters; i++) {
		const uint16_t ca = snmp_ca(agent, counter_at(agent, i));

		if (agent->freeze_count == 0 || agent->freezes[agent->freeze_count - 1].ca != ca)
			agent->freezes[agent->freeze_count++].ca = ca;
	}
	if (counters != 0)
		agent->freezes[agent->freeze_count++].ca = ALL_STATIONS;
	for (uint32_t i = 0; i < agent->freeze_count; i++)
		agent->freezes[i].spin = snmp_first_spin(agent, i);
	return true;
}

/* ---- asking ------------------------------------------------------------------------------ */

static bool is_meant(const struct snmp_agent *agent, uint16_t ca, uint8_t group, uint32_t point)
{
	return (ca == ALL_STATIONS || snmp_ca(agent, point) == ca) &&
	       (group == 0 || agent->config->points[point].counter_group == group);
}

/* One counter of each owner that has some to freeze. Returns the owners, a bit each. */
static map_modules find_owners(const struct snmp_agent *agent, uint16_t ca, uint8_t group,
			       uint32_t points[MAP_MODULES_MAX])
{
	map_modules owners = 0;

	for (uint32_t i = 0; i < agent->lists[SNMP_TOTALS].count; i++) {
		const uint32_t point = counter_at(agent, i), owner = map_owner(agent->map, point);

		if ((owners & map_module_bit(owner)) || !is_meant(agent, ca, group, point))
			continue;
		owners |= map_module_bit(owner);
		points[owner] = point;
	}
	return owners;
}

static bool all_alive(const struct snmp_agent *agent, map_modules owners)
{
	for (uint32_t i = 0; i < MAP_MODULES_MAX; i++)
		if ((owners & map_module_bit(i)) && !map_alive(agent->map, i))
			return false;
	return true;
}

static uint8_t group_of(const struct snmp_change *change)
{
	return snmp_sets(change, FREEZE_GROUP) ? (uint8_t)change->number[FREEZE_GROUP] : 0;
}

static enum snmp_error check_values(struct snmp_change *change)
{
	if (!snmp_sets(change, FREEZE_ACTION))
		return snmp_blame(change, FREEZE_SPIN, SNMP_INCONSISTENT_VALUE);
	if (change->number[FREEZE_ACTION] < MAP_FREEZE_ONLY || change->number[FREEZE_ACTION] > MAP_RESET_ONLY)
		return snmp_blame(change, FREEZE_ACTION, SNMP_WRONG_VALUE);
	if (snmp_sets(change, FREEZE_GROUP) &&
	    (change->number[FREEZE_GROUP] < 0 || change->number[FREEZE_GROUP] > GROUPS))
		return snmp_blame(change, FREEZE_GROUP, SNMP_WRONG_VALUE);
	return SNMP_GOOD;
}

static enum snmp_error check_freeze(struct snmp_agent *agent, struct snmp_change *change)
{
	const struct snmp_freeze *freeze = &agent->freezes[change->place.row];
	uint32_t points[MAP_MODULES_MAX];
	enum snmp_error error = SNMP_GOOD;

	for (unsigned column = FREEZE_SPIN; column <= FREEZE_GROUP && error == SNMP_GOOD; column++)
		error = snmp_check_column(change, column, SNMP_INTEGER, 0);
	if (error == SNMP_GOOD)
		error = snmp_check_spin(change, freeze->spin);
	if (error == SNMP_GOOD)
		error = check_values(change);
	if (error != SNMP_GOOD)
		return error;
	if (agent->freezing.waiting != 0 ||
	    !all_alive(agent, find_owners(agent, freeze->ca, group_of(change), points)))
		return snmp_blame(change, FREEZE_ACTION, SNMP_RESOURCE_UNAVAILABLE);
	return SNMP_GOOD;
}

static void end_freeze(struct snmp_agent *agent, uint32_t owner, uint8_t result)
{
	struct snmp_freeze *freeze = &agent->freezes[agent->freezing.row];

	agent->freezing.waiting &= ~map_module_bit(owner);
	if (result != MAP_RESULT_DONE)
		freeze->result = result;
	if (agent->freezing.waiting != 0)
		return;
	if (freeze->result == MAP_RESULT_NONE)
		freeze->result = MAP_RESULT_DONE;
	freeze->state = freeze->result == MAP_RESULT_DONE ? MAP_EXECUTED_COMMAND : MAP_REFUSED_COMMAND;
}

static void ask_owner(struct snmp_agent *agent, const struct snmp_freeze *freeze, uint32_t owner,
		      uint32_t point)
{
	struct snmp_freezing *freezing = &agent->freezing;
	struct map_module module;

	map_module(agent->map, owner, &module);
	freezing->generations[owner] = module.generation;
	freezing->ids[owner] = map_request_post(
	    agent->map,
	    (struct map_request){
		.point = point,
		.action = MAP_FREEZE,
		.detail = freeze->action,
		.value.u = freeze->group | (freeze->ca == ALL_STATIONS ? MAP_FREEZE_ALL_DEVICES : 0),
		.time_ns = agent->now_ns,
		.deadline_ns = agent->now_ns + map_command_timeout_s(agent->map) * NS_PER_S});
}

static void apply_freeze(struct snmp_agent *agent, const struct snmp_change *change)
{
	struct snmp_freeze *freeze = &agent->freezes[change->place.row];
	struct snmp_freezing *freezing = &agent->freezing;
	uint32_t points[MAP_MODULES_MAX];
	map_modules owners;

	freeze->spin = snmp_next_spin(freeze->spin);
	freeze->action = (uint8_t)change->number[FREEZE_ACTION];
	freeze->group = group_of(change);
	freeze->state = MAP_EXECUTING;
	freeze->result = MAP_RESULT_NONE;
	if (freezing->waiting != 0) { /* of another row of the same request */
		freeze->state = MAP_REFUSED_COMMAND;
		freeze->result = MAP_RESULT_INTERLOCK;
		return;
	}
	owners = find_owners(agent, freeze->ca, freeze->group, points);
	*freezing = (struct snmp_freezing){
	    .row = change->place.row, .waiting = owners, .until_ns = snmp_answer_ns(agent)};
	if (owners == 0)
		end_freeze(agent, 0, MAP_RESULT_DONE);
	for (uint32_t i = 0; i < MAP_MODULES_MAX; i++)
		if (owners & map_module_bit(i))
			ask_owner(agent, freeze, i, points[i]);
}

/* ---- answers ----------------------------------------------------------------------------- */

void snmp_freeze_answered(struct snmp_agent *agent, const struct map_answer *answer)
{
	for (uint32_t i = 0; i < MAP_MODULES_MAX; i++)
		if ((agent->freezing.waiting & map_module_bit(i)) && agent->freezing.ids[i] == answer->id)
			end_freeze(agent, i, answer->result);
}

/* Died, or never asked because it had, or silent. */
static bool is_lost(const struct snmp_agent *agent, uint32_t owner)
{
	const struct snmp_freezing *freezing = &agent->freezing;
	struct map_module module;

	map_module(agent->map, owner, &module);
	return freezing->ids[owner] == 0 || module.generation != freezing->generations[owner] ||
	       agent->now_ns > freezing->until_ns;
}

bool snmp_freezes_tick(struct snmp_agent *agent)
{
	for (uint32_t i = 0; i < MAP_MODULES_MAX; i++)
		if ((agent->freezing.waiting & map_module_bit(i)) && is_lost(agent, i))
			end_freeze(agent, i, MAP_RESULT_UNKNOWN_FATE);
	return agent->freezing.waiting != 0;
}

/* ---- rtuFreezeTable ---------------------------------------------------------------------- */

static uint32_t count_freezes(const struct snmp_agent *agent)
{
	return agent->freeze_count;
}

static void index_freeze(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	out[0] = agent->freezes[row].ca;
}

static bool read_freeze(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	const struct snmp_freeze *freeze = &agent->freezes[row];
	const int64_t numbers[] = {[FREEZE_SPIN] = freeze->spin,
				   [FREEZE_ACTION] = freeze->action,
				   [FREEZE_GROUP] = freeze->group,
				   [FREEZE_STATE] = freeze->state + 1,
				   [FREEZE_RESULT] = freeze->result + 1};

	snmp_put_number(out, SNMP_INTEGER, numbers[column]);
	return true;
}

const struct snmp_table snmp_freeze_table = {.prefix = {1, 4, 2},
					     .prefix_length = 3,
					     .first = FREEZE_SPIN,
					     .last = FREEZE_RESULT,
					     .indexes = 1,
					     .writer = SNMP_OPERATOR,
					     .writable =
						 1u << FREEZE_SPIN | 1u << FREEZE_ACTION | 1u << FREEZE_GROUP,
					     .count = count_freezes,
					     .index = index_freeze,
					     .read = read_freeze,
					     .check = check_freeze,
					     .apply = apply_freeze};
