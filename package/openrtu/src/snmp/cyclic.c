/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Cyclic data, and polling by classes (IEC 60870-5-5, 6.3 and 6.1): rtuCyclic. When periods of points end, these come into the
 * next turn. The rows are in the order of turns, so what a manager has not taken is behind the turn that it took last. It says
 * what it has taken by a number, for each class: nothing is lost with an answer, and each manager has numbers of its own.
 */
#include "snmp/agent.h"

#include <stdlib.h>

static uint32_t point_at(const struct snmp_agent *agent, uint32_t place)
{
	return agent->lists[SNMP_CYCLIC].points[place];
}

/* ---- turns ------------------------------------------------------------------------------- */

/* As of IEC 60870-5-104 here: periods count from the start of the monotonic clock. */
static int64_t period_end(const struct snmp_agent *agent, uint32_t place, int64_t time_ns)
{
	const int64_t period_ns = agent->config->points[point_at(agent, place)].send_period_ms * NS_PER_MS;

	return (time_ns / period_ns + 1) * period_ns;
}

static void schedule(struct snmp_agent *agent)
{
	struct snmp_cyclic *cyclic = &agent->cyclic;

	cyclic->from_ns = agent->now_ns;
	cyclic->due_ns = INT64_MAX;
	for (uint32_t i = 0; i < agent->lists[SNMP_CYCLIC].count; i++) {
		const int64_t end_ns = period_end(agent, i, cyclic->from_ns);

		if (end_ns < cyclic->due_ns)
			cyclic->due_ns = end_ns;
	}
}

bool snmp_cyclic_begin(struct snmp_agent *agent)
{
	struct snmp_cyclic *cyclic = &agent->cyclic;
	const uint32_t count = agent->lists[SNMP_CYCLIC].count;

	cyclic->turns = calloc((size_t)count + 1, sizeof(*cyclic->turns));
	cyclic->order = calloc((size_t)count + 1, sizeof(*cyclic->order));
	cyclic->spare = calloc((size_t)count + 1, sizeof(*cyclic->spare));
	if (cyclic->turns == NULL || cyclic->order == NULL || cyclic->spare == NULL)
		return false;
	for (uint32_t i = 0; i < count; i++)
		cyclic->order[i] = i;
	cyclic->never = count;
	agent->now_ns = map_now_ns();
	schedule(agent);
	return true;
}

void snmp_cyclic_end(struct snmp_agent *agent)
{
	free(agent->cyclic.turns);
	free(agent->cyclic.order);
	free(agent->cyclic.spare);
}

static bool has_ended(const struct snmp_agent *agent, uint32_t place)
{
	struct map_parameters parameters;

	if (period_end(agent, place, agent->cyclic.from_ns) > agent->now_ns)
		return false;
	map_parameters_read(agent->map, point_at(agent, place), &parameters);
	return parameters.cyclic;
}

/* Those of this turn go behind all others, each in the order that it had. */
static void order(struct snmp_agent *agent, uint32_t turn)
{
	struct snmp_cyclic *cyclic = &agent->cyclic;
	const uint32_t count = agent->lists[SNMP_CYCLIC].count;
	uint32_t *former = cyclic->order;
	uint32_t kept = 0;

	cyclic->never = 0;
	for (uint32_t i = 0; i < count; i++)
		if (cyclic->turns[former[i]] != turn) {
			cyclic->never += cyclic->turns[former[i]] == 0;
			cyclic->spare[kept++] = former[i];
		}
	for (uint32_t place = 0; place < count; place++)
		if (cyclic->turns[place] == turn)
			cyclic->spare[kept++] = place;
	cyclic->order = cyclic->spare;
	cyclic->spare = former;
}

enum { CLASS_1, CLASS_2 };

/* It is told when somebody who polls had taken all, and once before anybody polls: who is busy is not told again and again. */
static bool is_awaited(const struct snmp_agent *agent)
{
	const uint32_t turn = agent->shared->turn;

	for (uint32_t i = 0; turn != 0 && i < agent->settings->user_count; i++)
		if (agent->shared->taken[i][CLASS_2] == turn)
			return true;
	return turn == 0;
}

void snmp_cyclic_tick(struct snmp_agent *agent)
{
	const uint32_t turn = agent->shared->turn + 1;
	const bool awaited = is_awaited(agent);
	uint32_t ended = 0;

	if (agent->now_ns < agent->cyclic.due_ns)
		return;
	for (uint32_t i = 0; i < agent->lists[SNMP_CYCLIC].count; i++)
		if (has_ended(agent, i)) {
			agent->cyclic.turns[i] = turn;
			ended++;
		}
	schedule(agent);
	if (ended == 0)
		return;
	order(agent, turn);
	agent->shared->turn = turn;
	if (awaited)
		snmp_event_add_now(agent, (struct snmp_event){.kind = SNMP_EVENT_CYCLIC,
							      .ca = SNMP_NO_CA,
							      .value.u = turn & INT32_MAX});
}

static bool read_last(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)column, (void)row;
	snmp_put_number(out, SNMP_GAUGE, agent->shared->turn);
	return true;
}

const struct snmp_table snmp_cyclic_last = {.prefix = {1, 5, 1}, .prefix_length = 3, .read = read_last};

/* ---- rtuCyclicTable ---------------------------------------------------------------------- */

enum { CYCLIC_TYPE = 2, CYCLIC_VALUE, CYCLIC_FLOAT, CYCLIC_QUALITY, CYCLIC_TIME };

static uint32_t count_rows(const struct snmp_agent *agent)
{
	return agent->lists[SNMP_CYCLIC].count - agent->cyclic.never;
}

static uint32_t place_of(const struct snmp_agent *agent, uint32_t row)
{
	return agent->cyclic.order[agent->cyclic.never + row];
}

static void index_row(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	const uint32_t point = point_at(agent, place_of(agent, row));

	out[0] = agent->cyclic.turns[place_of(agent, row)];
	out[1] = snmp_ca(agent, point);
	out[2] = agent->config->points[point].ioa;
}

static bool read_row(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	const uint32_t point = point_at(agent, place_of(agent, row));
	const struct map_point *object = &agent->config->points[point];
	const enum map_type type = (enum map_type)object->type;
	struct map_sample sample;

	if (!snmp_sample(agent, point, &sample))
		return false;
	switch (column) {
	case CYCLIC_TYPE:
		snmp_put_number(out, SNMP_INTEGER, snmp_type_number(type));
		break;
	case CYCLIC_VALUE:
		snmp_put_number(out, SNMP_INTEGER,
				(int32_t)snmp_shown_value(type, snmp_decimals(object), sample.value));
		break;
	case CYCLIC_FLOAT:
		snmp_put_float(
		    out, map_types[type].class == MAP_CLASS_MEASURED ? snmp_float_of(type, sample.value) : 0);
		break;
	case CYCLIC_QUALITY:
		snmp_put_quality(out, sample.quality, 0);
		break;
	default:
		snmp_put_moment(agent, out, sample.time_ns);
		break;
	}
	return true;
}

const struct snmp_table snmp_cyclic_table = {.prefix = {1, 5, 2},
					     .prefix_length = 3,
					     .first = CYCLIC_TYPE,
					     .last = CYCLIC_TIME,
					     .indexes = 3,
					     .count = count_rows,
					     .index = index_row,
					     .read = read_row};

/* ---- rtuPollTable ------------------------------------------------------------------------ */

enum { POLL_USER = 2, POLL_WAITING_1, POLL_TAKEN_1, POLL_WAITING_2, POLL_TAKEN_2 };

static uint32_t count_users(const struct snmp_agent *agent)
{
	return agent->settings->user_count;
}

static void index_user(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	(void)agent;
	out[0] = row + 1;
}

/* Rows of turns behind this one. */
static uint32_t rows_behind(const struct snmp_agent *agent, uint32_t turn)
{
	uint32_t waiting = 0;

	while (waiting < count_rows(agent) &&
	       agent->cyclic.turns[place_of(agent, count_rows(agent) - 1 - waiting)] > turn)
		waiting++;
	return waiting;
}

/* Number of the newest of a class. */
static uint32_t last_of(const struct snmp_agent *agent, unsigned class)
{
	return class == CLASS_1 ? agent->position.last : agent->shared->turn;
}

static bool read_poll(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	const _Atomic uint32_t *taken = agent->shared->taken[row];

	switch (column) {
	case POLL_USER:
		snmp_put_text(out, agent->settings->users[row].name);
		break;
	case POLL_WAITING_1:
		snmp_put_number(out, SNMP_GAUGE, last_of(agent, CLASS_1) - taken[CLASS_1]);
		break;
	case POLL_WAITING_2:
		snmp_put_number(out, SNMP_GAUGE, rows_behind(agent, taken[CLASS_2]));
		break;
	default:
		snmp_put_number(out, SNMP_GAUGE, taken[column == POLL_TAKEN_1 ? CLASS_1 : CLASS_2]);
		break;
	}
	return true;
}

static enum snmp_error check_taken(const struct snmp_agent *agent, struct snmp_change *change,
				   unsigned column, unsigned class)
{
	const enum snmp_error error = snmp_check_column(change, column, SNMP_GAUGE, 0);

	if (error != SNMP_GOOD || !snmp_sets(change, column))
		return error;
	if (change->user != change->place.row)
		return snmp_blame(change, column, SNMP_NO_ACCESS);
	return change->number[column] <= last_of(agent, class) ? SNMP_GOOD
							       : snmp_blame(change, column, SNMP_WRONG_VALUE);
}

static enum snmp_error check_poll(struct snmp_agent *agent, struct snmp_change *change)
{
	const enum snmp_error error = check_taken(agent, change, POLL_TAKEN_1, CLASS_1);

	return error == SNMP_GOOD ? check_taken(agent, change, POLL_TAKEN_2, CLASS_2) : error;
}

static void apply_poll(struct snmp_agent *agent, const struct snmp_change *change)
{
	_Atomic uint32_t *taken = agent->shared->taken[change->place.row];

	if (snmp_sets(change, POLL_TAKEN_1))
		taken[CLASS_1] = (uint32_t)change->number[POLL_TAKEN_1];
	if (snmp_sets(change, POLL_TAKEN_2))
		taken[CLASS_2] = (uint32_t)change->number[POLL_TAKEN_2];
}

const struct snmp_table snmp_poll_table = {.prefix = {1, 5, 3},
					   .prefix_length = 3,
					   .first = POLL_USER,
					   .last = POLL_TAKEN_2,
					   .indexes = 1,
					   .reader = SNMP_OPERATOR,
					   .writer = SNMP_OPERATOR,
					   .writable = 1u << POLL_TAKEN_1 | 1u << POLL_TAKEN_2,
					   .count = count_users,
					   .index = index_user,
					   .read = read_poll,
					   .check = check_poll,
					   .apply = apply_poll};
