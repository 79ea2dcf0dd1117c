/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The program's COMMANDs to points of other modules, with the ten states and the device's real answer. */
#include "logic/value.h"
#include "map/time_ns.h"
#include "modules/logic/host.h"

/* No command begins after its deadline; a device, its read-back and the end of a pulse take less than this. */
#define LONGEST_NS (30 * NS_PER_S)

static void end(struct host_command *command, enum map_command_state state, enum map_command_result result)
{
	command->phase = COMMAND_ENDED;
	command->state = (uint8_t)state;
	command->result = (uint8_t)result;
}

static void release(const struct host *host, const struct host_command *command)
{
	map_request_post(host->map, (struct map_request){.point = command->request.point,
							 .action = MAP_RELEASE,
							 .session = command->request.session});
}

/* Without an owner that lives nothing is sent. */
static void post(const struct host *host, struct host_command *command, enum map_action action)
{
	struct map_module owner;

	map_module(host->map, map_owner(host->map, command->request.point), &owner);
	command->generation = owner.generation;
	command->request.action = (uint8_t)action;
	command->id = map_request_post(host->map, command->request);
	if (command->id == 0) {
		end(command, action == MAP_SELECT ? MAP_REFUSED_SELECTION : MAP_REFUSED_COMMAND,
		    MAP_RESULT_NOT_COMMANDABLE);
		return;
	}
	command->phase = action == MAP_SELECT ? COMMAND_SELECTING : COMMAND_EXECUTING;
	command->state = action == MAP_SELECT ? MAP_SELECTION_REQUEST : MAP_EXECUTION_REQUEST;
	command->result = MAP_RESULT_NONE;
}

static void take_answer(const struct host *host, struct host_command *command,
			const struct map_answer *answer)
{
	if (answer->state == MAP_ACCEPTED_SELECTION) {
		post(host, command, MAP_EXECUTE);
		return;
	}
	command->state = answer->state;
	command->result = answer->result;
	if (answer->state == MAP_EXECUTING)
		return;
	command->phase = COMMAND_ENDED;
	release(host, command);
}

static bool is_open(const struct host_command *command)
{
	return command->phase == COMMAND_SELECTING || command->phase == COMMAND_EXECUTING;
}

static void take_answers(struct host *host)
{
	struct map_answer answer;

	while (map_answer_next(host->map, &answer))
		for (uint16_t i = 0; i < host->logic.head->commands; i++)
			if (is_open(&host->commands[i]) && host->commands[i].id == answer.id)
				take_answer(host, &host->commands[i], &answer);
}

static bool owner_has_ended(const struct host *host, const struct host_command *command)
{
	struct map_module owner;

	map_module(host->map, map_owner(host->map, command->request.point), &owner);
	return owner.state == MAP_MODULE_DOWN || owner.state == MAP_MODULE_STOPPED ||
	       owner.generation != command->generation;
}

/* Nobody answers any more: a command that may have been carried out is of unknown fate, and not repeated. */
static void end_orphan(const struct host *host, struct host_command *command, int64_t now_ns)
{
	enum map_command_state state =
	    command->phase == COMMAND_SELECTING ? MAP_REFUSED_SELECTION : MAP_REFUSED_COMMAND;

	if (owner_has_ended(host, command))
		end(command, state, MAP_RESULT_UNKNOWN_FATE);
	else if (now_ns > command->request.deadline_ns + LONGEST_NS)
		end(command, state, MAP_RESULT_TIMEOUT);
}

void commands_before(struct host *host, int64_t now_ns)
{
	struct logic *logic = &host->logic;

	take_answers(host);
	for (uint16_t i = 0; i < logic->head->commands; i++) {
		struct host_command *command = &host->commands[i];

		if (is_open(command))
			end_orphan(host, command, now_ns);
		logic_tell(logic, logic->commands[i].state, command->state);
		logic_tell(logic, logic->commands[i].result, command->result);
	}
}

static void begin(struct host *host, struct host_command *command, const struct logic_command *block,
		  int64_t now_ns)
{
	struct map_request *request = &command->request;
	double number = host->logic.cells[block->value].d;
	int64_t patience_ns = map_config(host->map)->settings.command_timeout_s * NS_PER_S;

	*request = (struct map_request){
	    .point = command->point->point,
	    .session = (uint32_t)(command - host->commands) + 1,
	    .time_ns = now_ns,
	    .deadline_ns = now_ns + patience_ns,
	};
	if (logic_map_value(command->point->type, command->type, number, &request->value))
		post(host, command, host->logic.cells[block->select].i ? MAP_SELECT : MAP_EXECUTE);
	else
		end(command, MAP_REFUSED_COMMAND, MAP_RESULT_OUT_OF_RANGE);
}

static void reset(struct host_command *command)
{
	command->phase = COMMAND_IDLE;
	command->state = MAP_INACTIVE;
	command->result = MAP_RESULT_NONE;
}

void commands_after(struct host *host, int64_t now_ns)
{
	for (uint16_t i = 0; i < host->logic.head->commands; i++) {
		struct host_command *command = &host->commands[i];
		const struct logic_command *block = &host->logic.commands[i];
		enum logic_wish wish = logic_wish(&host->logic, block);
		bool rises = wish != LOGIC_NOTHING && !command->raised;

		command->raised = wish != LOGIC_NOTHING;
		if (wish == LOGIC_NOTHING && command->phase == COMMAND_ENDED)
			reset(command);
		if (!rises || is_open(command))
			continue;
		if (wish == LOGIC_EXECUTE)
			begin(host, command, block, now_ns);
		else
			end(command, MAP_REFUSED_COMMAND, MAP_RESULT_OUT_OF_RANGE);
	}
}
