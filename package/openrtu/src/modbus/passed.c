/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Requests of somebody else's, which a line passes on as they are (line.h, "What is passed on"). */
#include <string.h>

#include "line_parts.h"
#include "map/time_ns.h"

#define HEAD_LENGTH    2 /* unit, function */
#define EXCEPTION_BODY 3
#define WHOLE          100 /* percent */

/* What is known of a function: MODBUS Application Protocol V1.1b3, 6. Lengths are of its request's body, unit and function included. */
struct function {
	bool reads;       /* it changes nothing */
	bool ends;        /* its answer has the fields of one to a request of the line's own */
	uint8_t length;   /* 0: it has none of its own, */
	uint8_t count_at; /* but the octet there says how many follow; 0: nobody knows */
};
static const struct function functions[] = {
    [MODBUS_READ_COILS] = {.reads = true, .ends = true, .length = 6},
    [MODBUS_READ_DISCRETE_INPUTS] = {.reads = true, .ends = true, .length = 6},
    [MODBUS_READ_HOLDING_REGISTERS] = {.reads = true, .ends = true, .length = 6},
    [MODBUS_READ_INPUT_REGISTERS] = {.reads = true, .ends = true, .length = 6},
    [MODBUS_WRITE_COIL] = {.ends = true, .length = 6},
    [MODBUS_WRITE_REGISTER] = {.ends = true, .length = 6},
    [MODBUS_READ_EXCEPTION_STATUS] = {.reads = true, .length = HEAD_LENGTH},
    [MODBUS_READ_EVENT_COUNTER] = {.reads = true, .length = HEAD_LENGTH},
    [MODBUS_READ_EVENT_LOG] = {.reads = true, .length = HEAD_LENGTH},
    [MODBUS_WRITE_COILS] = {.ends = true, .count_at = 6},
    [MODBUS_WRITE_REGISTERS] = {.ends = true, .count_at = 6},
    [MODBUS_REPORT_SERVER] = {.reads = true, .length = HEAD_LENGTH},
    [MODBUS_READ_FILE] = {.reads = true, .count_at = 2},
    [MODBUS_WRITE_FILE] = {.count_at = 2},
    [MODBUS_MASK_WRITE_REGISTER] = {.length = 8},
    [MODBUS_READ_AND_WRITE] = {.count_at = 10},
    [MODBUS_READ_FIFO] = {.reads = true, .length = 4},
};
static const struct function identification = {.reads = true,
					       .length = 5}; /* 6.21; else 43 carries anything */
static const struct function unknown;

static const struct function *function_of(const uint8_t *body, size_t length)
{
	if (body[1] == MODBUS_ENCAPSULATED && length > HEAD_LENGTH &&
	    body[HEAD_LENGTH] == MODBUS_IDENTIFICATION)
		return &identification;
	return body[1] < sizeof(functions) / sizeof(functions[0]) ? &functions[body[1]] : &unknown;
}

bool modbus_reads_only(const uint8_t *body, size_t length)
{
	return function_of(body, length)->reads;
}

bool modbus_is_whole(const uint8_t *body, size_t length)
{
	const struct function *function = function_of(body, length);

	if (function->count_at > 0)
		return length > function->count_at &&
		       length == function->count_at + 1u + body[function->count_at];
	if (function->length > 0)
		return length == function->length;
	return body[1] != MODBUS_ENCAPSULATED || length > HEAD_LENGTH; /* its type at least */
}

size_t modbus_put_body(const struct modbus_line *line, uint8_t *body)
{
	if (line->purpose != MODBUS_PASS)
		return modbus_request_body(&line->request, body);
	memcpy(body, line->passed.body, line->passed.length);
	return line->passed.length;
}

bool modbus_line_pass(struct modbus_line *line, const struct modbus_passed *passed)
{
	if (line->state == MODBUS_CLOSED || line->passing)
		return false;
	line->passed = *passed;
	line->passing = true;
	return true;
}

/* ---- whose turn it is ---------------------------------------------------------------------------------- */

int64_t modbus_pass_timeout(const struct modbus_line *line, const struct modbus_device *device)
{
	if (!device->alive || !modbus_reads_only(line->passed.body, line->passed.length))
		return device->response_timeout_ns;
	return modbus_identify_timeout(device);
}

/* Until the longest answer has come, of a device that is as quick as it has been. */
static int64_t longest_ns(const struct modbus_line *line, const struct modbus_device *device)
{
	const int64_t timeout_ns =
	    device->alive ? modbus_identify_timeout(device) : device->response_timeout_ns;

	return line->wire.before_ns + timeout_ns + line->wire.gap_ns +
	       (int64_t)(MODBUS_FRAME_MAX + line->passed.length) * line->wire.char_ns;
}

bool modbus_pass_is_under_way(const struct modbus_line *line)
{
	return line->state == MODBUS_WAITING && line->purpose == MODBUS_PASS;
}

/* What nobody polls shows by nothing but time that it owes no answer to who had the line before. */
static bool owes_nothing(const struct modbus_line *line, const struct modbus_device *device, int64_t now_ns)
{
	return now_ns >= device->trust_ns ||
	       (device->unanswered_count == 0 && !device->inherited &&
		(modbus_is_readable(device) || !line->framer->answers_are_alike));
}

bool modbus_may_pass(const struct modbus_line *line, int64_t now_ns)
{
	const struct modbus_device *device = &line->devices[line->passed.device];

	return line->passing && !modbus_pass_is_under_way(line) && now_ns >= line->pass_free_ns &&
	       now_ns >= modbus_surely_ready_ns(device) && owes_nothing(line, device, now_ns) &&
	       modbus_is_room(line, now_ns + longest_ns(line, device));
}

int64_t modbus_next_pass_ns(const struct modbus_line *line, int64_t now_ns)
{
	const struct modbus_device *device = &line->devices[line->passed.device];
	int64_t may_ns, old_ns;

	if (!line->passing || modbus_pass_is_under_way(line))
		return MODBUS_NEVER;
	may_ns = later(line->pass_free_ns, modbus_surely_ready_ns(device));
	if (!owes_nothing(line, device, now_ns))
		may_ns = later(may_ns, device->trust_ns);
	/* One that is too old ends with the next poll that asks for anything. */
	old_ns = later(line->passed.deadline_ns, now_ns) + 1;
	return may_ns > now_ns ? earlier(may_ns, old_ns) : old_ns;
}

bool modbus_pass_is_known(uint8_t function)
{
	return function_of((const uint8_t[]){0, function}, HEAD_LENGTH)->ends;
}

struct modbus_request modbus_passed_request(const struct modbus_passed *passed)
{
	const uint8_t *body = passed->body;
	struct modbus_request request = {.unit = body[0], .function = body[1]};

	if (modbus_pass_is_known(request.function) && passed->length >= HEAD_LENGTH + 2 * sizeof(uint16_t)) {
		request.address = modbus_register(body + HEAD_LENGTH, 0);
		request.count = request.values[0] = modbus_register(body + HEAD_LENGTH, 1);
	}
	return request;
}

/* ---- how it ends --------------------------------------------------------------------------------------- */

void modbus_pass_ended(struct modbus_line *line, enum modbus_result result, const uint8_t *body,
		       size_t length, int64_t now_ns)
{
	/* On a connection a request takes more than until its answer. */
	const int64_t until_ns = later(now_ns, line->silent_ns);

	if (!line->passing)
		return;
	line->passing = false;
	if (line->pass_share > 0 && (result == MODBUS_DONE || result == MODBUS_TIMED_OUT))
		line->pass_free_ns =
		    until_ns + (until_ns - begun_ns(line)) * (WHOLE - line->pass_share) / line->pass_share;
	line->events->passed(line->context, &line->passed, result, body, length, now_ns);
}

bool modbus_answers_pass(const struct modbus_line *line, const uint8_t *body, size_t length)
{
	if (length < HEAD_LENGTH || body[0] != line->passed.body[0])
		return false;
	return body[1] == line->passed.body[1] ||
	       (body[1] == (line->passed.body[1] | MODBUS_EXCEPTION_BIT) && length == EXCEPTION_BODY);
}
