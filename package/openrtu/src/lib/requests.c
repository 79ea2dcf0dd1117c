/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Commands of own points: what others request, and what the module says to it. */
#include <errno.h>

#include "lib/handle.h"

/* Longer than any command that the module passes on, from its deadline to the end of its pulse. */
#define PASSED_ON_NS (40 * NS_PER_S)

static struct asked *asked_of(const struct openrtu *rtu, uint32_t map_point)
{
	const struct map_config *config = map_config(rtu->map);

	return &rtu->asked[map_point - config->sets[rtu->module->set].first_point];
}

static uint32_t map_point_of(const struct openrtu *rtu, uint32_t own)
{
	return rtu->points[rtu->input_count + own];
}

/* ---- taking ------------------------------------------------------------------------------ */

static void settle_selection(struct openrtu *rtu, struct asked *asked)
{
	if (!asked->selects)
		return;
	asked->selects = false;
	if (asked->refusal == MAP_RESULT_NONE)
		map_command_request(rtu->map, &asked->selection);
	else
		map_command_refuse(rtu->map, &asked->selection, (enum map_command_result)asked->refusal);
}

static bool is_sound(const struct openrtu *rtu, const struct map_request *request)
{
	const enum map_type type = (enum map_type)map_config(rtu->map)->points[request->point].type;

	if (request->step != 0)
		return type == MAP_STEP && (request->step == 1 || request->step == -1);
	return value_is_sound(type, request->value);
}

static void take_selection(struct openrtu *rtu, struct asked *asked, const struct map_request *request)
{
	asked->selects = true;
	asked->selection_seen = false;
	asked->selection = *request;
	asked->refusal = is_sound(rtu, request) ? MAP_RESULT_NONE : MAP_RESULT_OUT_OF_RANGE;
	if (asked->refusal != MAP_RESULT_NONE)
		settle_selection(rtu, asked);
}

static void take_command(struct openrtu *rtu, struct asked *asked, const struct map_request *request)
{
	if (!is_sound(rtu, request)) {
		map_command_finish(rtu->map, request->point, MAP_RESULT_OUT_OF_RANGE, 0);
		return;
	}
	asked->phase = ASKED_NEW;
	asked->command = *request;
	asked->begun_ns = rtu->now_ns;
}

/* Of parameters, freezes and points that take no commands, the map knows what to do. */
static void take(struct openrtu *rtu, const struct map_request *request)
{
	const bool commandable = map_config(rtu->map)->points[request->point].flags & MAP_POINT_COMMAND;
	struct asked *asked = asked_of(rtu, request->point);

	rtu->asking = true;
	settle_selection(rtu, asked); /* what comes behind it shall find it */
	if (commandable && request->action == MAP_SELECT)
		take_selection(rtu, asked, request);
	else if (map_command_request(rtu->map, request))
		take_command(rtu, asked, request);
}

void requests_take(struct openrtu *rtu)
{
	struct map_request request;

	map_bell_clear_if_taken(rtu->map);
	while (map_request_next(rtu->map, &request))
		take(rtu, &request);
}

/* A pulse that the former process has begun: its points are invalid, and there is no device of the library's to end it at. */
void requests_begin(struct openrtu *rtu)
{
	for (uint32_t i = 0; i < rtu->own_count; i++)
		if (map_pulse_end(rtu->map, map_point_of(rtu, i)) != 0)
			map_pulse_set_end(rtu->map, map_point_of(rtu, i), 0);
}

/* ---- settling ---------------------------------------------------------------------------- */

uint8_t requests_cause(const struct openrtu *rtu, uint32_t own)
{
	return (uint8_t)map_cause_of(rtu->map, &rtu->asked[own].command);
}

/* A module that does not decide, or does not look. */
static bool is_too_late(const struct openrtu *rtu, const struct asked *asked)
{
	int64_t patience_ns = map_command_timeout_s(rtu->map) * NS_PER_S;

	if (asked->phase == ASKED_CONFIRMED)
		patience_ns += PASSED_ON_NS + asked->command.pulse_ms * NS_PER_MS;
	return rtu->now_ns > asked->begun_ns + patience_ns;
}

static void settle_command(struct openrtu *rtu, struct asked *asked)
{
	if (asked->phase == ASKED_NOTHING)
		return;
	if (asked->phase != ASKED_ENDS) {
		if (!is_too_late(rtu, asked))
			return;
		asked->result = MAP_RESULT_TIMEOUT;
	}
	asked->phase = ASKED_NOTHING;
	map_command_finish(rtu->map, asked->command.point, (enum map_command_result)asked->result, 0);
}

void requests_settle(struct openrtu *rtu)
{
	bool open = false;

	for (uint32_t i = 0; rtu->asking && i < rtu->own_count; i++) {
		settle_command(rtu, &rtu->asked[i]);
		settle_selection(rtu, &rtu->asked[i]);
		open |= rtu->asked[i].phase != ASKED_NOTHING;
	}
	rtu->asking = open;
}

/* ---- what the module asks and says ------------------------------------------------------- */

/* The last value and a step, as far as the type goes. */
static union map_value stepped(const struct openrtu *rtu, uint32_t own, int step)
{
	const union map_value last = rtu->samples[rtu->input_count + own].value;
	const union map_value wanted = {.i = last.i + step};

	return value_is_sound(MAP_STEP, wanted) ? wanted : last;
}

static struct openrtu_request request_of(const struct openrtu *rtu, uint32_t own,
					 const struct map_request *is)
{
	const int point = (int)(rtu->input_count + own);

	return (struct openrtu_request){
	    .point = point,
	    .pulse_ms = is->pulse_ms,
	    .value =
		value_number(type_of(rtu, point), is->step != 0 ? stepped(rtu, own, is->step) : is->value),
	    .time_ns = is->time_ns,
	    .flags = map_cause_of(rtu->map, is) == MAP_RETURN_LOCAL ? OPENRTU_LOCAL : 0,
	    .step = is->step,
	};
}

bool openrtu_request_next(struct openrtu *rtu, struct openrtu_request *out)
{
	for (uint32_t i = 0; i < rtu->own_count; i++)
		if (rtu->asked[i].phase == ASKED_NEW) {
			rtu->asked[i].phase = ASKED_SEEN;
			*out = request_of(rtu, i, &rtu->asked[i].command);
			return true;
		}
	return false;
}

bool openrtu_selection_next(struct openrtu *rtu, struct openrtu_request *out)
{
	for (uint32_t i = 0; i < rtu->own_count; i++)
		if (rtu->asked[i].selects && !rtu->asked[i].selection_seen) {
			rtu->asked[i].selection_seen = true;
			*out = request_of(rtu, i, &rtu->asked[i].selection);
			return true;
		}
	return false;
}

static struct asked *open_command(const struct openrtu *rtu, int point)
{
	struct asked *asked;

	if (!is_own(rtu, point))
		return NULL;
	asked = &rtu->asked[(uint32_t)point - rtu->input_count];
	return asked->phase == ASKED_SEEN || asked->phase == ASKED_CONFIRMED ? asked : NULL;
}

int openrtu_request_confirm(struct openrtu *rtu, int point)
{
	struct asked *asked = open_command(rtu, point);

	if (asked == NULL)
		return -ENOENT;
	if (asked->phase == ASKED_SEEN)
		map_command_confirm(rtu->map, asked->command.point);
	asked->phase = ASKED_CONFIRMED;
	return 0;
}

static bool is_result(enum openrtu_result result)
{
	return result > OPENRTU_NONE && (unsigned)result <= MAP_RESULT_SENT;
}

int openrtu_request_end(struct openrtu *rtu, int point, enum openrtu_result result)
{
	struct asked *asked = open_command(rtu, point);

	if (!is_result(result))
		return -EINVAL;
	if (asked == NULL)
		return -ENOENT;
	if (result == OPENRTU_DONE) /* its confirmation goes before its return information */
		openrtu_request_confirm(rtu, point);
	asked->phase = ASKED_ENDS;
	asked->result = (uint8_t)result;
	return 0;
}

int openrtu_selection_refuse(struct openrtu *rtu, int point, enum openrtu_result result)
{
	struct asked *asked = is_own(rtu, point) ? &rtu->asked[(uint32_t)point - rtu->input_count] : NULL;

	if (!is_result(result) || result == OPENRTU_DONE)
		return -EINVAL;
	if (asked == NULL || !asked->selects)
		return -ENOENT;
	asked->refusal = (uint8_t)result;
	return 0;
}
