/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The module's commands to points of others, which "commands" name. */
#include <errno.h>

#include "lib/handle.h"

#define DOUBTFUL (MAP_INVALID | MAP_NOT_TOPICAL | MAP_OVERFLOW)

/* The ten states and the results are the map's. */
_Static_assert((int)OPENRTU_EXECUTED_COMMAND == (int)MAP_EXECUTED_COMMAND, "states");
_Static_assert((int)OPENRTU_SENT == (int)MAP_RESULT_SENT, "results");

static struct commanding *commanding_of(const struct openrtu *rtu, int point)
{
	if (!is_point(rtu, point) || rtu->command_of[point] == MAP_NONE)
		return NULL;
	return &rtu->commands[rtu->command_of[point]];
}

void commands_take(struct openrtu *rtu)
{
	if (rtu->command_count > 0)
		commanding_take_answers(rtu->map, rtu->commands, rtu->command_count, rtu->now_ns);
}

bool openrtu_point_takes_commands(const struct openrtu *rtu, int point)
{
	return commanding_of(rtu, point) != NULL;
}

int openrtu_command(struct openrtu *rtu, int point, double value, uint32_t flags)
{
	struct commanding *command = commanding_of(rtu, point);
	union map_value wanted = {0};

	if (!is_point(rtu, point) || (flags & ~(uint32_t)(OPENRTU_SELECT | OPENRTU_ANYWAY)))
		return -EINVAL;
	if (command == NULL)
		return -EPERM;
	if (commanding_is_open(command))
		return -EBUSY;
	if (!value_of_number(type_of(rtu, point), value, &wanted))
		return -ERANGE;
	if ((rtu->seen & DOUBTFUL) && !(flags & OPENRTU_ANYWAY))
		return -ENODATA;
	command->request = (struct map_request){
	    .point = rtu->points[point], .session = rtu->command_of[point] + 1, .value = wanted};
	commanding_begin(rtu->map, command, flags & OPENRTU_SELECT, map_now_ns());
	return 0;
}

int openrtu_command_read(const struct openrtu *rtu, int point, struct openrtu_command *out)
{
	const struct commanding *command = commanding_of(rtu, point);

	*out = (struct openrtu_command){.state = OPENRTU_INACTIVE};
	if (!is_point(rtu, point))
		return -EINVAL;
	if (command == NULL)
		return -EPERM;
	out->state = command->state;
	out->result = command->result;
	out->detail = command->detail;
	out->ended = command->phase == COMMANDING_ENDED;
	return 0;
}
