/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The program's COMMANDs to points of other modules, with the ten states and the device's real answer. */
#include "logic/value.h"
#include "modules/logic/host.h"

void commands_before(struct host *host, int64_t now_ns)
{
	struct logic *logic = &host->logic;

	commanding_take_answers(host->map, host->commanding, logic->head->commands, now_ns);
	for (uint16_t i = 0; i < logic->head->commands; i++) {
		const struct commanding *commanding = &host->commanding[i];
		const bool ended = commanding->phase == COMMANDING_ENDED;

		logic_tell(logic, logic->commands[i].state, commanding->state);
		logic_tell(logic, logic->commands[i].result, commanding->result);
		atomic_store(&host->commands[i].asked->end,
			     ended ? (uint32_t)commanding->state << 8 | commanding->result : 0);
	}
}

/* A former process has asked for what still is wanted. What had not ended then is of unknown fate. */
void commands_restore(struct host *host)
{
	for (uint16_t i = 0; i < host->logic.head->commands; i++) {
		const struct logic_asked *asked = host->commands[i].asked;
		const uint32_t end = atomic_load(&asked->end);

		if (!atomic_load(&asked->raised))
			continue;
		if (end != 0)
			commanding_end(&host->commanding[i], end >> 8, end & 0xff);
		else
			commanding_end(&host->commanding[i], MAP_REFUSED_COMMAND, MAP_RESULT_UNKNOWN_FATE);
	}
}

static void begin(struct host *host, uint16_t number, int64_t now_ns)
{
	const struct logic_command *block = &host->logic.commands[number];
	const struct host_command *command = &host->commands[number];
	struct commanding *commanding = &host->commanding[number];
	const double value = host->logic.cells[block->value].d;
	struct map_request *request = &commanding->request;

	*request = (struct map_request){.point = command->point->point, .session = number + 1U};
	if (logic_map_value(command->point->type, command->type, value, &request->value))
		commanding_begin(host->map, commanding, host->logic.cells[block->select].i, now_ns);
	else
		commanding_end(commanding, MAP_REFUSED_COMMAND, MAP_RESULT_OUT_OF_RANGE);
}

void commands_after(struct host *host, int64_t now_ns)
{
	for (uint16_t i = 0; i < host->logic.head->commands; i++) {
		struct host_command *command = &host->commands[i];
		struct commanding *commanding = &host->commanding[i];
		enum logic_wish wish = logic_wish(&host->logic, &host->logic.commands[i]);
		bool rises = wish != LOGIC_NOTHING && !atomic_load(&command->asked->raised);

		atomic_store(&command->asked->raised, wish != LOGIC_NOTHING); /* before anything is posted */
		if (wish == LOGIC_NOTHING && commanding->phase == COMMANDING_ENDED)
			commanding_reset(commanding);
		if (!rises || commanding_is_open(commanding))
			continue;
		if (wish == LOGIC_EXECUTE)
			begin(host, i, now_ns);
		else
			commanding_end(commanding, MAP_REFUSED_COMMAND, MAP_RESULT_OUT_OF_RANGE);
	}
}
