/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/modbus/commands.h"

#include <stddef.h>

#include "map/meaning.h"
#include "map/time_ns.h"
#include "modules/modbus/scaling.h"

static const struct map_point *point_of(const struct commands *commands, uint32_t point)
{
	return &map_config(commands->map)->points[point];
}

static const struct modbus_point *wire_of(const struct commands *commands, uint32_t point)
{
	return &modbus_points(map_config(commands->map))[point];
}

/* As its commands have it. */
static struct modbus_point written(const struct commands *commands, uint32_t point)
{
	return modbus_written(map_config(commands->map), wire_of(commands, point));
}

static uint8_t unit_of(const struct commands *commands, uint32_t point)
{
	return modbus_slaves(map_config(commands->map))[point_of(commands, point)->set].unit;
}

static bool is_broadcast(const struct commands *commands, uint32_t point)
{
	return modbus_is_broadcast(map_config(commands->map), point_of(commands, point)->set);
}

static struct commands_progress *find(const struct commands *commands, uint32_t point)
{
	for (uint32_t i = 0; i < commands->count; i++)
		if (commands->progress[i].point == point)
			return &commands->progress[i];
	return NULL;
}

static void remove_progress(struct commands *commands, struct commands_progress *progress)
{
	*progress = commands->progress[--commands->count];
}

static void take(struct commands *commands, const struct map_request *request);

/* ---- ends -------------------------------------------------------------------------------- */

static enum map_command_result map_result(enum modbus_result result)
{
	switch (result) {
	case MODBUS_DONE:
		return MAP_RESULT_DONE;
	case MODBUS_REFUSED:
		return MAP_RESULT_EXCEPTION;
	case MODBUS_TOO_OLD:
		return MAP_RESULT_TOO_OLD;
	case MODBUS_TIMED_OUT:
	case MODBUS_NOT_SENT:
		break;
	}
	return MAP_RESULT_TIMEOUT;
}

static void take_held(struct commands *commands, uint32_t point)
{
	for (uint32_t i = 0; i < commands->held_count; i++) {
		const struct map_request request = commands->held[i];

		if (request.point != point)
			continue;
		commands->held[i] = commands->held[--commands->held_count];
		take(commands, &request);
		return;
	}
}

static void finish(struct commands *commands, struct commands_progress *progress,
		   enum map_command_result result, uint8_t exception)
{
	uint32_t point = progress->point;

	map_command_finish(commands->map, point, result, exception);
	remove_progress(commands, progress);
	take_held(commands, point);
}

/* The requester learns of the first failure; the coil stays to be switched off, at the pace of a dead device's probes. */
static void postpone_end(struct commands *commands, struct commands_progress *progress,
			 enum map_command_result result, uint8_t exception, int64_t now_ns)
{
	char name[MAP_NAME_SIZE];

	map_point_name(map_config(commands->map), point_of(commands, progress->point), name);
	if (progress->backoff_ns == 0)
		map_log(commands->map, MAP_LOG_ERROR, "%s: cannot end its pulse: %s; trying again", name,
			map_command_result_name(result));
	if (!progress->reported)
		map_command_finish(commands->map, progress->point, result, exception);
	progress->reported = true;
	progress->phase = COMMANDS_PULSE;
	progress->backoff_ns = modbus_next_backoff(progress->backoff_ns);
	progress->due_ns = now_ns + progress->backoff_ns;
}

static void begin_read_back(struct commands_progress *progress, int64_t now_ns)
{
	progress->phase = COMMANDS_READ_BACK;
	progress->due_ns = now_ns + COMMANDS_READ_BACK_NS;
}

/* Nobody waits for the read: the command has ended, and the point takes the next one. */
static void leave_to_polling(struct commands *commands, struct commands_progress *progress, int64_t now_ns)
{
	progress->phase = COMMANDS_READ_LATER;
	progress->due_ns = now_ns + COMMANDS_READ_LATER_NS;
	map_command_finish(commands->map, progress->point, MAP_RESULT_DONE, 0);
}

static void await_return(struct commands *commands, struct commands_progress *progress, int64_t now_ns)
{
	progress->unseen = true;
	if (is_broadcast(commands, progress->point))
		finish(commands, progress, MAP_RESULT_SENT, 0);
	else if (point_of(commands, progress->point)->flags & MAP_POINT_NEVER_READ)
		finish(commands, progress, MAP_RESULT_DONE, 0);
	else if (wire_of(commands, progress->point)->flags & MODBUS_NO_READ_BACK)
		leave_to_polling(commands, progress, now_ns);
	else
		begin_read_back(progress, now_ns);
}

/* ---- writes ------------------------------------------------------------------------------ */

static bool write_next(struct commands *commands, const struct commands_progress *progress,
		       int64_t deadline_ns)
{
	return commands->write(commands->context, progress->point,
			       &progress->operation.writes[progress->next], deadline_ns);
}

static void end_pulse(struct commands *commands, struct commands_progress *progress, int64_t now_ns)
{
	uint32_t point = progress->point;
	const struct modbus_point wire = written(commands, point);

	operation_end(&wire, unit_of(commands, point), &progress->operation);
	progress->phase = COMMANDS_ENDING;
	progress->next = 0;
	if (!write_next(commands, progress, MODBUS_NEVER))
		postpone_end(commands, progress, MAP_RESULT_TIMEOUT, 0, now_ns);
}

/* The end is in the map before anybody hears of the beginning: whatever happens now, the pulse ends. */
static void begin_pulse(struct commands *commands, struct commands_progress *progress, int64_t now_ns)
{
	progress->phase = COMMANDS_PULSE;
	progress->due_ns = now_ns + progress->pulse_ms * NS_PER_MS;
	map_pulse_set_end(commands->map, progress->point, progress->due_ns);
}

static void all_written(struct commands *commands, struct commands_progress *progress, int64_t now_ns)
{
	if (progress->phase == COMMANDS_WRITING && progress->pulse_ms != 0) {
		begin_pulse(commands, progress, now_ns);
		progress->unseen = true;
		map_command_confirm(commands->map, progress->point);
	} else if (progress->phase == COMMANDS_WRITING) {
		map_command_confirm(commands->map, progress->point);
		await_return(commands, progress, now_ns);
	} else {
		map_pulse_set_end(commands->map, progress->point, 0);
		if (progress->reported)
			remove_progress(commands, progress);
		else
			await_return(commands, progress, now_ns);
	}
}

/* Nobody knows whether an unanswered write has switched on: then there is a pulse to end. */
static void not_written(struct commands *commands, struct commands_progress *progress,
			enum modbus_result result, uint8_t exception, int64_t now_ns)
{
	const struct modbus_request *write = &progress->operation.writes[progress->next];

	if (progress->phase == COMMANDS_ENDING) {
		postpone_end(commands, progress, map_result(result), exception, now_ns);
		return;
	}
	if (progress->pulse_ms == 0 || result != MODBUS_TIMED_OUT ||
	    !operation_switches_on(wire_of(commands, progress->point), write)) {
		finish(commands, progress, map_result(result), exception);
		return;
	}
	begin_pulse(commands, progress, now_ns);
	map_command_finish(commands->map, progress->point, MAP_RESULT_TIMEOUT, 0);
	progress->reported = true;
}

/* Of the device's own word alone: it has certainly not carried it out. */
static bool is_unknown(enum modbus_result result, uint8_t exception)
{
	return result == MODBUS_REFUSED && exception == MODBUS_ILLEGAL_FUNCTION;
}

static void write_divided(struct commands *commands, struct commands_progress *progress, int64_t now_ns)
{
	if (!write_next(commands, progress, MODBUS_NEVER))
		not_written(commands, progress, MODBUS_NOT_SENT, 0, now_ns);
}

void commands_answered(struct commands *commands, uint32_t point, enum modbus_result result,
		       uint8_t exception, int64_t now_ns)
{
	struct commands_progress *progress = find(commands, point);

	if (progress == NULL)
		return;
	if (is_unknown(result, exception) && operation_divide(&progress->operation))
		write_divided(commands, progress, now_ns);
	else if (result != MODBUS_DONE)
		not_written(commands, progress, result, exception, now_ns);
	else if (++progress->next == progress->operation.count)
		all_written(commands, progress, now_ns);
	else if (!write_next(commands, progress, MODBUS_NEVER)) /* once begun, it is not too old */
		not_written(commands, progress, MODBUS_NOT_SENT, 0, now_ns);
}

/* ---- what begins ------------------------------------------------------------------------- */

/* In the place of the one before, if that is still to be seen. */
static void keep(struct commands *commands, const struct commands_progress *begun)
{
	struct commands_progress *before = find(commands, begun->point);

	*(before ? before : &commands->progress[commands->count++]) = *begun;
}

static void begin(struct commands *commands, const struct map_request *request)
{
	struct commands_progress begun = {.point = request->point,
					  .phase = COMMANDS_WRITING,
					  .cause = map_cause_of(commands->map, request),
					  .pulse_ms = request->pulse_ms};
	struct modbus_point wire = written(commands, request->point);
	const int8_t exponent =
	    scaling_apply(commands->map, request->point, commands->exponents[request->point], &wire,
			  (struct scaling_read){NULL, 0});
	/* Not what it is forced to: a step goes from where the device is. */
	const struct map_sample last = map_own_sample(commands->map, request->point);
	enum map_command_result result;

	result = operation_begin(point_of(commands, request->point), &wire,
				 modbus_knots(map_config(commands->map)), exponent,
				 unit_of(commands, request->point), request, &last, &begun.operation);
	if (result == MAP_RESULT_NONE && request->step == 0 &&
	    !map_meaning_allows(map_config(commands->map), request->point, request->value))
		result = MAP_RESULT_OUT_OF_RANGE;
	if (result == MAP_RESULT_NONE && !write_next(commands, &begun, request->deadline_ns))
		result = MAP_RESULT_TIMEOUT;
	if (result == MAP_RESULT_NONE)
		keep(commands, &begun);
	else
		map_command_finish(commands->map, request->point, result, 0);
}

static void take(struct commands *commands, const struct map_request *request)
{
	if (map_command_request(commands->map, request))
		begin(commands, request);
}

static bool is_to_wait(const struct commands *commands, const struct map_request *request)
{
	const struct commands_progress *progress = find(commands, request->point);

	if ((request->action != MAP_EXECUTE && request->action != MAP_SELECT) || progress == NULL ||
	    progress->phase != COMMANDS_READ_BACK || commands->held_count == COMMANDS_HELD_MAX)
		return false;
	for (uint32_t i = 0; i < commands->held_count; i++)
		if (commands->held[i].point == request->point)
			return false;
	return true;
}

void commands_request(struct commands *commands, const struct map_request *request)
{
	if (is_to_wait(commands, request))
		commands->held[commands->held_count++] = *request;
	else
		take(commands, request);
}

void commands_resume(struct commands *commands)
{
	const struct map_config *config = map_config(commands->map);

	for (uint32_t i = 0; i < config->point_count; i++) {
		int64_t off_ns = map_pulse_end(commands->map, i);
		char name[MAP_NAME_SIZE];

		if (off_ns == 0)
			continue;
		map_point_name(config, &config->points[i], name);
		map_log(commands->map, MAP_LOG_WARNING, "%s: ends its pulse after a restart", name);
		commands->progress[commands->count++] = (struct commands_progress){
		    .point = i, .phase = COMMANDS_PULSE, .reported = true, .due_ns = off_ns};
	}
}

/* ---- read-back --------------------------------------------------------------------------- */

enum map_cause commands_cause(const struct commands *commands, uint32_t point)
{
	const struct commands_progress *progress = find(commands, point);

	return progress != NULL && progress->unseen ? progress->cause : MAP_SPONTANEOUS;
}

void commands_published(struct commands *commands, uint32_t point)
{
	struct commands_progress *progress = find(commands, point);

	if (progress == NULL)
		return;
	progress->unseen = false;
	if (progress->phase == COMMANDS_READ_BACK)
		finish(commands, progress, MAP_RESULT_DONE, 0);
	else if (progress->phase == COMMANDS_READ_LATER)
		remove_progress(commands, progress);
}

static bool is_to_be_read(const struct commands_progress *progress)
{
	return progress->phase == COMMANDS_READ_BACK || progress->phase == COMMANDS_READ_LATER;
}

/* A device that is dead again will not be read, and one that is back takes the end of its pulses at once. */
void commands_device_changed(struct commands *commands, uint32_t device, bool alive, int64_t now_ns)
{
	for (uint32_t i = 0; i < commands->count; i++) {
		struct commands_progress *progress = &commands->progress[i];

		if (point_of(commands, progress->point)->set != device)
			continue;
		if (alive ? progress->phase == COMMANDS_PULSE && progress->backoff_ns != 0
			  : is_to_be_read(progress))
			progress->due_ns = now_ns;
	}
}

bool commands_end_pulses(struct commands *commands, int64_t now_ns)
{
	bool any = false;

	for (uint32_t i = 0; i < commands->count; i++) {
		struct commands_progress *progress = &commands->progress[i];

		if (progress->phase == COMMANDS_PULSE && progress->backoff_ns == 0)
			progress->due_ns = now_ns;
		any |= progress->phase == COMMANDS_PULSE || progress->phase == COMMANDS_ENDING;
	}
	return any;
}

/* ---- time -------------------------------------------------------------------------------- */

static bool is_timed(const struct commands_progress *progress)
{
	return progress->phase == COMMANDS_PULSE || is_to_be_read(progress);
}

void commands_run(struct commands *commands, int64_t now_ns)
{
	for (uint32_t i = commands->count; i-- > 0;) {
		struct commands_progress *progress = &commands->progress[i];

		if (!is_timed(progress) || now_ns < progress->due_ns)
			continue;
		if (progress->phase == COMMANDS_PULSE)
			end_pulse(commands, progress, now_ns);
		else if (progress->phase == COMMANDS_READ_LATER)
			remove_progress(commands, progress);
		else
			finish(commands, progress, MAP_RESULT_DONE, 0);
	}
}

int64_t commands_deadline(const struct commands *commands)
{
	int64_t deadline = INT64_MAX;

	for (uint32_t i = 0; i < commands->count; i++)
		if (is_timed(&commands->progress[i]) && commands->progress[i].due_ns < deadline)
			deadline = commands->progress[i].due_ns;
	return deadline;
}
