/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the blocks COMMAND and REQUEST say to their host after a scan. */
#include "logic/logic.h"
#include "map/map.h"

void logic_tell(struct logic *logic, uint16_t slot, int64_t value)
{
	logic->cells[slot].i = value;
	logic->quality[slot] = 0;
}

void logic_tell_number(struct logic *logic, uint16_t slot, double value)
{
	logic->cells[slot].d = value;
	logic->quality[slot] = 0;
}

const char *logic_fault_name(enum logic_fault fault)
{
	static const char *const names[LOGIC_FAULTS] = {
	    [LOGIC_DIVISION] = "division by zero",
	    [LOGIC_RANGE] = "out of its type's range",
	    [LOGIC_BOUNDS] = "index out of bounds",
	    [LOGIC_DOMAIN] = "outside of a function's domain",
	    [LOGIC_BUDGET] = "too many instructions, the scan ended there and its results are invalid",
	};

	return names[fault];
}

static bool is_good(const struct logic *logic, uint16_t slot)
{
	return (logic->quality[slot] & LOGIC_NOT_GOOD) == 0;
}

enum logic_wish logic_wish(const struct logic *logic, const struct logic_command *command)
{
	if (!logic->cells[command->execute].i)
		return LOGIC_NOTHING;
	return is_good(logic, command->execute) && is_good(logic, command->value) &&
		       is_good(logic, command->select)
		   ? LOGIC_EXECUTE
		   : LOGIC_DOUBTFUL;
}

/* A command that the program has passed on is no longer the program's to refuse. */
static struct logic_verdict judge_new(const struct logic *logic, const struct logic_request *request)
{
	if (logic->cells[request->refuse].i || !is_good(logic, request->refuse))
		return (struct logic_verdict){LOGIC_REFUSED, MAP_RESULT_INTERLOCK};
	return (struct logic_verdict){LOGIC_PENDING, MAP_RESULT_NONE};
}

/* Why the device refused; a program that does not say has an interlock of its own. */
static uint8_t reason_of(int64_t result)
{
	return result > MAP_RESULT_DONE && result <= MAP_RESULT_SENT ? (uint8_t)result : MAP_RESULT_INTERLOCK;
}

struct logic_verdict logic_judge(const struct logic *logic, const struct logic_request *request)
{
	int64_t state = logic->cells[request->state].i, result = logic->cells[request->result].i;

	if (state == MAP_INACTIVE)
		return judge_new(logic, request);
	if (!is_good(logic, request->state) || !is_good(logic, request->result))
		return (struct logic_verdict){LOGIC_PENDING, MAP_RESULT_NONE};
	if (state == MAP_EXECUTED_COMMAND)
		return (struct logic_verdict){LOGIC_EXECUTED, MAP_RESULT_DONE};
	if (state == MAP_REFUSED_COMMAND || state == MAP_REFUSED_SELECTION)
		return (struct logic_verdict){LOGIC_REFUSED, reason_of(result)};
	if (state == MAP_EXECUTING && result == MAP_RESULT_DONE)
		return (struct logic_verdict){LOGIC_CONFIRMED, MAP_RESULT_DONE};
	return (struct logic_verdict){LOGIC_PENDING, MAP_RESULT_NONE};
}
