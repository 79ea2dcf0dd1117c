/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Parameters of measured values: rtuParameters (IEC 60870-5-5, 6.11). What a request sets is checked whole, as the points' owners
 * will, and then asked of them in one go.
 */
#include "snmp/agent.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "map/hash.h"

#define COMPARE_NS   NS_PER_S
#define TENTHS_PER_S 10

/* The first ones are at the place of their kind, and one more. */
enum {
	PARAMETER_SPIN = SNMP_SPIN,
	PARAMETER_THRESHOLD,
	PARAMETER_SMOOTHING,
	PARAMETER_LOW,
	PARAMETER_HIGH,
	PARAMETER_CYCLIC,
	PARAMETER_LOADED,
	PARAMETER_RESULT
};

static enum map_parameter kind_of(unsigned column)
{
	return (enum map_parameter)(column - 1);
}

static uint32_t point_of(const struct snmp_agent *agent, uint32_t row)
{
	return agent->lists[SNMP_MEASURED].points[row];
}

static uint32_t number_of(const struct snmp_agent *agent, uint32_t row)
{
	struct map_parameters now;
	uint32_t hash;

	map_parameters_read(agent->map, point_of(agent, row), &now);
	if (now.loaded == 0)
		return 0; /* of most points of most stations: they are compared each second */
	hash = now.loaded;
	for (unsigned i = 0; i < sizeof(now.values) / sizeof(now.values[0]); i++)
		hash = map_hash_word(hash, now.values[i].u);
	return hash;
}

bool snmp_parameters_begin(struct snmp_agent *agent)
{
	const uint32_t count = agent->lists[SNMP_MEASURED].count;

	agent->parameters = calloc((size_t)count + 1, sizeof(*agent->parameters));
	if (agent->parameters == NULL)
		return false;
	for (uint32_t i = 0; i < count; i++) {
		agent->parameters[i].spin = snmp_first_spin(agent, i);
		agent->parameters[i].seen = number_of(agent, i);
	}
	return true;
}

/* ---- what is asked ----------------------------------------------------------------------- */

static double number_set(const struct snmp_change *change, unsigned column)
{
	const uint32_t bits = (uint32_t)change->number[column];
	float number;

	memcpy(&number, &bits, sizeof(number));
	return number;
}

/* As the map has it: a time in seconds, or in tenths where the value is a whole number. False: it cannot be. */
static bool take_number(const struct map_point *point, unsigned column, double number, union map_value *out)
{
	const bool whole = point->type != MAP_FLOAT && point->type != MAP_ANGLE;

	if (!isfinite(number) || (column <= PARAMETER_SMOOTHING && number < 0))
		return false;
	return map_value_of(point->type,
			    column == PARAMETER_SMOOTHING && whole ? number * TENTHS_PER_S : number, out);
}

static enum snmp_error check_numbers(const struct map_point *point, struct snmp_change *change)
{
	for (unsigned column = PARAMETER_THRESHOLD; column <= PARAMETER_HIGH; column++) {
		union map_value value;

		if (snmp_sets(change, column) &&
		    !take_number(point, column, number_set(change, column), &value))
			return snmp_blame(change, column, SNMP_WRONG_VALUE);
	}
	if (!snmp_sets(change, PARAMETER_CYCLIC))
		return SNMP_GOOD;
	if (change->number[PARAMETER_CYCLIC] != 1 && change->number[PARAMETER_CYCLIC] != 2)
		return snmp_blame(change, PARAMETER_CYCLIC, SNMP_WRONG_VALUE);
	return point->send_period_ms != 0 ? SNMP_GOOD
					  : snmp_blame(change, PARAMETER_CYCLIC, SNMP_INCONSISTENT_VALUE);
}

static enum snmp_error check_limits(const struct snmp_agent *agent, uint32_t point,
				    struct snmp_change *change)
{
	const unsigned column = snmp_sets(change, PARAMETER_LOW) ? PARAMETER_LOW : PARAMETER_HIGH;
	struct map_parameters now;

	if (!snmp_sets(change, column))
		return SNMP_GOOD;
	map_parameters_read(agent->map, point, &now);
	if (snmp_sets(change, PARAMETER_LOW))
		now.low = number_set(change, PARAMETER_LOW);
	if (snmp_sets(change, PARAMETER_HIGH))
		now.high = number_set(change, PARAMETER_HIGH);
	return now.low <= now.high ? SNMP_GOOD : snmp_blame(change, column, SNMP_INCONSISTENT_VALUE);
}

static bool is_loading(const struct snmp_agent *agent)
{
	for (unsigned i = 0; i < SNMP_ROWS_SET_MAX; i++)
		if (agent->loadings[i].last_id != 0)
			return true;
	return false;
}

static enum snmp_error check_syntax(struct snmp_change *change)
{
	enum snmp_error error = snmp_check_column(change, PARAMETER_SPIN, SNMP_INTEGER, 0);

	for (unsigned column = PARAMETER_THRESHOLD; column <= PARAMETER_HIGH && error == SNMP_GOOD; column++)
		error = snmp_check_column(change, column, SNMP_OCTETS, sizeof(float));
	return error == SNMP_GOOD ? snmp_check_column(change, PARAMETER_CYCLIC, SNMP_INTEGER, 0) : error;
}

static enum snmp_error check_parameters(struct snmp_agent *agent, struct snmp_change *change)
{
	const uint32_t point = point_of(agent, change->place.row);
	enum snmp_error error = check_syntax(change);

	if (error == SNMP_GOOD)
		error = snmp_check_spin(change, agent->parameters[change->place.row].spin);
	if (error == SNMP_GOOD)
		error = check_numbers(&agent->config->points[point], change);
	if (error == SNMP_GOOD)
		error = check_limits(agent, point, change);
	if (error != SNMP_GOOD)
		return error;
	if (is_loading(agent) || !map_alive(agent->map, map_owner(agent->map, point)))
		return snmp_blame(change, PARAMETER_SPIN, SNMP_RESOURCE_UNAVAILABLE);
	return SNMP_GOOD;
}

/* ---- asking the owner -------------------------------------------------------------------- */

static void ask(struct snmp_agent *agent, struct snmp_loading *loading, const struct snmp_change *change,
		unsigned column)
{
	struct map_request request = {.point = point_of(agent, loading->row),
				      .action = MAP_PARAMETER,
				      .detail = (uint8_t)kind_of(column),
				      .time_ns = agent->now_ns,
				      .deadline_ns = loading->until_ns};

	if (!snmp_sets(change, column))
		return;
	if (column == PARAMETER_CYCLIC)
		request.value.u = change->number[column] == 1;
	else
		take_number(&agent->config->points[request.point], column, number_set(change, column),
			    &request.value);
	loading->last_id = map_request_post(agent->map, request);
	if (loading->first_id == 0)
		loading->first_id = loading->last_id;
	if (loading->last_id == 0)
		agent->parameters[loading->row].result = MAP_RESULT_UNKNOWN_FATE;
}

/* The owner takes one after the other, and at no time a low limit above the high one. */
static bool high_goes_first(const struct snmp_agent *agent, uint32_t point, const struct snmp_change *change)
{
	struct map_parameters now;

	map_parameters_read(agent->map, point, &now);
	return snmp_sets(change, PARAMETER_HIGH) && number_set(change, PARAMETER_HIGH) >= now.low;
}

static struct snmp_loading *free_loading(struct snmp_agent *agent)
{
	struct snmp_loading *loading = agent->loadings;

	while (loading->last_id != 0 && loading < &agent->loadings[SNMP_ROWS_SET_MAX - 1])
		loading++;
	return loading;
}

static void apply_parameters(struct snmp_agent *agent, const struct snmp_change *change)
{
	static const uint8_t orders[2][PARAMETER_CYCLIC - PARAMETER_SPIN] = {
	    {PARAMETER_THRESHOLD, PARAMETER_SMOOTHING, PARAMETER_LOW, PARAMETER_HIGH, PARAMETER_CYCLIC},
	    {PARAMETER_THRESHOLD, PARAMETER_SMOOTHING, PARAMETER_HIGH, PARAMETER_LOW, PARAMETER_CYCLIC}};
	const uint32_t row = change->place.row, point = point_of(agent, row);
	struct snmp_loading *loading = free_loading(agent);
	const uint8_t *order = orders[high_goes_first(agent, point, change)];
	struct map_module owner;

	map_module(agent->map, map_owner(agent->map, point), &owner);
	agent->parameters[row].spin = snmp_next_spin(agent->parameters[row].spin);
	agent->parameters[row].result = MAP_RESULT_NONE;
	*loading = (struct snmp_loading){
	    .row = row, .generation = owner.generation, .until_ns = snmp_answer_ns(agent)};
	for (unsigned i = 0; i < sizeof(orders[0]); i++)
		ask(agent, loading, change, order[i]);
}

/* ---- answers ----------------------------------------------------------------------------- */

static void end_loading(struct snmp_agent *agent, struct snmp_loading *loading, uint8_t result)
{
	struct snmp_parameter *parameter = &agent->parameters[loading->row];

	if (parameter->result == MAP_RESULT_NONE)
		parameter->result = result;
	loading->last_id = 0;
}

/* They come in the order of what was asked. */
void snmp_parameter_answered(struct snmp_agent *agent, const struct map_answer *answer)
{
	for (unsigned i = 0; i < SNMP_ROWS_SET_MAX; i++) {
		struct snmp_loading *loading = &agent->loadings[i];

		if (loading->last_id == 0 ||
		    answer->id - loading->first_id > loading->last_id - loading->first_id)
			continue;
		if (answer->result != MAP_RESULT_DONE)
			agent->parameters[loading->row].result = answer->result;
		if (answer->id == loading->last_id)
			end_loading(agent, loading, MAP_RESULT_DONE);
	}
}

static bool is_lost(const struct snmp_agent *agent, const struct snmp_loading *loading)
{
	struct map_module owner;

	map_module(agent->map, map_owner(agent->map, point_of(agent, loading->row)), &owner);
	return owner.generation != loading->generation || agent->now_ns > loading->until_ns;
}

/* What others load rings no bell: a controlling station of IEC 60870-5-104, or another manager. */
static void tell_changes(struct snmp_agent *agent)
{
	for (uint32_t i = 0; i < agent->lists[SNMP_MEASURED].count; i++) {
		const uint32_t number = number_of(agent, i);

		if (agent->parameters[i].seen == number)
			continue;
		agent->parameters[i].seen = number;
		snmp_event_add_now(agent, (struct snmp_event){.kind = SNMP_EVENT_PARAMETER,
							      SNMP_OF_POINT(agent, point_of(agent, i))});
	}
}

bool snmp_parameters_tick(struct snmp_agent *agent)
{
	for (unsigned i = 0; i < SNMP_ROWS_SET_MAX; i++)
		if (agent->loadings[i].last_id != 0 && is_lost(agent, &agent->loadings[i]))
			end_loading(agent, &agent->loadings[i], MAP_RESULT_UNKNOWN_FATE);
	if (agent->now_ns >= agent->compared_ns + COMPARE_NS) {
		agent->compared_ns = agent->now_ns;
		tell_changes(agent);
	}
	return is_loading(agent);
}

/* ---- rtuParameterTable ------------------------------------------------------------------- */

static uint32_t count_parameters(const struct snmp_agent *agent)
{
	return agent->lists[SNMP_MEASURED].count;
}

static void index_parameter(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	snmp_point_index(agent, SNMP_MEASURED, row, out);
}

/* BITS: the first one is the most significant. */
static void put_loaded(struct snmp_value *out, uint32_t loaded)
{
	out->syntax = SNMP_OCTETS;
	out->size = 1;
	out->octets[0] = 0;
	for (unsigned kind = MAP_THRESHOLD; kind <= MAP_HIGH_LIMIT; kind++)
		if (loaded & 1u << kind)
			out->octets[0] |= (uint8_t)(0x80u >> (kind - MAP_THRESHOLD));
}

static bool read_parameter(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	struct map_parameters now;

	map_parameters_read(agent->map, point_of(agent, row), &now);
	switch (column) {
	case PARAMETER_SPIN:
		snmp_put_number(out, SNMP_INTEGER, agent->parameters[row].spin);
		return true;
	case PARAMETER_THRESHOLD:
		snmp_put_float(out, (float)now.threshold);
		return true;
	case PARAMETER_SMOOTHING:
		snmp_put_float(out, (float)now.smoothing_s);
		return true;
	case PARAMETER_LOW:
		snmp_put_float(out, (float)now.low);
		return true;
	case PARAMETER_HIGH:
		snmp_put_float(out, (float)now.high);
		return true;
	case PARAMETER_CYCLIC:
		snmp_put_truth(out, now.cyclic);
		return true;
	case PARAMETER_LOADED:
		put_loaded(out, now.loaded);
		return true;
	default:
		snmp_put_number(out, SNMP_INTEGER, agent->parameters[row].result + 1);
		return true;
	}
}

const struct snmp_table snmp_parameter_table = {.prefix = {1, 6, 1},
						.prefix_length = 3,
						.first = PARAMETER_SPIN,
						.last = PARAMETER_RESULT,
						.indexes = 2,
						.writer = SNMP_ENGINEER,
						.writable = 1u << PARAMETER_SPIN | 1u << PARAMETER_THRESHOLD |
							    1u << PARAMETER_SMOOTHING | 1u << PARAMETER_LOW |
							    1u << PARAMETER_HIGH | 1u << PARAMETER_CYCLIC,
						.count = count_parameters,
						.index = index_parameter,
						.read = read_parameter,
						.check = check_parameters,
						.apply = apply_parameters};
