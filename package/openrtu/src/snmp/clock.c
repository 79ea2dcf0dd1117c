/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The station's clock, which a manager may set: rtuClock (IEC 60870-5-5, 6.7). */
#include "snmp/agent.h"

#define DELAY_MAX_MS 60000
#define FIRST_MS     946684800000LL  /* 2000, where the years of CP56Time2a begin */
#define END_MS       4102444800000LL /* 2100, behind which it has none */

enum { CLOCK_SPIN = SNMP_SPIN, CLOCK_TIME, CLOCK_SET, CLOCK_DELAY, CLOCK_STATE, CLOCK_RESULT };
enum { NEVER_SET = 1, SET, SYSTEM_SYNCHRONIZED };

static int64_t state_of(const struct map_clock *clock)
{
	if (!clock->set)
		return NEVER_SET;
	return clock->source == MAP_CLOCK_SYNCHRONISED || clock->source == MAP_CLOCK_HELD
		   ? SYSTEM_SYNCHRONIZED
		   : SET;
}

static bool read_clock(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	const struct snmp_clock_setting *setting = &agent->clock_setting;

	(void)row;
	switch (column) {
	case CLOCK_SPIN:
		snmp_put_number(out, SNMP_INTEGER, setting->spin);
		return true;
	case CLOCK_TIME:
		snmp_put_moment(agent, out, agent->now_ns);
		return true;
	case CLOCK_SET:
		snmp_put_time(out, setting->set_ms == 0 ? SNMP_NEVER : setting->set_ms);
		return true;
	case CLOCK_DELAY:
		snmp_put_number(out, SNMP_INTEGER, setting->delay_ms);
		return true;
	case CLOCK_STATE:
		snmp_put_number(out, SNMP_INTEGER, state_of(&agent->clock));
		return true;
	default:
		snmp_put_number(out, SNMP_INTEGER, setting->result + 1);
		return true;
	}
}

static enum snmp_error check_syntax(struct snmp_change *change)
{
	enum snmp_error error = snmp_check_column(change, CLOCK_SPIN, SNMP_INTEGER, 0);

	if (error == SNMP_GOOD)
		error = snmp_check_column(change, CLOCK_SET, SNMP_OCTETS, 8);
	return error == SNMP_GOOD ? snmp_check_column(change, CLOCK_DELAY, SNMP_INTEGER, 0) : error;
}

/* A message that was held up has a number that has been used, or the time of USM (RFC 3414, 2.2.3) refuses it. */
static enum snmp_error check_clock(struct snmp_agent *agent, struct snmp_change *change)
{
	const struct snmp_clock_setting *setting = &agent->clock_setting;
	enum snmp_error error = check_syntax(change);

	if (error == SNMP_GOOD)
		error = snmp_check_spin(change, setting->spin);
	if (error != SNMP_GOOD)
		return error;
	if (!snmp_sets(change, CLOCK_SET) || setting->id != 0)
		return snmp_blame(change, CLOCK_SPIN, SNMP_INCONSISTENT_VALUE);
	if (!agent->is_clock_master)
		return snmp_blame(change, CLOCK_SET, SNMP_NO_ACCESS);
	if (agent->clock.source == MAP_CLOCK_SYNCHRONISED)
		return snmp_blame(change, CLOCK_SET, SNMP_INCONSISTENT_VALUE);
	if (change->number[CLOCK_SET] < FIRST_MS || change->number[CLOCK_SET] >= END_MS - DELAY_MAX_MS)
		return snmp_blame(change, CLOCK_SET, SNMP_WRONG_VALUE);
	if (snmp_sets(change, CLOCK_DELAY) &&
	    (change->number[CLOCK_DELAY] < 0 || change->number[CLOCK_DELAY] > DELAY_MAX_MS))
		return snmp_blame(change, CLOCK_DELAY, SNMP_WRONG_VALUE);
	return SNMP_GOOD;
}

static void apply_clock(struct snmp_agent *agent, const struct snmp_change *change)
{
	struct snmp_clock_setting *setting = &agent->clock_setting;

	setting->spin = snmp_next_spin(setting->spin);
	setting->set_ms = change->number[CLOCK_SET];
	setting->delay_ms = snmp_sets(change, CLOCK_DELAY) ? change->number[CLOCK_DELAY] : 0;
	setting->until_ns = snmp_answer_ns(agent);
	setting->id = map_request_post(
	    agent->map, (struct map_request){.point = MAP_NONE,
					     .action = MAP_SET_CLOCK,
					     .time_ns = agent->now_ns,
					     .deadline_ns = setting->until_ns,
					     .wall_ns = (setting->set_ms + setting->delay_ms) * NS_PER_MS});
	setting->result = setting->id == 0 ? MAP_RESULT_UNKNOWN_FATE : MAP_RESULT_NONE;
}

void snmp_clock_answered(struct snmp_agent *agent, const struct map_answer *answer)
{
	struct snmp_clock_setting *setting = &agent->clock_setting;

	if (setting->id == 0 || setting->id != answer->id)
		return;
	setting->id = 0;
	setting->result = answer->result;
}

bool snmp_clock_tick(struct snmp_agent *agent)
{
	struct snmp_clock_setting *setting = &agent->clock_setting;

	if (setting->id != 0 && agent->now_ns > setting->until_ns) {
		setting->id = 0;
		setting->result = MAP_RESULT_UNKNOWN_FATE;
	}
	return setting->id != 0;
}

static void index_clock(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	(void)agent, (void)row;
	out[0] = 0;
}

const struct snmp_table snmp_clock_group = {.prefix = {1},
					    .prefix_length = 1,
					    .entry = 7,
					    .first = CLOCK_SPIN,
					    .last = CLOCK_RESULT,
					    .indexes = 1,
					    .writer = SNMP_OPERATOR,
					    .writable =
						1u << CLOCK_SPIN | 1u << CLOCK_SET | 1u << CLOCK_DELAY,
					    .index = index_clock,
					    .read = read_clock,
					    .check = check_clock,
					    .apply = apply_clock};
