/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Commands: requests in the requester's segment, answers and the state machine in the owner's.
 *
 * Of the ten states three are a manager's wish: selection request, interruption of selection request, execution
 * request. Here the wish is the record in the requester's ring; the command itself goes straight to the answer.
 */
#include "map/layout.h"
#include "map/supervise.h"
#include "map/time_ns.h"

#define RECORDS_A_TURN 256u /* a ring's worth: more in one turn of the loop is somebody gone wild */
#define LISTED_A_TURN                                                                                        \
	16u /* of a module of others: the answers to a flood leave room for those to a control centre */

static bool turn_is_over(const struct map *map)
{
	return map->taken >= RECORDS_A_TURN;
}

/* The rest is taken in the next turn of the caller's loop, which this bell begins. */
static void ring_own_bell_for_the_rest(const struct map *map)
{
	if (turn_is_over(map))
		bell_ring(map, map->self);
}

static bool is_for_rtud(uint8_t action)
{
	return action == MAP_SET_CLOCK || action == MAP_RESTART || action == MAP_MODULE ||
	       action == MAP_RELOAD || action == MAP_FORCE || action == MAP_SETUP;
}

/* ---- requester --------------------------------------------------------------------------- */

uint32_t map_request_post(struct map *map, struct map_request request)
{
	struct segment_header *header = map->segments[map->self].header;
	uint32_t owner = is_for_rtud(request.action) ? MAP_RTUD : map_owner(map, request.point);

	if (!map_alive(map, owner))
		return 0;
	request.id = atomic_fetch_add_explicit(&header->next_request, 1, memory_order_relaxed);
	if (request.id == 0) /* wrapped: 0 means "not posted" */
		request.id = atomic_fetch_add_explicit(&header->next_request, 1, memory_order_relaxed);
	request.generation = atomic_load(&map->directory->modules[owner].generation);
	request.requester = (uint16_t)map->self;
	request.owner = (uint8_t)owner;
	if (owner != MAP_RTUD) { /* whatever configurations the two have: map_renew */
		request.ioa = map->config.points[request.point].ioa;
		request.ca = map->config.sets[map->config.points[request.point].set].ca;
		request.point = slot_of(map, request.point);
	}
	ring_put(&map->segments[map->self].requests, &request);
	bell_ring(map, owner);
	return request.id;
}

static bool next_answer(struct map *map, bool of_others, struct map_answer *out)
{
	struct segment_header *header = map->segments[map->self].header;

	for (uint32_t i = 0; i < map_module_count(map); i++) {
		uint32_t lost = 0;

		while (!turn_is_over(map) &&
		       ring_peek(&map->segments[i].answers, &header->answer_next[i], out, &lost)) {
			header->answer_next[i]++;
			map->taken++;
			if (out->requester != map->self && !of_others)
				continue;
			if (i != MAP_RTUD)
				out->point = point_in(map, i, out->point);
			return true;
		}
	}
	ring_own_bell_for_the_rest(map);
	return false;
}

bool map_answer_next(struct map *map, struct map_answer *out)
{
	return next_answer(map, false, out);
}

bool map_answer_of_any_next(struct map *map, struct map_answer *out)
{
	return next_answer(map, true, out);
}

/* ---- owner ------------------------------------------------------------------------------- */

static bool is_for(const struct map *map, const struct map_request *request)
{
	if (request->generation != atomic_load(&map->directory->modules[map->self].generation))
		return false;
	return request->owner == map->self && is_for_rtud(request->action) == (map->self == MAP_RTUD);
}

static bool is_at(const struct map *map, uint32_t point, const struct map_request *request)
{
	const struct map_point *object = &map->config.points[point];

	return object->ioa == request->ioa && map->config.sets[object->set].ca == request->ca;
}

/* Who asked may have the configuration before this one: there the point's slot was another's. MAP_NONE: there is no such point. */
static uint32_t find_asked(const struct map *map, const struct map_request *request)
{
	uint32_t point = point_in(map, map->self, request->point);

	if (point != MAP_NONE && is_at(map, point, request))
		return point;
	point = map_find(map, request->ca, request->ioa);
	return point != MAP_NONE && map_owner(map, point) == map->self ? point : MAP_NONE;
}

/* False: there is no such point, and who asked is told. */
static bool take_point(struct map *map, struct map_request *request)
{
	const uint32_t point = map->self == MAP_RTUD ? request->point : find_asked(map, request);
	const struct map_answer refusal = {
	    .id = request->id,
	    .point = request->point,
	    .requester = request->requester,
	    .state = request->action == MAP_SELECT ? MAP_REFUSED_SELECTION : MAP_REFUSED_COMMAND,
	    .result = MAP_RESULT_NOT_COMMANDABLE,
	    .action = request->action,
	    .time_ns = map_now_ns(),
	};

	if (map->self == MAP_RTUD || point != MAP_NONE) {
		request->point = point;
		return true;
	}
	ring_put(&map->segments[map->self].answers, &refusal);
	bell_ring(map, request->requester);
	return false;
}

static bool is_listed(const struct map *map, const struct map_module_plan *plan, uint32_t point)
{
	const uint32_t *listed = map_records(&map->config, MAP_LISTED, sizeof(*listed));
	uint32_t low = plan->first_listed, high = low + plan->listed_count;

	while (listed != NULL && low < high) {
		uint32_t middle = low + (high - low) / 2;

		if (listed[middle] == point)
			return true;
		if (listed[middle] < point)
			low = middle + 1;
		else
			high = middle;
	}
	return false;
}

static bool is_allowed(const struct map *map, const struct map_module_plan *plan,
		       const struct map_request *request)
{
	if (request->action == MAP_SETUP)
		return (plan->flags & MAP_ASKS_SETUP) != 0;
	if (!(plan->flags & MAP_REQUESTS_LISTED))
		return true;
	return request->action <= MAP_RELEASE && is_listed(map, plan, request->point);
}

/* What a library refuses its module may come all the same, from a module that does without the library. */
static bool may_request(struct map *map, uint32_t requester, const struct map_request *request)
{
	const struct map_module_plan *plan = &map->modules[requester].plan;

	if (is_allowed(map, plan, request))
		return true;
	if (!(map->refused & map_module_bit(requester)))
		map_log(map, MAP_LOG_WARNING, "%s requests what it may not", plan->name);
	map->refused |= map_module_bit(requester);
	return false;
}

static bool has_its_share(const struct map *map, uint32_t requester)
{
	return (map->modules[requester].plan.flags & MAP_REQUESTS_LISTED) &&
	       map->taken_of[requester] >= LISTED_A_TURN;
}

/* The next record of a requester, whatever it says. */
static bool take_request(struct map *map, uint32_t requester, struct map_request *out, uint32_t *lost)
{
	uint32_t *next = &map->segments[map->self].header->request_next[requester];

	if (turn_is_over(map) || has_its_share(map, requester) ||
	    !ring_peek(&map->segments[requester].requests, next, out, lost))
		return false;
	(*next)++;
	map->taken++;
	map->taken_of[requester]++;
	if (has_its_share(map, requester))
		bell_ring(map, map->self);
	out->requester = (uint16_t)requester; /* whose ring it is, whatever it says */
	return true;
}

bool map_request_next(struct map *map, struct map_request *out)
{
	for (uint32_t i = 0; i < map_module_count(map); i++) {
		uint32_t lost = 0;

		if (!(map->modules[i].plan.flags & MAP_MAY_REQUEST))
			continue; /* what its ring holds all the same, it wrote gone wild */
		while (take_request(map, i, out, &lost))
			if (is_for(map, out) && take_point(map, out) && may_request(map, i, out))
				return true;
		if (lost)
			map_log(map, MAP_LOG_ERROR, "%u requests of %s were overwritten unread", lost,
				map->modules[i].plan.name);
	}
	ring_own_bell_for_the_rest(map);
	return false;
}

static void answer(struct map *map, const struct map_command *command, uint32_t point, enum map_action action)
{
	struct map_answer record = {
	    .id = command->id,
	    .point = map->self == MAP_RTUD ? point : slot_of(map, point),
	    .requester = command->requester,
	    .state = command->state,
	    .result = command->result,
	    .detail = command->detail,
	    .action = (uint8_t)action,
	    .time_ns = map_now_ns(),
	};

	ring_put(&map->segments[map->self].answers, &record);
	bell_ring(map, command->requester);
}

static struct command_cell *own_cell(const struct map *map, uint32_t point)
{
	return &map->segments[map->self].commands[map->config.points[point].command];
}

/* The owner is the only writer: what it wrote last is in either copy. */
static struct map_command current(const struct command_cell *cell)
{
	return cell->copies[0];
}

static void store(struct command_cell *cell, const struct map_command *command)
{
	latch_store(&cell->latch, cell->copies, command, sizeof(*command));
}

static struct map_command command_of(const struct map *map, const struct map_request *request,
				     enum map_command_state state, enum map_command_result result)
{
	return (struct map_command){
	    .state = (uint8_t)state,
	    .result = (uint8_t)result,
	    .requester = request->requester,
	    .id = request->id,
	    .session = request->session,
	    .generation = atomic_load(&map->segments[request->requester].header->generation),
	    .value = request->value,
	    .pulse_ms = request->pulse_ms,
	    .step = request->step,
	    .time_ns = map_now_ns(),
	};
}

/* The process that asked has not been replaced by another since. */
static bool requester_is_there(const struct map *map, const struct map_command *command)
{
	return command->generation == atomic_load(&map->segments[command->requester].header->generation);
}

static bool same_requester(const struct map *map, const struct map_command *command,
			   const struct map_request *request)
{
	return command->requester == request->requester && command->session == request->session &&
	       requester_is_there(map, command);
}

static bool is_selected(const struct map *map, const struct map_command *command)
{
	return command->state == MAP_ACCEPTED_SELECTION && map_now_ns() <= command->until_ns &&
	       requester_is_there(map, command);
}

static bool same_command(const struct map_command *command, const struct map_request *request)
{
	return command->value.u == request->value.u && command->pulse_ms == request->pulse_ms &&
	       command->step == request->step;
}

/* What the request is refused for, before the point is touched. */
static enum map_command_result objection(const struct map *map, const struct map_command *command,
					 const struct map_request *request)
{
	bool selected = is_selected(map, command), same = same_requester(map, command, request);

	if (map_now_ns() > request->deadline_ns)
		return MAP_RESULT_TOO_OLD;
	if (command->state == MAP_EXECUTING || command->off_ns != 0 || (selected && !same))
		return MAP_RESULT_INTERLOCK;
	if (request->action != MAP_EXECUTE)
		return MAP_RESULT_NONE;
	if (selected && !same_command(command, request))
		return MAP_RESULT_NOT_SELECTED;
	if (!selected && (map->config.points[request->point].flags & MAP_POINT_SELECT))
		return MAP_RESULT_NOT_SELECTED;
	return MAP_RESULT_NONE;
}

void map_command_refuse(struct map *map, const struct map_request *request, enum map_command_result result)
{
	enum map_command_state state =
	    request->action == MAP_EXECUTE ? MAP_REFUSED_COMMAND : MAP_REFUSED_SELECTION;
	struct map_command refusal = command_of(map, request, state, result);

	answer(map, &refusal, request->point, request->action);
}

static void move(struct map *map, struct command_cell *cell, const struct map_request *request,
		 enum map_command_state state, enum map_command_result result)
{
	struct map_command command = command_of(map, request, state, result);

	if (state == MAP_ACCEPTED_SELECTION)
		command.until_ns = command.time_ns + map_select_timeout_s(map) * NS_PER_S;
	store(cell, &command);
	answer(map, &command, request->point, request->action);
}

static void select_point(struct map *map, struct command_cell *cell, const struct map_request *request)
{
	struct map_command command = current(cell);
	enum map_command_result result = objection(map, &command, request);

	if (result != MAP_RESULT_NONE)
		map_command_refuse(map, request, result);
	else
		move(map, cell, request, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
}

static void cancel_selection(struct map *map, struct command_cell *cell, const struct map_request *request)
{
	struct map_command command = current(cell);

	if (is_selected(map, &command) && same_requester(map, &command, request))
		move(map, cell, request, MAP_INTERRUPTED_SELECTION, MAP_RESULT_DONE);
	else
		map_command_refuse(map, request, MAP_RESULT_NOT_SELECTED);
}

static bool execute(struct map *map, struct command_cell *cell, const struct map_request *request)
{
	struct map_command command = current(cell);
	enum map_command_result result = objection(map, &command, request);

	if (result == MAP_RESULT_NONE) {
		move(map, cell, request, MAP_EXECUTING, MAP_RESULT_NONE);
		return true;
	}
	/* A selection is good for one execution as selected; anything else of its holder ends it. */
	if (is_selected(map, &command) && same_requester(map, &command, request))
		move(map, cell, request, MAP_REFUSED_COMMAND, result);
	else
		map_command_refuse(map, request, result);
	return false;
}

static void release(const struct map *map, struct command_cell *cell, const struct map_request *request)
{
	struct map_command command = current(cell);

	if (command.state == MAP_EXECUTING || !same_requester(map, &command, request))
		return;
	command.state = MAP_INACTIVE;
	command.time_ns = map_now_ns();
	store(cell, &command);
}

void map_request_answer(struct map *map, const struct map_request *request, enum map_command_result result)
{
	struct map_command end = command_of(
	    map, request, result == MAP_RESULT_DONE ? MAP_EXECUTED_COMMAND : MAP_REFUSED_COMMAND, result);

	answer(map, &end, request->point, (enum map_action)request->action);
}

/* What the owner does at once, without the device. */
static void carry_out(struct map *map, const struct map_request *request)
{
	enum map_command_result result = MAP_RESULT_DONE;

	if (map_now_ns() > request->deadline_ns)
		result = MAP_RESULT_TOO_OLD;
	else if (request->action == MAP_FREEZE ? !totals_freeze(map, request) : !parameter_load(map, request))
		result = MAP_RESULT_OUT_OF_RANGE;
	map_request_answer(map, request, result);
}

bool map_command_request(struct map *map, const struct map_request *request)
{
	struct command_cell *cell;

	if (request->action == MAP_FREEZE || request->action == MAP_PARAMETER) {
		carry_out(map, request);
		return false;
	}
	if (!(map->config.points[request->point].flags & MAP_POINT_COMMAND)) {
		if (request->action != MAP_RELEASE)
			map_command_refuse(map, request, MAP_RESULT_NOT_COMMANDABLE);
		return false;
	}
	cell = own_cell(map, request->point);
	switch (request->action) {
	case MAP_SELECT:
		select_point(map, cell, request);
		return false;
	case MAP_EXECUTE:
		return execute(map, cell, request);
	case MAP_CANCEL:
		cancel_selection(map, cell, request);
		return false;
	case MAP_RELEASE:
		release(map, cell, request);
		return false;
	default:
		return false;
	}
}

void map_command_confirm(struct map *map, uint32_t point)
{
	struct command_cell *cell = own_cell(map, point);
	struct map_command command = current(cell);

	if (command.state != MAP_EXECUTING)
		return;
	command.result = MAP_RESULT_DONE;
	command.time_ns = map_now_ns();
	store(cell, &command);
	answer(map, &command, point, MAP_EXECUTE);
}

void map_pulse_set_end(struct map *map, uint32_t point, int64_t off_ns)
{
	struct command_cell *cell = own_cell(map, point);
	struct map_command command = current(cell);

	command.off_ns = off_ns;
	store(cell, &command);
}

int64_t map_pulse_end(const struct map *map, uint32_t point)
{
	if (map_owner(map, point) != map->self || !(map->config.points[point].flags & MAP_POINT_COMMAND))
		return 0;
	return current(own_cell(map, point)).off_ns;
}

void map_command_finish(struct map *map, uint32_t point, enum map_command_result result, uint8_t detail)
{
	struct command_cell *cell = own_cell(map, point);
	struct map_command command = current(cell);

	if (command.state != MAP_EXECUTING)
		return;
	command.state = result == MAP_RESULT_DONE ? MAP_EXECUTED_COMMAND : MAP_REFUSED_COMMAND;
	command.result = (uint8_t)result;
	command.detail = detail;
	command.time_ns = map_now_ns();
	store(cell, &command);
	answer(map, &command, point, MAP_EXECUTE);
	command_log_end(map, point, &command);
}

/* A pulse that nobody knows to have begun is ended all the same: off is the safe end. */
static void recover_pulse(struct map_command *command)
{
	if (command->state == MAP_EXECUTING && command->pulse_ms != 0 && command->off_ns == 0)
		command->off_ns = map_now_ns();
}

/*
 * What was under way when the former generation died is never repeated, and nobody knows its fate, unless the device had
 * confirmed it and there was no pulse to end.
 */
static bool end_orphan(struct map_command *command)
{
	if (command->state == MAP_EXECUTING && command->result == MAP_RESULT_DONE && command->pulse_ms == 0) {
		command->state = MAP_EXECUTED_COMMAND;
	} else if (command->state == MAP_EXECUTING) {
		command->state = MAP_REFUSED_COMMAND;
		command->result = MAP_RESULT_UNKNOWN_FATE;
	} else if (command->state == MAP_ACCEPTED_SELECTION) {
		command->state = MAP_INTERRUPTED_SELECTION;
	} else {
		return false;
	}
	return true;
}

static void recover_command(struct command_cell *cell)
{
	unsigned whole = latch_whole_copy(&cell->latch);
	struct map_command command = cell->copies[whole];

	cell->copies[!whole] = command;
	recover_pulse(&command);
	if (!end_orphan(&command))
		return;
	command.time_ns = map_now_ns();
	store(cell, &command);
}

void commands_recover(struct map *map)
{
	for (uint32_t i = 0; i < map->modules[map->self].command_count; i++)
		recover_command(&map->segments[map->self].commands[i]);
}

enum map_cause map_cause_of(const struct map *map, const struct map_request *request)
{
	return map->modules[request->requester].plan.flags & MAP_IS_LOCAL ? MAP_RETURN_LOCAL
									  : MAP_RETURN_REMOTE;
}

/* ---- anyone ------------------------------------------------------------------------------ */

/* The owner notices the end of a selection with the next request only. */
static void end_selection(const struct map *map, struct map_command *command)
{
	if (command->state != MAP_ACCEPTED_SELECTION ||
	    (command->requester < map_module_count(map) && is_selected(map, command)))
		return;
	command->state = MAP_INTERRUPTED_SELECTION;
	if (is_past(map, command->until_ns))
		command->time_ns = command->until_ns;
}

/* It says nothing of its commands any more, and its next process, which does not go on with them, not yet. */
static bool has_ended(const struct map *map, uint32_t owner)
{
	const struct module_status *status = &map->directory->modules[owner];
	const struct segment_header *header = map->segments[owner].header;

	switch ((enum map_module_state)atomic_load(&status->state)) {
	case MAP_MODULE_DOWN:
	case MAP_MODULE_STOPPED:
		return true;
	case MAP_MODULE_STARTING:
		return atomic_load(&header->generation) != atomic_load(&status->generation) &&
		       atomic_load(&header->carried) == 0;
	case MAP_MODULE_RUNNING:
	case MAP_MODULE_SWITCHING:
		break;
	}
	return false;
}

bool map_command_read(const struct map *map, uint32_t point, struct map_command *out)
{
	const struct segment *segment = &map->segments[map_owner(map, point)];
	struct command_cell *cell;
	struct map_command command;

	if (!(map->config.points[point].flags & MAP_POINT_COMMAND)) {
		*out = (struct map_command){.state = MAP_INACTIVE};
		return true;
	}
	cell = &segment->commands[map->config.points[point].command];
	if (!latch_load(&cell->latch, cell->copies, &command, sizeof(command)))
		return false;
	*out = is_past(map, command.time_ns) ? command : (struct map_command){.state = MAP_INACTIVE};
	end_selection(map, out);
	if (has_ended(map, map_owner(map, point)))
		end_orphan(out);
	return true;
}
