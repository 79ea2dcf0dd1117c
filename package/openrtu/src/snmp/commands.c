/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Commands: rtuCommands. Of the ten states of a command the three that are a manager's wish, and what was refused, live here:
 * the point's owner keeps neither. All others are the map's, and shown as it has them when they are another protocol's.
 */
#include "snmp/agent.h"

#include <stdio.h>

#define TICKET_MASK 0xffffffu
#define NOT_ISSUED  INT64_MAX

enum { PERSISTENT = 1, SHORT_PULSE, LONG_PULSE, REGULATE };

static uint32_t point_of(const struct snmp_agent *agent, uint32_t row)
{
	return agent->lists[SNMP_COMMANDS].points[row];
}

const char *snmp_user_name(const struct snmp_agent *agent, uint8_t user)
{
	return user < agent->settings->user_count ? agent->settings->users[user].name : "?";
}

void snmp_commands_begin(struct snmp_agent *agent)
{
	agent->tickets = (uint32_t)agent->now_ns ^ (uint32_t)(agent->now_ns >> 32);
	for (uint32_t i = 0; i < agent->lists[SNMP_COMMANDS].count; i++)
		agent->commands[i].spin = snmp_first_spin(agent, i);
}

/* ---- what is shown ----------------------------------------------------------------------- */

struct shown {
	enum map_command_state state;
	uint8_t result, detail;
	uint32_t number;
	int64_t time_ns, until_ns;
	uint8_t protocol;
	char owner[MAP_NAME_SIZE];
};

static bool is_under_way(enum map_command_state state)
{
	return state == MAP_ACCEPTED_SELECTION || state == MAP_EXECUTING;
}

uint8_t snmp_protocol_of(const struct map_module *module)
{
	if (module->flags & MAP_IS_LOCAL)
		return SNMP_BY_LOCAL;
	return module->flags & MAP_KEEPS_QUEUES ? SNMP_BY_IEC104 : SNMP_BY_OTHER;
}

/* What another has ended is inactive, and so is what a former process of this module has: nobody waits for it. */
static struct shown shown_of_others(const struct snmp_agent *agent, uint32_t point)
{
	struct shown shown = {.protocol = SNMP_BY_NONE};
	struct map_command command;
	struct map_module module;

	if (!map_command_read(agent->map, point, &command) || !is_under_way(command.state) ||
	    command.requester >= map_module_count(agent->map))
		return shown;
	map_module(agent->map, command.requester, &module);
	shown = (struct shown){.state = command.state,
			       .result = command.result,
			       .detail = command.detail,
			       .number = command.id,
			       .time_ns = command.time_ns,
			       .until_ns = command.until_ns,
			       .protocol = snmp_protocol_of(&module)};
	snprintf(shown.owner, sizeof(shown.owner), "%s", module.name);
	if (command.requester == map_self(agent->map)) { /* of a former process, which knew whose it was */
		shown.protocol = SNMP_BY_SNMP;
		snprintf(shown.owner, sizeof(shown.owner), "?");
	}
	return shown;
}

static struct shown shown_of(const struct snmp_agent *agent, uint32_t row)
{
	const struct snmp_command *command = &agent->commands[row];
	struct shown shown = {.state = command->state,
			      .result = command->result,
			      .detail = command->detail,
			      .number = command->number,
			      .time_ns = command->time_ns,
			      .until_ns = command->until_ns,
			      .protocol = SNMP_BY_SNMP};

	if (command->state == MAP_INACTIVE)
		return shown_of_others(agent, point_of(agent, row));
	snprintf(shown.owner, sizeof(shown.owner), "%s", snmp_user_name(agent, command->user));
	return shown;
}

static int64_t left_ms(const struct snmp_agent *agent, const struct shown *shown)
{
	const int64_t left_ns = shown->until_ns - agent->now_ns;

	return is_under_way(shown->state) && left_ns > 0 ? left_ns / NS_PER_MS : 0;
}

static int64_t reason_of(uint8_t result)
{
	return result + 1;
}

static bool read_command(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	const struct snmp_command *command = &agent->commands[row];
	const struct shown shown = shown_of(agent, row);

	switch ((enum snmp_command_column)column) {
	case SNMP_COMMAND_SPIN:
		snmp_put_number(out, SNMP_INTEGER, command->spin);
		break;
	case SNMP_COMMAND_STATE:
		snmp_put_number(out, SNMP_INTEGER, shown.state + 1);
		break;
	case SNMP_COMMAND_VALUE:
		snmp_put_number(out, SNMP_INTEGER, command->shown);
		break;
	case SNMP_COMMAND_QUALIFIER:
		snmp_put_number(out, SNMP_INTEGER, command->qualifier == 0 ? PERSISTENT : command->qualifier);
		break;
	case SNMP_COMMAND_ISSUED:
		snmp_put_time(out, command->state == MAP_INACTIVE || command->issued_ms == NOT_ISSUED
				       ? SNMP_NEVER
				       : command->issued_ms);
		break;
	case SNMP_COMMAND_RESULT:
		snmp_put_number(out, SNMP_INTEGER, reason_of(shown.result));
		break;
	case SNMP_COMMAND_DETAIL:
		snmp_put_number(out, SNMP_GAUGE, shown.detail);
		break;
	case SNMP_COMMAND_NUMBER:
		snmp_put_number(out, SNMP_GAUGE, shown.number);
		break;
	case SNMP_COMMAND_OWNER:
		snmp_put_text(out, shown.owner);
		break;
	case SNMP_COMMAND_PROTOCOL:
		snmp_put_number(out, SNMP_INTEGER,
				shown.state == MAP_INACTIVE ? SNMP_BY_NONE : shown.protocol);
		break;
	case SNMP_COMMAND_TIME:
		snmp_put_moment(agent, out, shown.time_ns);
		break;
	case SNMP_COMMAND_LEFT:
		snmp_put_number(out, SNMP_GAUGE, left_ms(agent, &shown));
		break;
	}
	return true;
}

/* ---- the station's side ------------------------------------------------------------------ */

static void advance_spin(struct snmp_command *command)
{
	command->spin = snmp_next_spin(command->spin);
}

/* The station changes a command's state, and tells it. */
static void enter(struct snmp_agent *agent, uint32_t row, enum map_command_state state, uint8_t result,
		  uint8_t detail)
{
	struct snmp_command *command = &agent->commands[row];

	command->state = (uint8_t)state;
	command->result = result;
	command->detail = detail;
	command->time_ns = agent->now_ns;
	command->id = state == MAP_EXECUTING ? command->id : 0;
	advance_spin(command);
	snmp_event_add_now(agent, (struct snmp_event){.kind = SNMP_EVENT_COMMAND,
						      SNMP_OF_POINT(agent, point_of(agent, row)),
						      .value.u = command->number,
						      .spin = command->spin,
						      .state = command->state,
						      .result = result,
						      .detail = detail,
						      .user = command->user});
}

static uint32_t spin_of(const struct snmp_agent *agent, uint32_t point)
{
	for (uint32_t i = 0; i < agent->lists[SNMP_COMMANDS].count; i++)
		if (point_of(agent, i) == point)
			return agent->commands[i].spin;
	return 0;
}

static void take_answer(struct snmp_agent *agent, uint32_t row, const struct map_answer *answer)
{
	struct snmp_command *command = &agent->commands[row];

	if (answer->state == MAP_EXECUTING && command->state == MAP_EXECUTING) {
		command->result = answer->result; /* the device has confirmed; the state is the same */
		return;
	}
	enter(agent, row, answer->state, answer->result, answer->detail);
	if (answer->state == MAP_ACCEPTED_SELECTION)
		command->until_ns = agent->now_ns + map_select_timeout_s(agent->map) * NS_PER_S;
}

void snmp_command_answered(struct snmp_agent *agent, const struct map_answer *answer)
{
	for (uint32_t i = 0; i < agent->lists[SNMP_COMMANDS].count; i++)
		if (agent->commands[i].id != 0 && agent->commands[i].id == answer->id)
			take_answer(agent, i, answer);
}

/* That the device has confirmed what goes on is no other state. */
static bool is_state(const struct map_answer *answer)
{
	return answer->state != MAP_EXECUTING || answer->result == MAP_RESULT_NONE;
}

void snmp_command_of_others(struct snmp_agent *agent, const struct map_answer *answer)
{
	if (answer->point >= agent->config->point_count || !is_state(answer))
		return;
	snmp_event_add(agent,
		       &(struct snmp_event){.kind = SNMP_EVENT_COMMAND,
					    SNMP_OF_POINT(agent, answer->point),
					    .value.u = answer->id,
					    .spin = spin_of(agent, answer->point),
					    .state = answer->state,
					    .result = answer->result,
					    .detail = answer->detail,
					    .user = SNMP_NO_USER,
					    .module = (uint8_t)answer->requester,
					    .time_ms = map_wall_ns(agent->clock, answer->time_ns) / NS_PER_MS,
					    .time_valid = agent->clock.set});
}

static bool owner_is_the_same(const struct snmp_agent *agent, uint32_t row)
{
	const uint32_t owner = map_owner(agent->map, point_of(agent, row));
	struct map_module module;

	map_module(agent->map, owner, &module);
	return module.alive && module.generation == agent->commands[row].generation;
}

/* What becomes of a command whose point's owner has died, or never answers. */
static void lose(struct snmp_agent *agent, uint32_t row)
{
	switch ((enum map_command_state)agent->commands[row].state) {
	case MAP_SELECTION_REQUEST:
		enter(agent, row, MAP_REFUSED_SELECTION, MAP_RESULT_UNKNOWN_FATE, 0);
		break;
	case MAP_ACCEPTED_SELECTION:
	case MAP_INTERRUPTION_REQUEST:
		enter(agent, row, MAP_INTERRUPTED_SELECTION, MAP_RESULT_UNKNOWN_FATE, 0);
		break;
	case MAP_EXECUTION_REQUEST:
	case MAP_EXECUTING:
		enter(agent, row, MAP_REFUSED_COMMAND, MAP_RESULT_UNKNOWN_FATE, 0);
		break;
	case MAP_INACTIVE:
	case MAP_REFUSED_SELECTION:
	case MAP_INTERRUPTED_SELECTION:
	case MAP_REFUSED_COMMAND:
	case MAP_EXECUTED_COMMAND:
		break;
	}
}

/* The map's own word on a selection: it ends by itself. */
static bool selection_is_over(const struct snmp_agent *agent, uint32_t row)
{
	const struct snmp_command *command = &agent->commands[row];
	struct map_command cell;

	return map_command_read(agent->map, point_of(agent, row), &cell) &&
	       (cell.state != MAP_ACCEPTED_SELECTION || cell.requester != map_self(agent->map) ||
		cell.session != command->request.session);
}

static void release(struct snmp_agent *agent, uint32_t row)
{
	struct snmp_command *command = &agent->commands[row];
	struct map_request request = command->request;

	request.action = MAP_RELEASE;
	request.time_ns = agent->now_ns;
	map_request_post(agent->map, request);
	command->state = MAP_INACTIVE;
	command->result = command->detail = 0;
	command->id = 0;
	command->time_ns = agent->now_ns;
}

static bool is_final(uint8_t state)
{
	return state == MAP_REFUSED_SELECTION || state == MAP_INTERRUPTED_SELECTION ||
	       state == MAP_REFUSED_COMMAND || state == MAP_EXECUTED_COMMAND;
}

static bool is_wish(uint8_t state)
{
	return state == MAP_SELECTION_REQUEST || state == MAP_INTERRUPTION_REQUEST ||
	       state == MAP_EXECUTION_REQUEST;
}

static int64_t end_of(const struct snmp_agent *agent, const struct snmp_command *command)
{
	if (is_final(command->state))
		return command->time_ns + agent->settings->release_s * NS_PER_S;
	return is_wish(command->state) || command->state == MAP_ACCEPTED_SELECTION ? command->until_ns
										   : INT64_MAX;
}

static void look_after(struct snmp_agent *agent, uint32_t row)
{
	struct snmp_command *command = &agent->commands[row];

	if (command->state == MAP_INACTIVE)
		return;
	if (is_final(command->state)) {
		if (agent->now_ns < end_of(agent, command))
			return;
		release(agent, row);
		advance_spin(command);
		return;
	}
	if (!owner_is_the_same(agent, row) ||
	    (is_wish(command->state) && agent->now_ns > command->until_ns + SNMP_ANSWER_GRACE_NS))
		lose(agent, row);
	else if (command->state == MAP_ACCEPTED_SELECTION && selection_is_over(agent, row))
		enter(agent, row, MAP_INTERRUPTED_SELECTION, MAP_RESULT_NONE, 0);
}

bool snmp_commands_tick(struct snmp_agent *agent)
{
	bool any = false;

	/* Between the messages of an interrogation nobody commands. */
	for (uint32_t i = 0; agent->commanded && i < agent->lists[SNMP_COMMANDS].count; i++) {
		look_after(agent, i);
		any |= agent->commands[i].state != MAP_INACTIVE;
	}
	agent->commanded = any;
	return any;
}

/* ---- the manager's side ------------------------------------------------------------------ */

static enum snmp_error check_syntax(struct snmp_change *change)
{
	enum snmp_error error = SNMP_GOOD;

	for (unsigned column = SNMP_COMMAND_SPIN; column <= SNMP_COMMAND_QUALIFIER && error == SNMP_GOOD;
	     column++)
		error = snmp_check_column(change, column, SNMP_INTEGER, 0);
	return error == SNMP_GOOD ? snmp_check_column(change, SNMP_COMMAND_ISSUED, SNMP_OCTETS, 8) : error;
}

/* Which of its states may follow which by a manager's wish: figures 2 to 6 of the paper. */
static bool may_follow(enum map_command_state from, int64_t wish)
{
	switch (wish - 1) {
	case MAP_SELECTION_REQUEST:
		return from == MAP_INACTIVE;
	case MAP_EXECUTION_REQUEST:
		return from == MAP_INACTIVE || from == MAP_ACCEPTED_SELECTION;
	case MAP_INTERRUPTION_REQUEST:
		return from == MAP_ACCEPTED_SELECTION;
	case MAP_INACTIVE:
		return is_final((uint8_t)from);
	default:
		return false;
	}
}

static bool is_managers(int64_t wish)
{
	return wish - 1 == MAP_INACTIVE || is_wish((uint8_t)(wish - 1));
}

/* A command's value as the point has it. False: it is none. */
static bool take_value(const struct map_point *point, uint8_t qualifier, int64_t value,
		       struct map_request *request)
{
	if (qualifier == REGULATE) {
		request->step = value == 1 ? -1 : 1;
		return point->step > 0 && (value == 1 || value == 2);
	}
	switch (map_types[point->type].form) {
	case MAP_FORM_SINGLE:
		request->value.u = (uint32_t)value - 1;
		return value == 1 || value == 2;
	case MAP_FORM_DOUBLE:
		request->value.u = (uint32_t)value - 1;
		return value == 2 || value == 3;
	case MAP_FORM_UNSIGNED:
		request->value.i = (int32_t)value;
		return true;
	case MAP_FORM_FLOAT:
		return map_value_of(point->type, (double)value / snmp_scale(snmp_decimals(point)),
				    &request->value);
	case MAP_FORM_DEGREES:
		return map_value_of(point->type, (double)value / MAP_ANGLE_PER_DEGREE, &request->value);
	case MAP_FORM_SIGNED:
	case MAP_FORM_FRACTION:
		break;
	}
	return map_value_of(point->type, (double)value, &request->value);
}

/* False: the point has no such pulse, or a pulse would end as it began. */
static bool take_qualifier(const struct map_point *point, uint8_t qualifier, struct map_request *request)
{
	switch (qualifier) {
	case PERSISTENT:
	case REGULATE:
		return true;
	case SHORT_PULSE:
		request->pulse_ms = point->short_pulse_ms;
		break;
	case LONG_PULSE:
		request->pulse_ms = point->long_pulse_ms;
		break;
	default:
		return false;
	}
	return request->pulse_ms != 0 && (point->type != MAP_SINGLE || request->value.u == 1);
}

/* The request of a change, without its session. */
static enum snmp_error make_request(const struct snmp_agent *agent, uint32_t row, struct snmp_change *change,
				    struct map_request *out)
{
	const struct snmp_command *command = &agent->commands[row];
	const struct map_point *point = &agent->config->points[point_of(agent, row)];
	const int64_t qualifier =
	    snmp_sets(change, SNMP_COMMAND_QUALIFIER) ? change->number[SNMP_COMMAND_QUALIFIER] : PERSISTENT;

	if (command->state == MAP_ACCEPTED_SELECTION && !snmp_sets(change, SNMP_COMMAND_VALUE)) {
		*out = command->request;
		return snmp_sets(change, SNMP_COMMAND_QUALIFIER)
			   ? snmp_blame(change, SNMP_COMMAND_QUALIFIER, SNMP_INCONSISTENT_VALUE)
			   : SNMP_GOOD;
	}
	*out = (struct map_request){.point = point_of(agent, row)};
	if (!snmp_sets(change, SNMP_COMMAND_VALUE))
		return snmp_blame(change, SNMP_COMMAND_STATE, SNMP_INCONSISTENT_VALUE);
	if (qualifier < PERSISTENT || qualifier > REGULATE)
		return snmp_blame(change, SNMP_COMMAND_QUALIFIER, SNMP_WRONG_VALUE);
	if (!take_value(point, (uint8_t)qualifier, change->number[SNMP_COMMAND_VALUE], out))
		return snmp_blame(change, SNMP_COMMAND_VALUE, SNMP_WRONG_VALUE);
	if (!take_qualifier(point, (uint8_t)qualifier, out))
		return snmp_blame(change, SNMP_COMMAND_QUALIFIER, SNMP_WRONG_VALUE);
	return SNMP_GOOD;
}

/* Of a time of issue that is given, the clock is known and it lies within the limit, or what is old is refused as such. */
static enum snmp_error check_issued(const struct snmp_agent *agent, struct snmp_change *change)
{
	const int64_t limit_ms = map_command_timeout_s(agent->map) * 1000;
	const int64_t now_ms = map_wall_ns(agent->clock, agent->now_ns) / NS_PER_MS;
	const int64_t issued_ms = change->number[SNMP_COMMAND_ISSUED];

	if (!snmp_sets(change, SNMP_COMMAND_ISSUED) || issued_ms == -1)
		return SNMP_GOOD;
	if (!agent->clock.set)
		return snmp_blame(change, SNMP_COMMAND_ISSUED, SNMP_INCONSISTENT_VALUE);
	return issued_ms >= 0 && issued_ms <= now_ms + limit_ms
		   ? SNMP_GOOD
		   : snmp_blame(change, SNMP_COMMAND_ISSUED, SNMP_WRONG_VALUE);
}

static enum snmp_error check_command(struct snmp_agent *agent, struct snmp_change *change)
{
	const uint32_t row = change->place.row;
	const struct snmp_command *command = &agent->commands[row];
	const enum map_command_state state = shown_of(agent, row).state;
	struct map_request request;
	enum snmp_error error = check_syntax(change);
	int64_t wish;

	if (error == SNMP_GOOD)
		error = snmp_check_spin(change, command->spin);
	if (error != SNMP_GOOD)
		return error;
	if (!snmp_sets(change, SNMP_COMMAND_STATE))
		return change->given == 1u << SNMP_COMMAND_SPIN
			   ? SNMP_GOOD
			   : snmp_blame(change, SNMP_COMMAND_SPIN, SNMP_INCONSISTENT_VALUE);
	wish = change->number[SNMP_COMMAND_STATE];
	if (!is_managers(wish))
		return snmp_blame(change, SNMP_COMMAND_STATE, SNMP_WRONG_VALUE);
	if (!may_follow(state, wish) ||
	    (state != MAP_INACTIVE && (command->state == MAP_INACTIVE || command->user != change->user)))
		return snmp_blame(change, SNMP_COMMAND_STATE, SNMP_INCONSISTENT_VALUE);
	if (wish - 1 == MAP_INACTIVE)
		return SNMP_GOOD;
	if (!map_alive(agent->map, map_owner(agent->map, point_of(agent, row))))
		return snmp_blame(change, SNMP_COMMAND_STATE, SNMP_RESOURCE_UNAVAILABLE);
	if (wish - 1 == MAP_INTERRUPTION_REQUEST)
		return SNMP_GOOD;
	error = check_issued(agent, change);
	return error == SNMP_GOOD ? make_request(agent, row, change, &request) : error;
}

static enum map_action action_of(int64_t wish)
{
	return wish - 1 == MAP_SELECTION_REQUEST      ? MAP_SELECT
	       : wish - 1 == MAP_INTERRUPTION_REQUEST ? MAP_CANCEL
						      : MAP_EXECUTE;
}

static uint32_t session_of(struct snmp_agent *agent, uint8_t user)
{
	return (uint32_t)(user + 1) << 24 | (++agent->tickets & TICKET_MASK);
}

/* The time of issue as this machine's, when the message has one. */
static int64_t issued_ns(const struct snmp_agent *agent, const struct snmp_change *change)
{
	if (!snmp_sets(change, SNMP_COMMAND_ISSUED) || change->number[SNMP_COMMAND_ISSUED] == -1)
		return agent->now_ns;
	return change->number[SNMP_COMMAND_ISSUED] * NS_PER_MS - agent->clock.offset_ns;
}

static void post(struct snmp_agent *agent, uint32_t row, struct map_request request, int64_t wish)
{
	struct snmp_command *command = &agent->commands[row];
	struct map_module owner;

	map_module(agent->map, map_owner(agent->map, request.point), &owner);
	request.action = (uint8_t)action_of(wish);
	command->generation = owner.generation;
	command->request = request;
	command->state = (uint8_t)(wish - 1);
	agent->commanded = true;
	command->result = command->detail = 0;
	command->time_ns = agent->now_ns;
	command->until_ns = request.deadline_ns > agent->now_ns ? request.deadline_ns : agent->now_ns;
	command->id = map_request_post(agent->map, request);
	command->number = command->id != 0 ? command->id : command->number;
	if (command->id == 0)
		lose(agent, row);
}

static void apply_command(struct snmp_agent *agent, const struct snmp_change *change)
{
	const uint32_t row = change->place.row;
	struct snmp_command *command = &agent->commands[row];
	const int64_t wish = change->number[SNMP_COMMAND_STATE];
	struct snmp_change again = *change;
	struct map_request request = command->request;
	const bool held = command->state == MAP_ACCEPTED_SELECTION;

	advance_spin(command);
	if (!snmp_sets(change, SNMP_COMMAND_STATE))
		return;
	if (wish - 1 == MAP_INACTIVE) {
		release(agent, row);
		return;
	}
	if (wish - 1 != MAP_INTERRUPTION_REQUEST)
		make_request(agent, row, &again, &request);
	request.session = held ? command->request.session : session_of(agent, change->user);
	request.time_ns = issued_ns(agent, change);
	request.deadline_ns = request.time_ns + map_command_timeout_s(agent->map) * NS_PER_S;
	command->user = change->user;
	if (snmp_sets(change, SNMP_COMMAND_VALUE)) {
		command->shown = (int32_t)change->number[SNMP_COMMAND_VALUE];
		command->qualifier = snmp_sets(change, SNMP_COMMAND_QUALIFIER)
					 ? (uint8_t)change->number[SNMP_COMMAND_QUALIFIER]
					 : PERSISTENT;
	}
	command->issued_ms =
	    snmp_sets(change, SNMP_COMMAND_ISSUED) && change->number[SNMP_COMMAND_ISSUED] != -1
		? change->number[SNMP_COMMAND_ISSUED]
		: NOT_ISSUED;
	post(agent, row, request, wish);
}

/* ---- tables ------------------------------------------------------------------------------ */

static uint32_t count_commands(const struct snmp_agent *agent)
{
	return agent->lists[SNMP_COMMANDS].count;
}

static void index_command(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	snmp_point_index(agent, SNMP_COMMANDS, row, out);
}

const struct snmp_table snmp_command_table = {
    .prefix = {1, 3, 1},
    .prefix_length = 3,
    .first = SNMP_COMMAND_SPIN,
    .last = SNMP_COMMAND_LEFT,
    .indexes = 2,
    .writer = SNMP_OPERATOR,
    .writable = 1u << SNMP_COMMAND_SPIN | 1u << SNMP_COMMAND_STATE | 1u << SNMP_COMMAND_VALUE |
		1u << SNMP_COMMAND_QUALIFIER | 1u << SNMP_COMMAND_ISSUED,
    .count = count_commands,
    .index = index_command,
    .read = read_command,
    .check = check_command,
    .apply = apply_command};

#define SECONDS(name, value)                                                                                 \
	static bool name(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)    \
	{                                                                                                    \
		(void)column, (void)row;                                                                     \
		snmp_put_number(out, SNMP_GAUGE, value);                                                     \
		return true;                                                                                 \
	}

SECONDS(read_select_time, map_select_timeout_s(agent->map))
SECONDS(read_time_limit, map_command_timeout_s(agent->map))
SECONDS(read_release_time, agent->settings->release_s)

const struct snmp_table snmp_command_scalars[3] = {
    {.prefix = {1, 3, 2}, .prefix_length = 3, .read = read_select_time},
    {.prefix = {1, 3, 3}, .prefix_length = 3, .read = read_time_limit},
    {.prefix = {1, 3, 4}, .prefix_length = 3, .read = read_release_time},
};
