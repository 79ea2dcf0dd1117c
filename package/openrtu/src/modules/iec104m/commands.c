/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/iec104m/commands.h"

#define QU_NONE        0
#define QU_SHORT_PULSE 1
#define QU_LONG_PULSE  2

void commands_init(struct commands *commands, struct map *map, const struct values *values,
		   struct iec104_outstation_stats *stats)
{
	*commands = (struct commands){.map = map, .values = values, .stats = stats};
	/* A pulse that was under way when the last process died ends at the outstation. */
	for (uint32_t i = 0; i < values->count; i++)
		if (map_pulse_end(map, values->entries[i].point) != 0)
			map_pulse_set_end(map, values->entries[i].point, 0);
}

static struct command *find(struct commands *commands, uint32_t request)
{
	for (unsigned i = 0; i < IEC104_CONTROLLING_REQUESTS_MAX; i++)
		if (commands->open[i].request == request)
			return &commands->open[i];
	return NULL;
}

/* ---- ends -------------------------------------------------------------------------------- */

static void finish(struct commands *commands, struct command *command, enum map_command_result result,
		   uint8_t detail)
{
	command->request = 0;
	if (result != MAP_RESULT_DONE)
		map_count(&commands->stats->refused, 1);
	map_command_finish(commands->map, command->point, result, detail);
}

/* A selection that came to nothing has done nothing: its fate is known. */
static void fail(struct commands *commands, struct command *command,
		 const struct iec104_controlling_request *request)
{
	enum map_command_result result = (enum map_command_result)request->result;

	if (request->state != MAP_REFUSED_COMMAND && result == MAP_RESULT_UNKNOWN_FATE)
		result = MAP_RESULT_TIMEOUT;
	finish(commands, command, result, request->cause);
}

static void confirm(const struct commands *commands, struct command *command)
{
	if (!command->confirmed)
		map_command_confirm(commands->map, command->point);
	command->confirmed = true;
}

/* The selection took its time: an old command is not carried out. */
static void go_on(struct commands *commands, struct command *command, struct iec104_controlling *controlling,
		  uint32_t request, struct iec104_moment now)
{
	if (now.monotonic_ns > command->deadline_ns) {
		iec104_controlling_cancel(controlling, request, now);
		finish(commands, command, MAP_RESULT_TOO_OLD, 0);
	} else if (!iec104_controlling_execute(controlling, request, now)) {
		finish(commands, command, MAP_RESULT_TIMEOUT, 0); /* the selection ends there by itself */
	}
}

void commands_progress(struct commands *commands, struct iec104_controlling *controlling,
		       const struct iec104_controlling_request *request, struct iec104_moment now)
{
	struct command *command = find(commands, request->id);

	if (command == NULL)
		return;
	switch (request->state) {
	case MAP_ACCEPTED_SELECTION:
		go_on(commands, command, controlling, request->id, now);
		break;
	case MAP_EXECUTING:
		confirm(commands, command);
		break;
	case MAP_EXECUTED_COMMAND:
		confirm(commands, command);
		finish(commands, command, MAP_RESULT_DONE, 0);
		break;
	case MAP_REFUSED_SELECTION:
	case MAP_INTERRUPTED_SELECTION:
	case MAP_REFUSED_COMMAND:
		fail(commands, command, request);
		break;
	default:
		break;
	}
}

/* ---- what begins ------------------------------------------------------------------------- */

/* How long a pulse lasts the outstation knows: the point says which of its two it is. */
static bool qualifier_of(const struct map_point *point, uint16_t pulse_ms, uint8_t *qualifier)
{
	if (pulse_ms == 0)
		*qualifier = QU_NONE;
	else if (pulse_ms == point->short_pulse_ms)
		*qualifier = QU_SHORT_PULSE;
	else if (pulse_ms == point->long_pulse_ms)
		*qualifier = QU_LONG_PULSE;
	else
		return false;
	return true;
}

static bool encode(const struct commands *commands, const struct map_request *request,
		   const struct values_entry *entry, struct iec104_command *command)
{
	const struct map_point *point = &map_config(commands->map)->points[request->point];

	*command = (struct iec104_command){.ioa = entry->command_ioa,
					   .type = (enum map_type)point->type,
					   .value = request->value,
					   .select = entry->select,
					   .step = request->step};
	/* A regulating step is of a step's point, and the only command that such a point takes. */
	return (point->type == MAP_STEP) == (request->step != 0) &&
	       qualifier_of(point, request->pulse_ms, &command->qualifier);
}

static enum map_cause cause_of(const struct commands *commands, const struct map_request *request)
{
	struct map_module requester;

	map_module(commands->map, request->requester, &requester);
	return (requester.flags & MAP_IS_LOCAL) ? MAP_RETURN_LOCAL : MAP_RETURN_REMOTE;
}

void commands_execute(struct commands *commands, struct iec104_controlling *controlling,
		      const struct map_request *request, struct iec104_moment now)
{
	const struct values_entry *entry = values_of_point(commands->values, request->point);
	struct command *command = find(commands, 0);
	struct iec104_command wire;
	uint32_t sent = 0;

	if (entry == NULL || !encode(commands, request, entry, &wire)) {
		map_command_finish(commands->map, request->point, MAP_RESULT_OUT_OF_RANGE, 0);
		return;
	}
	if (controlling != NULL && command != NULL)
		sent = iec104_controlling_command(controlling, entry->ca, &wire, now);
	if (sent == 0) {
		map_command_finish(commands->map, request->point, MAP_RESULT_TIMEOUT, 0);
		return;
	}
	*command = (struct command){.request = sent,
				    .point = request->point,
				    .cause = (uint8_t)cause_of(commands, request),
				    .deadline_ns = request->deadline_ns};
}

enum map_cause commands_cause(const struct commands *commands, uint32_t point, uint8_t cause)
{
	if (cause != IEC104_RETURN_REMOTE && cause != IEC104_RETURN_LOCAL)
		return MAP_SPONTANEOUS;
	for (unsigned i = 0; i < IEC104_CONTROLLING_REQUESTS_MAX; i++)
		if (commands->open[i].request != 0 && commands->open[i].point == point)
			return (enum map_cause)commands->open[i].cause;
	return cause == IEC104_RETURN_LOCAL ? MAP_RETURN_LOCAL : MAP_RETURN_REMOTE;
}
