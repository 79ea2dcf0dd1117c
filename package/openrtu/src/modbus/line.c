/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The line: what is made of what comes back, and when there is nothing more to wait for. */
#include "line_parts.h"
#include "map/time_ns.h"

#include <string.h>

/* ---- strays: bytes that belong to no answer -------------------------------------------------------- */

/* The device that owes this frame, or NULL. */
static struct modbus_device *find_debtor(struct modbus_line *line, const uint8_t *frame)
{
	for (uint32_t i = 0; i < line->device_count; i++)
		if (line->devices[i].unit == frame[0] &&
		    modbus_owes(&line->devices[i], frame[1] & (uint8_t)~MODBUS_EXCEPTION_BIT))
			return &line->devices[i];
	return NULL;
}

/* The strays are an answer that comes late. A device answers in order: it begins with what is under way only now. */
static void take_late_answer(struct modbus_line *line, struct modbus_device *device, int64_t now_ns)
{
	int64_t began_ns = line->last_byte_ns - (int64_t)line->strays * line->wire.char_ns;

	line->counters.late_answers++;
	modbus_tell_late(line, (uint32_t)(device - line->devices), modbus_sent_ns(device, line->received),
			 began_ns, now_ns);
	if (!modbus_was_in_time(device, began_ns, line->last_byte_ns) || line->state != MODBUS_WAITING ||
	    device != &line->devices[line->device])
		return;
	line->deadline_ns = later(line->deadline_ns, line->last_byte_ns + device->response_timeout_ns);
	device->trust_ns = later(device->trust_ns, line->deadline_ns + MODBUS_LATE_NS);
}

/* Nothing is awaited then that could be taken for it. A connection has no transceiver that hears itself. */
static bool is_echo_of_broadcast(const struct modbus_line *line)
{
	return !line->wire.connection && line->state != MODBUS_WAITING &&
	       line->request.unit == MODBUS_BROADCAST && line->strays == line->frame_length &&
	       memcmp(line->received, line->frame, line->frame_length) == 0;
}

static void forget_strays(struct modbus_line *line, size_t count)
{
	line->received_count -= count;
	line->strays -= count;
	memmove(line->received, line->received + count, line->received_count);
}

/* Of several late answers at once, all but the last. */
static void take_late_answers(struct modbus_line *line, int64_t now_ns)
{
	for (uint32_t i = 0; i < line->device_count; i++) {
		struct modbus_device *device = &line->devices[i];
		size_t length = modbus_owed_length(device, line->received, line->strays);

		if (length == 0 || length == line->strays || !modbus_crc_valid(line->received, length))
			continue;
		take_late_answer(line, device, now_ns);
		forget_strays(line, length);
		i = UINT32_MAX; /* the next one may be of any device */
	}
}

/* Counts the strays, which are one burst, and removes them. */
static void remove_strays(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_device *debtor;

	take_late_answers(line, now_ns);
	if (modbus_crc_valid(line->received, line->strays))
		modbus_connection_answered(line);
	if (!modbus_crc_valid(line->received, line->strays))
		line->counters.noise_bytes += (uint32_t)line->strays;
	else if (is_echo_of_broadcast(line))
		line->counters.echoes++;
	else if ((debtor = find_debtor(line, line->received)) != NULL)
		take_late_answer(line, debtor, now_ns);
	else if (line->state == MODBUS_WAITING)
		modbus_count_wrong_answer(line, line->received, line->strays - MODBUS_CRC_LENGTH, now_ns);
	else
		line->counters.unasked_frames++;
	forget_strays(line, line->strays);
}

/* ---- echoes and answers ------------------------------------------------------------------------------ */

static bool looks_like_its_answer(const struct modbus_line *line)
{
	return modbus_answer_judge(&line->request, line->frame, line->frame_length) == MODBUS_ANSWER;
}

/*
 * A line whose transceiver hears itself brings every request back before the answer. The answer to
 * functions 5, 6 and 22 looks the same, and that to a read of 17 to 24 bits at 0x03xx may: which of the two
 * it is, the reads before have shown. True when what was received is the echo, or may become it.
 */
static bool take_echo(struct modbus_line *line)
{
	struct modbus_device *device = &line->devices[line->device];

	if (line->wire.connection || line->echoed || line->received_count > line->frame_length ||
	    memcmp(line->received, line->frame, line->received_count) != 0)
		return false;
	if (line->received_count < line->frame_length)
		return device->echoes > 0;
	if (device->echoes == 0 && looks_like_its_answer(line))
		return false;
	line->echoed = true;
	device->echoes = MODBUS_ECHO_MEMORY;
	line->garbled = false;
	line->counters.echoes++;
	line->received_count = line->strays = 0;
	return true;
}

/* Searches what was received for the answer. True when it was there; what follows it is left over. */
static bool take_answer(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->device];

	while (line->strays < line->received_count) {
		const uint8_t *start = line->received + line->strays;
		enum modbus_verdict verdict =
		    modbus_answer_judge(&line->request, start, line->received_count - line->strays);

		if (verdict == MODBUS_INCOMPLETE)
			return false;
		if (verdict == MODBUS_ANSWER || verdict == MODBUS_EXCEPTION) {
			uint8_t frame[MODBUS_FRAME_MAX];
			bool is_exception = verdict == MODBUS_EXCEPTION;
			size_t length = is_exception ? 5 : modbus_answer_length(&line->request);

			memcpy(frame, start, length);
			if (line->strays > 0)
				remove_strays(line, now_ns);
			else if (modbus_is_read(line->request.function))
				modbus_learn_latency(device, device->counters.latency_us * NS_PER_US);
			line->received_count -= length;
			memmove(line->received, line->received + length, line->received_count);
			modbus_connection_answered(line);
			modbus_request_answered(line, frame, is_exception, now_ns);
			return true;
		}
		line->garbled |= verdict == MODBUS_GARBLED;
		line->strays++;
	}
	return false;
}

/* The bytes have ceased while an answer is awaited. */
static void burst_ended(struct modbus_line *line, int64_t now_ns)
{
	size_t begun = line->received_count - line->strays; /* of an answer */

	if (!modbus_crc_valid(line->received, line->received_count) && (line->garbled || begun >= 2)) {
		modbus_answer_garbled(line, now_ns);
		return;
	}
	/* Another's frame, or noise: the answer may still come (MODBUS over Serial Line, 2.4.1). */
	line->strays = line->received_count;
	remove_strays(line, now_ns);
}

/* Until when the line is known to be as it should, whether anybody has listened meanwhile or not. */
static int64_t heard_ns(const struct modbus_line *line)
{
	return later(line->last_byte_ns, line->listen_ns);
}

static bool is_bursting(const struct modbus_line *line, int64_t now_ns)
{
	return line->received_count > 0 && now_ns < heard_ns(line) + line->wire.gap_ns;
}

/* The end of an answer that begins at the very end of the response time. */
static int64_t last_moment(const struct modbus_line *line)
{
	return line->deadline_ns + (int64_t)modbus_answer_length(&line->request) * line->wire.char_ns +
	       line->wire.gap_ns;
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

/* ---- RTU frames -------------------------------------------------------------------------------------- */

static void keep_byte(struct modbus_line *line, uint8_t byte, int64_t now_ns)
{
	/* An answer is at most half of the buffer: what fills it are strays. */
	if (line->received_count == sizeof(line->received))
		remove_strays(line, now_ns);
	line->received[line->received_count++] = byte;
}

static void receive_byte(struct modbus_line *line, uint8_t byte, int64_t now_ns)
{
	bool first = line->received_count == 0;

	keep_byte(line, byte, now_ns);
	if (line->state != MODBUS_WAITING) {
		line->strays = line->received_count;
		if (now_ns >= line->silent_ns)
			line->restless_ns = now_ns;
		line->silent_ns = now_ns + MODBUS_GAP_NS;
		return;
	}
	if (first)
		line->devices[line->device].counters.latency_us =
		    (uint32_t)(later(now_ns - line->sent_ns, 0) / NS_PER_US);
	if (!take_echo(line))
		take_answer(line, now_ns);
}

/* It gave what it was asked for last, and owes nothing: what begins like its answer is that. */
static bool is_plain(const struct modbus_device *device)
{
	return !device->refusing && !device->inherited && device->unanswered_count == 0;
}

/*
 * Characters that must come before anything can be done with them. To look whether they are an exception costs a wake-up:
 * that of a plain device is taken as late as its answer would be.
 */
static size_t missing(const struct modbus_line *line)
{
	const struct modbus_device *device = &line->devices[line->device];
	size_t begun = line->received_count - line->strays;

	if (line->state != MODBUS_WAITING || begun == 0 || device->echoes > 0)
		return 0;
	return modbus_answer_missing(&line->request, line->received + line->strays, begun, !is_plain(device));
}

static bool receive(struct modbus_line *line, const uint8_t *bytes, size_t length, int64_t now_ns)
{
	size_t lacking;

	line->last_byte_ns = now_ns;
	for (size_t i = 0; i < length; i++)
		receive_byte(line, bytes[i], now_ns);
	lacking = missing(line);
	line->listen_ns = lacking > 0 ? now_ns + (int64_t)lacking * line->wire.char_ns : 0;
	return true;
}

static size_t build(struct modbus_line *line)
{
	return modbus_request_frame(&line->request, line->frame);
}

static void remember_unanswered(struct modbus_line *line)
{
	modbus_add_unanswered(&line->devices[line->device], &line->request, line->sent_ns);
}

static const struct modbus_framer rtu_framer = {.build = build,
						.receive = receive,
						.remember_unanswered = remember_unanswered,
						.rest_ns = MODBUS_GAP_NS,
						.answers_are_alike = true};

/* ---- the line ------------------------------------------------------------------------------------------ */

static void lose_all(struct modbus_line *line, int64_t now_ns)
{
	for (uint32_t i = 0; i < line->device_count; i++)
		modbus_device_died(line, i, now_ns);
	modbus_drop_commands(line);
}

void modbus_line_init(struct modbus_line *line)
{
	for (uint32_t i = 0; i < line->device_count; i++) {
		struct modbus_device *device = &line->devices[i];

		device->broadcast =
		    device->unit == MODBUS_BROADCAST && line->wire.framing == MODBUS_FRAMING_RTU;
		modbus_pause_begin(&device->pause, device->pause_ns);
		modbus_objects_sort(device->objects, device->object_count);
		modbus_replan(line, device);
	}
	line->state = MODBUS_CLOSED;
}

void modbus_line_open(struct modbus_line *line, int64_t now_ns)
{
	line->framer = line->wire.framing == MODBUS_FRAMING_TCP ? &modbus_tcp_framer : &rtu_framer;
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
	memset(line->overdue, 0, sizeof(line->overdue));
	line->last_byte_ns = now_ns - MODBUS_GAP_NS;
	line->turn = line->probe_turn = 0;
	line->probed_in_vain = line->scan_begun = line->scan_held = false;
	line->commands_in_row = line->due_in_row = 0;
	modbus_end(line, now_ns + line->framer->rest_ns, now_ns);
	if (line->wire.connection)
		modbus_connection_made(line, now_ns);
}

void modbus_line_close(struct modbus_line *line, int64_t now_ns)
{
	bool commanding = (line->state == MODBUS_WAITING && line->purpose == MODBUS_COMMAND) ||
			  line->state == MODBUS_TURNAROUND;

	if (line->state == MODBUS_WAITING)
		line->framer->remember_unanswered(line);
	line->state = MODBUS_CLOSED;
	line->connection.there = false;
	if (commanding)
		modbus_end_command(line, MODBUS_TIMED_OUT, 0);
	lose_all(line, now_ns);
}

/* Of a frame, whose end does not come any more. */
static void forget_beginning(struct modbus_line *line)
{
	line->stream_count = 0;
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
	    now_ns >= last_moment(line) + MODBUS_LATE_NS)
		modbus_request_timed_out(line, now_ns);
	return line->framer->receive(line, bytes, length, now_ns);
}

static size_t leave_idle(struct modbus_line *line, int64_t now_ns)
{
	if (now_ns >= line->silent_ns) {
		if (line->strays > 0)
			remove_strays(line, now_ns);
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
			return earlier(heard_ns(line) + line->wire.gap_ns, last_moment(line));
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
	output.deadline_ns = next_deadline(line, now_ns);
	output.listen_ns = line->listen_ns;
	return output;
}
