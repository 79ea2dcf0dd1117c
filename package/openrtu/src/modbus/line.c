/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "line.h"

#include <string.h>

#define NS_PER_US 1000
#define BITS_STEP 8 /* bits that make an answer one byte longer */

/* MODBUS Application Protocol V1.1b3, 7. */
#define LAST_LASTING_EXCEPTION 4 /* 1..4 concern what was asked; 5, 6 ... the moment */

static int64_t later(int64_t a, int64_t b)
{
	return a > b ? a : b;
}

static int64_t earlier(int64_t a, int64_t b)
{
	return a < b ? a : b;
}

int64_t modbus_next_backoff(int64_t backoff_ns)
{
	return earlier(later(2 * backoff_ns, MODBUS_FIRST_PROBE_NS), MODBUS_RAREST_PROBE_NS);
}

static bool is_readable(const struct modbus_device *device)
{
	return device->unit != MODBUS_BROADCAST && device->object_count > 0;
}

/* ---- what is unanswered (line.h, "Late answers") -------------------------------------------- */

static uint16_t answer_bytes(const struct modbus_request *request)
{
	return modbus_is_read(request->function) ? modbus_read_bytes(request->function, request->count) : 0;
}

static void add_unanswered(struct modbus_device *device, const struct modbus_request *request,
			   int64_t sent_ns)
{
	device->trust_ns = later(device->trust_ns, sent_ns + device->response_timeout_ns + MODBUS_LATE_NS);
	if (device->unanswered_count < MODBUS_UNANSWERED_MAX)
		device->unanswered[device->unanswered_count++] =
		    (struct modbus_unanswered){request->function, answer_bytes(request)};
}

static void forget_unanswered(struct modbus_device *device, int64_t now_ns)
{
	if (now_ns < device->trust_ns)
		return;
	device->unanswered_count = 0;
	device->inherited = false;
}

/* Its answers may be off by one: only time helps. */
static void distrust_everything(struct modbus_device *device, int64_t now_ns)
{
	device->unanswered_count = MODBUS_UNANSWERED_MAX;
	device->trust_ns = later(device->trust_ns, now_ns + MODBUS_LATE_NS);
}

/* An exception names its function only, a write's echo may equal an older one: the function decides. */
static bool owes(const struct modbus_device *device, uint8_t function)
{
	if (device->inherited || device->unanswered_count == MODBUS_UNANSWERED_MAX)
		return true;
	for (uint8_t i = 0; i < device->unanswered_count; i++)
		if (device->unanswered[i].function == function)
			return true;
	return false;
}

/*
 * After an answer: a device answers in order, so what was asked before this request has no answer any
 * more.
 */
static void settle_unanswered(struct modbus_device *device, const struct modbus_request *request,
			      bool is_exception, int64_t sent_ns, int64_t now_ns)
{
	if (is_exception && owes(device, request->function)) {
		distrust_everything(device, now_ns);
	} else if (device->inherited) {
		/*
		 * It may have been the answer to an inherited request: then that to this one is still
		 * to come.
		 */
		device->inherited = false;
		add_unanswered(device, request, sent_ns);
	} else {
		device->unanswered_count = 0;
	}
}

/* No missing answer looks like the positive answer to this read. */
static bool is_unmistakable(const struct modbus_device *device, const struct modbus_request *request)
{
	if (device->unanswered_count == MODBUS_UNANSWERED_MAX)
		return false;
	for (uint8_t i = 0; i < device->unanswered_count; i++)
		if (device->unanswered[i].function == request->function &&
		    device->unanswered[i].bytes == answer_bytes(request))
			return false;
	return true;
}

/*
 * One short read with an unmistakable answer: of a single object, or, where all objects are alike, of
 * something longer; even the refusal of that shows that the device lives.
 */
static bool find_probe(const struct modbus_device *device, struct modbus_request *request)
{
	for (unsigned longer = 0; longer <= MODBUS_UNANSWERED_MAX; longer++) {
		for (uint32_t i = 0; i < device->object_count; i++) {
			const struct modbus_object *object = &device->objects[i];
			unsigned step = modbus_is_bit_function(object->function) ? BITS_STEP : 1;

			*request =
			    (struct modbus_request){.unit = device->unit,
						    .function = object->function,
						    .address = object->address,
						    .count = (uint16_t)(object->width + longer * step)};
			if (request->address + (uint32_t)request->count <= UINT16_MAX + 1u &&
			    is_unmistakable(device, request))
				return true;
		}
	}
	return false;
}

/* ---- life and death of a device --------------------------------------------------------------- */

static void replan(struct modbus_line *line, struct modbus_device *device)
{
	device->read_count = is_readable(device) ? modbus_plan(&line->wire, device->objects,
							       device->object_count, device->reads)
						 : 0;
	device->cursor = 0;
}

/*
 * The device lives but does not give this read (exception 0: it is silent). Halves it, since one object
 * that the device does not have, or a hole, spoils it for all. A single object, or what a busy device
 * does not give now, is asked for ever more rarely. True when the read was halved.
 */
static bool refuse_read(struct modbus_line *line, uint32_t index, uint32_t read_index, uint8_t exception,
			int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];
	struct modbus_read *read = &device->reads[read_index];

	if (exception <= LAST_LASTING_EXCEPTION &&
	    modbus_plan_halve(device->objects, device->reads, &device->read_count, read_index))
		return true;
	if (read->pause_ns == 0 || read->exception != exception)
		line->events->refused(line->context, index, read, exception, now_ns);
	read->exception = exception;
	read->failures = 0;
	read->pause_ns = modbus_next_backoff(read->pause_ns);
	read->not_before_ns = now_ns + read->pause_ns;
	return false;
}

/* Reads that the device left unanswered again and again while it answered others. */
static void refuse_silent_reads(struct modbus_line *line, uint32_t index, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];

	for (uint32_t read = device->read_count; read-- > 0;)
		if (device->reads[read].failures > device->retries &&
		    device->reads[read].failures >= MODBUS_SILENT_READS)
			refuse_read(line, index, read, 0, now_ns);
}

static void device_answered(struct modbus_line *line, uint32_t index, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];
	bool was_gone = device->backoff_ns > MODBUS_FIRST_PROBE_NS;

	device->failures = 0;
	device->backoff_ns = 0;
	refuse_silent_reads(line, index, now_ns);
	if (device->alive || !is_readable(device))
		return;
	/* It may be another one that now has this address, and refuse other things. */
	if (was_gone)
		replan(line, device);
	device->alive = true;
	device->cursor = 0;
	line->events->alive(line->context, index, true, now_ns);
}

static void set_backoff(struct modbus_device *device, int64_t backoff_ns, int64_t now_ns)
{
	device->backoff_ns = backoff_ns;
	device->next_probe_ns = now_ns + backoff_ns;
}

static void device_died(struct modbus_line *line, uint32_t index, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];

	if (!device->alive)
		return;
	device->alive = false;
	set_backoff(device, MODBUS_FIRST_PROBE_NS, now_ns);
	line->events->alive(line->context, index, false, now_ns);
}

static void device_silent(struct modbus_line *line, uint32_t index, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];

	device->failures++;
	if (!device->alive && line->purpose == MODBUS_PROBE) {
		set_backoff(device, modbus_next_backoff(device->backoff_ns), now_ns);
		line->probed_in_vain = true;
	} else if (device->failures > device->retries) {
		device_died(line, index, now_ns);
	}
}

/* ---- commands ------------------------------------------------------------------------------------ */

static struct modbus_command take_command(struct modbus_line *line, uint32_t place)
{
	struct modbus_command command = line->commands[place];

	line->command_count--;
	memmove(&line->commands[place], &line->commands[place + 1],
		(line->command_count - place) * sizeof(command));
	return command;
}

static void drop_commands(struct modbus_line *line)
{
	while (line->command_count > 0) {
		struct modbus_command command = take_command(line, 0);

		line->events->command(line->context, &command, MODBUS_NOT_SENT, 0);
	}
}

static void drop_old_commands(struct modbus_line *line, int64_t now_ns)
{
	for (uint32_t place = 0; place < line->command_count;) {
		if (now_ns <= line->commands[place].deadline_ns) {
			place++;
			continue;
		}
		struct modbus_command command = take_command(line, place);
		line->events->command(line->context, &command, MODBUS_TOO_OLD, 0);
	}
}

static uint8_t function_that_reads(uint8_t write_function)
{
	return modbus_is_bit_function(write_function) ? MODBUS_READ_COILS : MODBUS_READ_HOLDING_REGISTERS;
}

static void mark_urgent(struct modbus_device *device, const struct modbus_request *written)
{
	for (uint32_t i = 0; i < device->read_count; i++) {
		struct modbus_read *read = &device->reads[i];

		if (read->function == function_that_reads(written->function) &&
		    written->address >= read->address &&
		    written->address < (uint32_t)read->address + read->count)
			read->urgent = true;
	}
}

/*
 * What was written is read back soon, so that the change is seen; a broadcast may have changed every
 * device.
 */
static void read_back(struct modbus_line *line, const struct modbus_command *command)
{
	line->urgent = true;
	if (command->request.unit != MODBUS_BROADCAST) {
		mark_urgent(&line->devices[command->device], &command->request);
		return;
	}
	for (uint32_t i = 0; i < line->device_count; i++)
		mark_urgent(&line->devices[i], &command->request);
}

static void end_command(struct modbus_line *line, enum modbus_result result, uint8_t exception)
{
	if (result == MODBUS_DONE)
		read_back(line, &line->command);
	line->events->command(line->context, &line->command, result, exception);
}

/* ---- strays: bytes that belong to no answer -------------------------------------------------------- */

static bool is_late_answer(const struct modbus_line *line, const uint8_t *frame)
{
	for (uint32_t i = 0; i < line->device_count; i++)
		if (line->devices[i].unit == frame[0] &&
		    owes(&line->devices[i], frame[1] & (uint8_t)~MODBUS_EXCEPTION_BIT))
			return true;
	return false;
}

/* Counts the strays, which are one burst, and removes them. */
static void remove_strays(struct modbus_line *line)
{
	if (!modbus_crc_valid(line->received, line->strays)) {
		line->counters.noise_bytes += (uint32_t)line->strays;
	} else if (is_late_answer(line, line->received)) {
		line->counters.late_answers++;
	} else {
		line->counters.wrong_answers++;
		if (line->state == MODBUS_WAITING)
			line->devices[line->device].counters.errors++;
	}
	line->received_count -= line->strays;
	memmove(line->received, line->received + line->strays, line->received_count);
	line->strays = 0;
}

/* ---- transactions ------------------------------------------------------------------------------------ */

static size_t begin(struct modbus_line *line, enum modbus_purpose purpose, uint32_t index, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];
	size_t length = modbus_request_frame(&line->request, line->frame);
	bool broadcast = line->request.unit == MODBUS_BROADCAST;

	line->purpose = purpose;
	line->device = index;
	line->garbled = line->echoed = false;
	line->frame_length = length;
	line->sent_ns = now_ns + line->wire.turn_ns + (int64_t)length * line->wire.char_ns;
	line->state = broadcast ? MODBUS_TURNAROUND : MODBUS_WAITING;
	line->deadline_ns = line->sent_ns + (broadcast ? MODBUS_BROADCAST_NS : device->response_timeout_ns);
	line->counters.requests++;
	device->counters.requests++;
	return length;
}

static void end(struct modbus_line *line, int64_t silent_ns, int64_t now_ns)
{
	line->state = MODBUS_IDLE;
	line->strays = line->received_count;
	line->silent_ns = silent_ns;
	line->restless_ns = now_ns;
}

/* When the request under way was given to the port. */
static int64_t begun_ns(const struct modbus_line *line)
{
	return line->sent_ns - (int64_t)line->frame_length * line->wire.char_ns - line->wire.turn_ns;
}

static void serve_period(struct modbus_line *line, struct modbus_read *read)
{
	if (read->period_ns > 0)
		line->devices[line->device].counters.missed_periods +=
		    modbus_period_served(read, begun_ns(line));
}

static void read_answered(struct modbus_line *line, const uint8_t *data, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->device];
	struct modbus_read *read = &device->reads[line->read];
	bool recovered = read->pause_ns > 0;

	read->failures = 0;
	read->pause_ns = 0;
	if (line->read == device->cursor)
		device->cursor++;
	serve_period(line, read);
	line->scan_ended_ns = now_ns;
	line->events->read(line->context, line->device, read, data, now_ns);
	/* What the device refused it gives now: what was halved for it may be whole again. */
	if (recovered)
		replan(line, device);
}

static void read_refused(struct modbus_line *line, uint8_t exception, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->device];

	line->scan_ended_ns = now_ns;
	if (refuse_read(line, line->device, line->read, exception, now_ns))
		return;
	serve_period(line, &device->reads[line->read]);
	if (line->read == device->cursor)
		device->cursor++;
}

static void count_answer(struct modbus_line *line, bool exception)
{
	struct modbus_device_counters *device = &line->devices[line->device].counters;

	line->counters.answers++;
	device->answers++;
	line->counters.exceptions += exception;
	device->exceptions += exception;
}

/* frame: the answer, of which everything before the CRC has been checked against the request. */
static void request_answered(struct modbus_line *line, const uint8_t *frame, bool is_exception,
			     int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->device];
	uint8_t exception = is_exception ? frame[2] : 0;

	count_answer(line, is_exception);
	modbus_histogram_add(&line->counters.transactions, now_ns - begun_ns(line));
	if (modbus_is_read(line->request.function) && !line->echoed && device->echoes > 0)
		device->echoes--;
	settle_unanswered(device, &line->request, is_exception, line->sent_ns, now_ns);

	if (line->purpose == MODBUS_COMMAND)
		end_command(line, is_exception ? MODBUS_REFUSED : MODBUS_DONE, exception);
	else if (line->purpose == MODBUS_SCAN && is_exception)
		read_refused(line, exception, now_ns);
	else if (line->purpose == MODBUS_SCAN)
		read_answered(line, frame + 3, now_ns);
	device_answered(line, line->device, now_ns);
}

static void request_unanswered(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->device];

	add_unanswered(device, &line->request, line->sent_ns);
	end(line, later(now_ns, line->last_byte_ns + MODBUS_GAP_NS), now_ns);
	if (line->purpose == MODBUS_COMMAND)
		end_command(line, MODBUS_TIMED_OUT, 0);
	else if (line->purpose == MODBUS_SCAN)
		device->reads[line->read].failures++;
	device_silent(line, line->device, now_ns);
}

static void garbled(struct modbus_line *line, int64_t now_ns)
{
	line->counters.crc_errors++;
	line->devices[line->device].counters.errors++;
	line->received_count = line->strays = 0;
	request_unanswered(line, now_ns);
}

static void timed_out(struct modbus_line *line, int64_t now_ns)
{
	line->counters.timeouts++;
	line->devices[line->device].counters.timeouts++;
	request_unanswered(line, now_ns);
}

static bool looks_like_its_answer(const struct modbus_line *line)
{
	return modbus_answer_judge(&line->request, line->frame, line->frame_length) == MODBUS_ANSWER;
}

/*
 * A line whose transceiver hears itself brings every request back before the answer. The answer to
 * functions 5 and 6 looks the same, and that to a read of 17 to 24 bits at 0x03xx may: which of the two
 * it is, the reads before have shown. True when what was received is the echo, or may become it.
 */
static bool take_echo(struct modbus_line *line)
{
	struct modbus_device *device = &line->devices[line->device];

	if (line->echoed || line->received_count > line->frame_length ||
	    memcmp(line->received, line->frame, line->received_count) != 0)
		return false;
	if (line->received_count < line->frame_length)
		return device->echoes > 0;
	if (device->echoes == 0 && looks_like_its_answer(line))
		return false;
	line->echoed = true;
	device->echoes = MODBUS_ECHO_MEMORY;
	line->garbled = false;
	line->counters.wrong_answers++;
	line->received_count = line->strays = 0;
	return true;
}

/* Searches what was received for the answer. True when it was there; what follows it is left over. */
static bool take_answer(struct modbus_line *line, int64_t now_ns)
{
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
				remove_strays(line);
			line->received_count -= length;
			memmove(line->received, line->received + length, line->received_count);
			end(line, later(now_ns, line->sent_ns) + line->wire.silence_ns, now_ns);
			request_answered(line, frame, is_exception, now_ns);
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
		garbled(line, now_ns);
		return;
	}
	/* Another's frame, or noise: the answer may still come (MODBUS over Serial Line, 2.4.1). */
	line->strays = line->received_count;
	remove_strays(line);
}

/* Until when the line is known to be as it should, whether anybody has listened meanwhile or not. */
static int64_t heard_ns(const struct modbus_line *line)
{
	return later(line->last_byte_ns, line->listen_ns);
}

static bool is_bursting(const struct modbus_line *line, int64_t now_ns)
{
	return line->received_count > 0 && now_ns < heard_ns(line) + MODBUS_GAP_NS;
}

/* The end of an answer that begins at the very end of the response time. */
static int64_t last_moment(const struct modbus_line *line)
{
	return line->deadline_ns + (int64_t)modbus_answer_length(&line->request) * line->wire.char_ns +
	       MODBUS_GAP_NS;
}

static void await_answer(struct modbus_line *line, int64_t now_ns)
{
	if (line->received_count > 0 && !is_bursting(line, now_ns))
		burst_ended(line, now_ns);
	if (line->state != MODBUS_WAITING)
		return;
	if (now_ns >= last_moment(line) || (now_ns >= line->deadline_ns && !is_bursting(line, now_ns)))
		timed_out(line, now_ns);
}

static void await_turnaround(struct modbus_line *line, int64_t now_ns)
{
	if (now_ns < line->deadline_ns)
		return;
	end(line, later(now_ns, line->silent_ns), now_ns);
	end_command(line, MODBUS_DONE, 0);
}

/* ---- what comes next --------------------------------------------------------------------------------- */

static size_t begin_probe(struct modbus_line *line, uint32_t index, int64_t now_ns)
{
	if (!find_probe(&line->devices[index], &line->request))
		return 0;
	return begin(line, MODBUS_PROBE, index, now_ns);
}

static size_t begin_read(struct modbus_line *line, uint32_t index, uint32_t read_index, int64_t now_ns)
{
	const struct modbus_device *device = &line->devices[index];
	struct modbus_read *read = &device->reads[read_index];

	read->urgent = false;
	line->read = read_index;
	line->request = (struct modbus_request){
	    .unit = device->unit, .function = read->function, .address = read->address, .count = read->count};
	return begin(line, MODBUS_SCAN, index, now_ns);
}

static bool is_first_of_device(const struct modbus_line *line, uint32_t place)
{
	for (uint32_t i = 0; i < place; i++)
		if (line->commands[i].device == line->commands[place].device)
			return false;
	return true;
}

/* Commands of one device go in order; one that must wait for its device does not stop those of others. */
static size_t begin_command(struct modbus_line *line, int64_t now_ns)
{
	drop_old_commands(line, now_ns);
	for (uint32_t place = 0; place < line->command_count; place++) {
		uint32_t index = line->commands[place].device;
		struct modbus_device *device = &line->devices[index];
		size_t length = 0;

		if (!is_first_of_device(line, place))
			continue;
		forget_unanswered(device, now_ns);
		if (!owes(device, line->commands[place].request.function)) {
			line->command = take_command(line, place);
			line->request = line->command.request;
			line->counters.commands++;
			line->commands_in_row++;
			return begin(line, MODBUS_COMMAND, index, now_ns);
		}
		if (device->alive)
			length = begin_probe(line, index, now_ns);
		if (length > 0)
			return length;
	}
	return 0;
}

static size_t begin_urgent_read(struct modbus_line *line, int64_t now_ns)
{
	if (!line->urgent)
		return 0;
	for (uint32_t index = 0; index < line->device_count; index++) {
		struct modbus_device *device = &line->devices[index];

		forget_unanswered(device, now_ns);
		if (!device->alive || device->unanswered_count > 0)
			continue;
		for (uint32_t read = 0; read < device->read_count; read++)
			if (device->reads[read].urgent && device->reads[read].pause_ns == 0)
				return begin_read(line, index, read, now_ns);
	}
	line->urgent = false;
	return 0;
}

/* Of the reads that are due, the one whose deadline is first; of devices that owe an answer, or of the others. */
static bool find_due_read(struct modbus_line *line, bool owing, int64_t now_ns, uint32_t *index,
			  uint32_t *read)
{
	int64_t first_ns = MODBUS_NEVER;

	for (uint32_t i = 0; i < line->device_count; i++) {
		struct modbus_device *device = &line->devices[i];

		forget_unanswered(device, now_ns);
		if (!device->alive || (device->unanswered_count > 0) != owing)
			continue;
		if (owing && !find_probe(device, &line->request))
			continue;
		for (uint32_t j = 0; j < device->read_count; j++) {
			if (!modbus_period_due(&device->reads[j], now_ns) ||
			    modbus_period_deadline(&device->reads[j]) >= first_ns)
				continue;
			first_ns = modbus_period_deadline(&device->reads[j]);
			*index = i;
			*read = j;
		}
	}
	return first_ns != MODBUS_NEVER;
}

/* A device that owes an answer is probed before it is read, and behind the others: it may be dying. */
static size_t begin_due_read(struct modbus_line *line, int64_t now_ns)
{
	uint32_t index, read;
	size_t length = 0;

	if (find_due_read(line, false, now_ns, &index, &read))
		length = begin_read(line, index, read, now_ns);
	else if (find_due_read(line, true, now_ns, &index, &read))
		length = begin_probe(line, index, now_ns);
	line->due_in_row += length > 0;
	return length;
}

/* The next dead device whose probe is due, after the one that was probed last. */
static size_t begin_due_probe(struct modbus_line *line, int64_t now_ns)
{
	for (uint32_t tried = 0; tried < line->device_count; tried++) {
		uint32_t index = line->probe_turn;
		struct modbus_device *device = &line->devices[index];
		size_t length = 0;

		line->probe_turn = (line->probe_turn + 1) % line->device_count;
		forget_unanswered(device, now_ns);
		if (!device->alive && is_readable(device) && now_ns >= device->next_probe_ns)
			length = begin_probe(line, index, now_ns);
		if (length > 0)
			return length;
	}
	return 0;
}

static void next_turn(struct modbus_line *line)
{
	line->devices[line->turn].cursor = 0;
	if (++line->turn < line->device_count)
		return;
	line->turn = 0;
	line->probed_in_vain = false;
	if (line->scan_begun)
		line->counters.scan_us = (uint32_t)((line->scan_ended_ns - line->scan_began_ns) / NS_PER_US);
	line->scan_begun = false;
}

static bool is_of_scan(const struct modbus_read *read, int64_t now_ns)
{
	return read->period_ns == 0 && (read->pause_ns == 0 || now_ns >= read->not_before_ns);
}

/* The next read of the device whose turn it is; 0 when it is through. */
static size_t begin_scan_read(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->turn];

	while (device->cursor < device->read_count && !is_of_scan(&device->reads[device->cursor], now_ns))
		device->cursor++;
	if (device->cursor >= device->read_count)
		return 0;
	if (!line->scan_begun) {
		line->scan_begun = true;
		line->scan_began_ns = now_ns;
	}
	return begin_read(line, line->turn, device->cursor, now_ns);
}

static size_t begin_for_turn(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->turn];

	forget_unanswered(device, now_ns);
	if (!device->alive)
		return 0;
	if (device->unanswered_count > 0)
		return begin_probe(line, line->turn, now_ns);
	return begin_scan_read(line, now_ns);
}

static size_t begin_scan(struct modbus_line *line, int64_t now_ns)
{
	/* One more than there are devices: the first may only have to end its scan. */
	for (uint32_t tried = 0; tried <= line->device_count && line->device_count > 0; tried++) {
		size_t length = begin_for_turn(line, now_ns);

		if (length > 0)
			return length;
		next_turn(line);
	}
	return 0;
}

/* What keeps its place in the line's turn: however many devices are dead, the living are scanned after each probe. */
static size_t begin_in_turn(struct modbus_line *line, int64_t now_ns)
{
	size_t length = 0;

	line->due_in_row = 0;
	if (!line->probed_in_vain)
		length = begin_due_probe(line, now_ns);
	if (length == 0)
		length = begin_scan(line, now_ns);
	return length;
}

/* However many commands come, polling goes on; however many reads are due, the scan does. */
static size_t begin_next(struct modbus_line *line, int64_t now_ns)
{
	size_t length = 0;

	if (line->commands_in_row < MODBUS_COMMANDS_IN_ROW)
		length = begin_command(line, now_ns);
	if (length > 0)
		return length;
	length = begin_urgent_read(line, now_ns);
	if (length > 0)
		return length;
	line->commands_in_row = 0;
	if (line->due_in_row < MODBUS_DUE_IN_ROW)
		length = begin_due_read(line, now_ns);
	if (length == 0)
		length = begin_in_turn(line, now_ns);
	/* Nobody is kept waiting. */
	if (length == 0)
		length = begin_command(line, now_ns);
	if (length == 0)
		length = begin_due_read(line, now_ns);
	if (length == 0)
		length = begin_due_probe(line, now_ns);
	return length;
}

/* When something may become due on a line that has nothing to do. */
static int64_t next_due(const struct modbus_line *line, int64_t now_ns)
{
	int64_t due = MODBUS_NEVER;

	for (uint32_t i = 0; i < line->device_count; i++) {
		const struct modbus_device *device = &line->devices[i];

		if (device->unanswered_count > 0 || device->inherited)
			due = earlier(due, device->trust_ns);
		if (!device->alive && is_readable(device) && device->next_probe_ns > now_ns)
			due = earlier(due, device->next_probe_ns);
		for (uint32_t read = 0; device->alive && read < device->read_count; read++) {
			if (device->reads[read].not_before_ns > now_ns)
				due = earlier(due, device->reads[read].not_before_ns);
			if (device->reads[read].period_ns > 0 && device->reads[read].due_ns > now_ns)
				due = earlier(due, device->reads[read].due_ns);
		}
	}
	return due;
}

/* ---- the line ------------------------------------------------------------------------------------------ */

static void lose_all(struct modbus_line *line, int64_t now_ns)
{
	for (uint32_t i = 0; i < line->device_count; i++)
		device_died(line, i, now_ns);
	drop_commands(line);
}

void modbus_line_init(struct modbus_line *line)
{
	for (uint32_t i = 0; i < line->device_count; i++) {
		modbus_objects_sort(line->devices[i].objects, line->devices[i].object_count);
		replan(line, &line->devices[i]);
	}
	line->state = MODBUS_CLOSED;
}

void modbus_line_open(struct modbus_line *line, int64_t now_ns)
{
	for (uint32_t i = 0; i < line->device_count; i++) {
		line->devices[i].backoff_ns = 0;
		line->devices[i].next_probe_ns = now_ns;
		line->devices[i].inherited = is_readable(&line->devices[i]);
		line->devices[i].trust_ns =
		    later(line->devices[i].trust_ns,
			  now_ns + line->devices[i].response_timeout_ns + MODBUS_LATE_NS);
	}
	line->received_count = 0;
	line->last_byte_ns = now_ns - MODBUS_GAP_NS;
	line->turn = line->probe_turn = 0;
	line->probed_in_vain = line->scan_begun = false;
	line->commands_in_row = line->due_in_row = 0;
	/* Whatever was under way when the port was opened must have ended. */
	end(line, now_ns + MODBUS_GAP_NS, now_ns);
}

void modbus_line_close(struct modbus_line *line, int64_t now_ns)
{
	bool commanding = (line->state == MODBUS_WAITING && line->purpose == MODBUS_COMMAND) ||
			  line->state == MODBUS_TURNAROUND;

	if (line->state == MODBUS_WAITING)
		add_unanswered(&line->devices[line->device], &line->request, line->sent_ns);
	line->state = MODBUS_CLOSED;
	if (commanding)
		end_command(line, MODBUS_TIMED_OUT, 0);
	lose_all(line, now_ns);
}

bool modbus_line_command(struct modbus_line *line, const struct modbus_command *command)
{
	if (line->state == MODBUS_CLOSED || line->command_count == line->command_capacity)
		return false;
	line->commands[line->command_count++] = *command;
	return true;
}

static void keep_byte(struct modbus_line *line, uint8_t byte)
{
	/* An answer is at most half of the buffer: what fills it are strays. */
	if (line->received_count == sizeof(line->received))
		remove_strays(line);
	line->received[line->received_count++] = byte;
}

static void receive_byte(struct modbus_line *line, uint8_t byte, int64_t now_ns)
{
	bool first = line->received_count == 0;

	keep_byte(line, byte);
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

/* Characters that must come before anything can be done with them. */
static size_t missing(const struct modbus_line *line)
{
	size_t begun = line->received_count - line->strays;

	if (line->state != MODBUS_WAITING || begun == 0 || line->devices[line->device].echoes > 0)
		return 0;
	return modbus_answer_missing(&line->request, line->received + line->strays, begun);
}

void modbus_line_receive(struct modbus_line *line, const uint8_t *bytes, size_t length, int64_t now_ns)
{
	if (line->state == MODBUS_CLOSED || length == 0)
		return;
	if (line->state == MODBUS_WAITING && line->purpose == MODBUS_SCAN &&
	    now_ns >= last_moment(line) + MODBUS_LATE_NS)
		timed_out(line, now_ns);
	line->last_byte_ns = now_ns;
	for (size_t i = 0; i < length; i++)
		receive_byte(line, bytes[i], now_ns);
	line->listen_ns = now_ns + (int64_t)missing(line) * line->wire.char_ns;
}

static size_t leave_idle(struct modbus_line *line, int64_t now_ns)
{
	if (now_ns >= line->silent_ns) {
		if (line->strays > 0)
			remove_strays(line);
		return begin_next(line, now_ns);
	}
	if (now_ns >= line->restless_ns + MODBUS_BABBLE_NS) {
		line->restless_ns = now_ns;
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
		return next_due(line, now_ns);
	case MODBUS_WAITING:
		if (is_bursting(line, now_ns))
			return earlier(heard_ns(line) + MODBUS_GAP_NS, last_moment(line));
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
		output.length = leave_idle(line, now_ns);
	output.deadline_ns = next_deadline(line, now_ns);
	output.listen_ns = line->listen_ns;
	return output;
}
