/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The line: what is made of what comes back, and when there is nothing more to wait for. */
#include "line_parts.h"
#include "map/time_ns.h"

#include <string.h>

/* ---- waiting ------------------------------------------------------------------------------------------- */

/* The bytes have ceased while an answer is awaited. */
static void burst_ended(struct modbus_line *line, int64_t now_ns)
{
	size_t begun = line->received_count - line->strays; /* of an answer */

	if (modbus_pass_burst(line, now_ns))
		return;
	if (!modbus_crc_valid(line->received, line->received_count) && (line->garbled || begun >= 2)) {
		modbus_answer_garbled(line, now_ns);
		return;
	}
	/* Another's frame, or noise: the answer may still come (MODBUS over Serial Line, 2.4.1). */
	line->strays = line->received_count;
	modbus_remove_strays(line, now_ns);
}

/* Until when the line is known to be as it should, whether anybody has listened meanwhile or not. */
static int64_t heard_ns(const struct modbus_line *line)
{
	return later(line->last_byte_ns, line->listen_ns);
}

/* When what has begun to come has ceased, if nothing more comes; 0: nothing has begun. */
static int64_t burst_end(const struct modbus_line *line)
{
	if (line->ascii.begun)
		return line->last_byte_ns + MODBUS_ASCII_GAP_NS;
	return line->received_count > 0 ? heard_ns(line) + line->wire.gap_ns : 0;
}

static bool is_bursting(const struct modbus_line *line, int64_t now_ns)
{
	return now_ns < burst_end(line);
}

/* The end of an answer that begins at the very end of the response time. */
static int64_t last_moment(const struct modbus_line *line)
{
	const size_t most =
	    line->purpose == MODBUS_PASS ? MODBUS_FRAME_MAX : modbus_answer_length(&line->request);

	return line->deadline_ns + (int64_t)most * line->wire.char_ns +
	       (line->ascii.begun ? MODBUS_ASCII_GAPS_NS : line->wire.gap_ns);
}

static void await_answer(struct modbus_line *line, int64_t now_ns)
{
	if (line->received_count > 0 && !is_bursting(line, now_ns))
		burst_ended(line, now_ns);
	if (line->state != MODBUS_WAITING)
		return;
	if (now_ns >= last_moment(line) || (now_ns >= line->deadline_ns && !is_bursting(line, now_ns)))
		modbus_request_timed_out(line, now_ns);
}

static void await_turnaround(struct modbus_line *line, int64_t now_ns)
{
	if (now_ns < line->deadline_ns)
		return;
	modbus_end(line, later(now_ns, line->silent_ns), now_ns);
	modbus_end_command(line, MODBUS_DONE, 0);
}

static const struct modbus_framer *const framers[] = {[MODBUS_FRAMING_RTU] = &modbus_rtu_framer,
						      [MODBUS_FRAMING_TCP] = &modbus_tcp_framer,
						      [MODBUS_FRAMING_ASCII] = &modbus_ascii_framer};

/* ---- the line ------------------------------------------------------------------------------------------ */

static void lose_all(struct modbus_line *line, int64_t now_ns)
{
	for (uint32_t i = 0; i < line->device_count; i++)
		modbus_device_died(line, i, now_ns);
	modbus_drop_commands(line);
	modbus_pass_ended(line, MODBUS_NOT_SENT, NULL, 0, now_ns);
}

void modbus_line_init(struct modbus_line *line)
{
	for (uint32_t i = 0; i < line->device_count; i++) {
		struct modbus_device *device = &line->devices[i];

		device->broadcast =
		    device->unit == MODBUS_BROADCAST && line->wire.framing != MODBUS_FRAMING_TCP;
		modbus_pause_begin(&device->pause, device->pause_ns);
		modbus_objects_sort(device->objects, device->object_count);
		modbus_replan(line, device);
	}
	line->state = MODBUS_CLOSED;
}

void modbus_line_open(struct modbus_line *line, int64_t now_ns)
{
	line->framer = framers[line->wire.framing];
	for (uint32_t i = 0; i < line->device_count; i++) {
		line->devices[i].backoff_ns = 0;
		line->devices[i].timeout_ns = line->devices[i].slowest_ns = 0;
		line->devices[i].failures = 0;
		line->devices[i].next_probe_ns = line->devices[i].lone_probe_ns = now_ns;
		line->devices[i].inherited =
		    line->framer->answers_are_alike && modbus_is_readable(&line->devices[i]);
		line->devices[i].trust_ns =
		    later(line->devices[i].trust_ns,
			  now_ns + line->devices[i].response_timeout_ns + MODBUS_LATE_NS);
	}
	line->received_count = line->stream_count = 0;
	line->ascii.begun = false;
	memset(line->overdue, 0, sizeof(line->overdue));
	line->last_byte_ns = now_ns - MODBUS_GAP_NS;
	line->turn = line->probe_turn = 0;
	line->probed_in_vain = line->scan_begun = line->scan_held = false;
	line->commands_in_row = line->due_in_row = 0;
	line->kept_last = false;
	modbus_end(line, now_ns + line->framer->rest_ns, now_ns);
	if (line->wire.connection)
		modbus_connection_made(line, now_ns);
}

void modbus_line_close(struct modbus_line *line, int64_t now_ns)
{
	bool commanding = (line->state == MODBUS_WAITING && line->purpose == MODBUS_COMMAND) ||
			  line->state == MODBUS_TURNAROUND;
	const bool passing = modbus_pass_is_under_way(line);

	if (line->state == MODBUS_WAITING)
		line->framer->remember_unanswered(line);
	if (line->state == MODBUS_WAITING && line->purpose == MODBUS_IDENTIFY)
		modbus_identify_answered(line, NULL, false, now_ns);
	line->state = MODBUS_CLOSED;
	line->connection.there = false;
	if (passing)
		modbus_pass_ended(line, MODBUS_TIMED_OUT, NULL, 0, now_ns);
	if (commanding)
		modbus_end_command(line, MODBUS_TIMED_OUT, 0);
	lose_all(line, now_ns);
}

/* Of a frame, whose end does not come any more. */
static void forget_beginning(struct modbus_line *line)
{
	line->stream_count = 0;
	line->ascii.begun = false;
	line->received_count = line->strays = 0;
}

bool modbus_line_interrupted(struct modbus_line *line, int64_t now_ns)
{
	if (line->state == MODBUS_CLOSED || !modbus_connection_ended(line, now_ns))
		return false;
	if (line->state != MODBUS_IDLE)
		modbus_request_torn(line, now_ns);
	forget_beginning(line);
	return true;
}

void modbus_line_connected(struct modbus_line *line, int64_t now_ns)
{
	forget_beginning(line);
	memset(line->overdue, 0, sizeof(line->overdue));
	modbus_connection_made(line, now_ns);
}

bool modbus_line_is_due(const struct modbus_line *line, int64_t now_ns)
{
	return line->state == MODBUS_IDLE && now_ns >= line->silent_ns &&
	       modbus_is_anything_due(line, now_ns);
}

bool modbus_line_command(struct modbus_line *line, const struct modbus_command *command)
{
	if (line->state == MODBUS_CLOSED || line->command_count == line->command_capacity)
		return false;
	line->commands[line->command_count++] = *command;
	return true;
}

bool modbus_line_receive(struct modbus_line *line, const uint8_t *bytes, size_t length, int64_t now_ns)
{
	if (line->state == MODBUS_CLOSED || length == 0)
		return true;
	if (line->state == MODBUS_WAITING && line->purpose == MODBUS_SCAN &&
	    now_ns >= last_moment(line) + MODBUS_LATE_NS) {
		line->back_ns = now_ns;
		modbus_request_timed_out(line, now_ns);
	}
	return line->framer->receive(line, bytes, length, now_ns);
}

static size_t leave_idle(struct modbus_line *line, int64_t now_ns)
{
	if (now_ns >= line->silent_ns) {
		if (line->strays > 0)
			modbus_remove_strays(line, now_ns);
		return modbus_begin_next(line, now_ns);
	}
	if (now_ns >= line->restless_ns + MODBUS_BABBLE_NS) {
		line->restless_ns = now_ns;
		line->counters.stuck_s++;
		lose_all(line, now_ns);
	}
	return 0;
}

static int64_t next_deadline(const struct modbus_line *line, int64_t now_ns)
{
	switch (line->state) {
	case MODBUS_CLOSED:
		return MODBUS_NEVER;
	case MODBUS_IDLE:
		if (now_ns < line->silent_ns)
			return earlier(line->silent_ns, line->restless_ns + MODBUS_BABBLE_NS);
		return modbus_next_due(line, now_ns);
	case MODBUS_WAITING:
		if (is_bursting(line, now_ns))
			return earlier(burst_end(line), last_moment(line));
		return line->deadline_ns;
	case MODBUS_TURNAROUND:
		return line->deadline_ns;
	}
	return MODBUS_NEVER;
}

struct modbus_output modbus_line_poll(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_output output = {.frame = line->frame};

	if (line->state == MODBUS_WAITING)
		await_answer(line, now_ns);
	else if (line->state == MODBUS_TURNAROUND)
		await_turnaround(line, now_ns);
	if (line->state == MODBUS_IDLE)
		output.reconnect = modbus_connection_is_hung(line, now_ns);
	if (line->state == MODBUS_IDLE && !output.reconnect)
		output.length = leave_idle(line, now_ns);
	if (output.length > 0 && line->framer->encode != NULL) {
		output.frame = line->text;
		output.length = line->framer->encode(line, line->text);
	}
	output.deadline_ns = next_deadline(line, now_ns);
	output.listen_ns = line->listen_ns;
	return output;
}
