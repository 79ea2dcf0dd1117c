/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "process/commanding.h"

#include "map/time_ns.h"

/* No command begins after its deadline; a device, its read-back and the end of a pulse take less than this. */
#define LONGEST_NS (30 * NS_PER_S)

void commanding_end(struct commanding *command, enum map_command_state state, enum map_command_result result)
{
	command->phase = COMMANDING_ENDED;
	command->state = (uint8_t)state;
	command->result = (uint8_t)result;
}

void commanding_reset(struct commanding *command)
{
	command->phase = COMMANDING_IDLE;
	command->state = MAP_INACTIVE;
	command->result = MAP_RESULT_NONE;
	command->detail = 0;
}

static struct map_module owner_of(const struct map *map, const struct commanding *command)
{
	struct map_module owner;

	map_module(map, map_owner(map, command->request.point), &owner);
	return owner;
}

static void release(struct map *map, const struct commanding *command)
{
	map_request_post(map, (struct map_request){.point = command->request.point,
						   .action = MAP_RELEASE,
						   .session = command->request.session});
}

static void post(struct map *map, struct commanding *command, enum map_action action)
{
	command->generation = owner_of(map, command).generation;
	command->request.action = (uint8_t)action;
	command->id = map_request_post(map, command->request);
	if (command->id == 0) {
		commanding_end(command, action == MAP_SELECT ? MAP_REFUSED_SELECTION : MAP_REFUSED_COMMAND,
			       MAP_RESULT_NOT_COMMANDABLE);
		return;
	}
	command->phase = action == MAP_SELECT ? COMMANDING_SELECTING : COMMANDING_EXECUTING;
	command->state = action == MAP_SELECT ? MAP_SELECTION_REQUEST : MAP_EXECUTION_REQUEST;
	command->result = MAP_RESULT_NONE;
	command->detail = 0;
}

void commanding_begin(struct map *map, struct commanding *command, bool select, int64_t now_ns)
{
	int64_t patience_ns = map_command_timeout_s(map) * NS_PER_S;

	command->request.time_ns = now_ns;
	command->request.deadline_ns = now_ns + patience_ns;
	post(map, command, select ? MAP_SELECT : MAP_EXECUTE);
}

static void take_answer(struct map *map, struct commanding *command, const struct map_answer *answer)
{
	if (answer->state == MAP_ACCEPTED_SELECTION) {
		post(map, command, MAP_EXECUTE);
		return;
	}
	command->state = answer->state;
	command->result = answer->result;
	command->detail = answer->detail;
	if (answer->state == MAP_EXECUTING)
		return;
	command->phase = COMMANDING_ENDED;
	release(map, command);
}

/* Nobody answers any more: a command that may have been carried out is of unknown fate, and not repeated. */
static void end_orphan(const struct map *map, struct commanding *command, int64_t now_ns)
{
	const enum map_command_state state =
	    command->phase == COMMANDING_SELECTING ? MAP_REFUSED_SELECTION : MAP_REFUSED_COMMAND;
	const struct map_module owner = owner_of(map, command);

	if (owner.state == MAP_MODULE_DOWN || owner.state == MAP_MODULE_STOPPED ||
	    owner.generation != command->generation)
		commanding_end(command, state, MAP_RESULT_UNKNOWN_FATE);
	else if (now_ns > command->request.deadline_ns + LONGEST_NS)
		commanding_end(command, state, MAP_RESULT_TIMEOUT);
}

void commanding_take_answers(struct map *map, struct commanding *commands, size_t count, int64_t now_ns)
{
	struct map_answer answer;

	while (map_answer_next(map, &answer))
		for (size_t i = 0; i < count; i++)
			if (commanding_is_open(&commands[i]) && commands[i].id == answer.id)
				take_answer(map, &commands[i], &answer);
	for (size_t i = 0; i < count; i++)
		if (commanding_is_open(&commands[i]))
			end_orphan(map, &commands[i], now_ns);
}
