/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What a line makes of the octets of RTU frames: answers, echoes, late answers, and strays, which belong to none. Those of ASCII come
 * here as well, frame by frame.
 */
#include "line_parts.h"

#include <string.h>

#include "map/time_ns.h"

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
void modbus_remove_strays(struct modbus_line *line, int64_t now_ns)
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

/* Of what is passed on, nobody knows unless it is a read. */
static bool looks_like_its_answer(const struct modbus_line *line)
{
	if (line->purpose == MODBUS_PASS && !modbus_is_read(line->request.function))
		return true;
	return modbus_answer_judge(&line->request, line->frame, line->frame_length) == MODBUS_ANSWER;
}

/* What is passed on may be for a device of which nothing was read: the others have shown it. */
static bool hears_itself(const struct modbus_line *line)
{
	for (uint32_t i = 0; i < line->device_count; i++)
		if (line->devices[i].echoes > 0 && (i == line->device || line->purpose == MODBUS_PASS))
			return true;
	return false;
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
		return hears_itself(line);
	if (!hears_itself(line) && looks_like_its_answer(line))
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
			size_t length = is_exception
					    ? 5
					    : modbus_begun_length(&line->request, start,
								  line->received_count - line->strays);

			memcpy(frame, start, length);
			if (line->strays > 0)
				modbus_remove_strays(line, now_ns);
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

bool modbus_pass_burst(struct modbus_line *line, int64_t now_ns)
{
	uint8_t frame[sizeof(line->received)];
	const size_t length = line->received_count;

	if (line->purpose != MODBUS_PASS || length > MODBUS_FRAME_MAX ||
	    !modbus_crc_valid(line->received, length))
		return false;
	memcpy(frame, line->received, length);
	if (!modbus_pass_answered(line, frame, length - MODBUS_CRC_LENGTH, now_ns))
		return false;
	line->received_count = line->strays = 0;
	modbus_connection_answered(line);
	return true;
}

/* If it is the last one of an answer whose length is known, that ends here. */
static void take_passed_octet(struct modbus_line *line, int64_t now_ns)
{
	enum modbus_verdict verdict =
	    modbus_answer_judge(&line->request, line->received, line->received_count);

	if (verdict == MODBUS_EXCEPTION ||
	    (verdict == MODBUS_ANSWER && modbus_pass_is_known(line->request.function)))
		modbus_pass_burst(line, now_ns);
}

/* ---- RTU frames -------------------------------------------------------------------------------------- */

static void keep_byte(struct modbus_line *line, uint8_t byte, int64_t now_ns)
{
	/* An answer is at most half of the buffer: what fills it are strays, also where nobody looked for one among them. */
	if (line->received_count == sizeof(line->received)) {
		if (line->strays == 0)
			line->strays = line->received_count;
		modbus_remove_strays(line, now_ns);
	}
	line->received[line->received_count++] = byte;
}

/* So many octets a transceiver may add to an answer when it lets go of the line. */
#define RELEASE_OCTETS 3

/* Nothing else has come since the answer, behind which the line is to be silent. */
static bool is_release(const struct modbus_line *line, int64_t now_ns)
{
	return line->received_count > 0 && line->received_count <= RELEASE_OCTETS &&
	       now_ns <= line->silent_ns && line->restless_ns == line->devices[line->device].heard_ns;
}

void modbus_note_unrest(struct modbus_line *line, int64_t now_ns)
{
	const int64_t gap_ns = is_release(line, now_ns) ? line->wire.silence_ns : MODBUS_GAP_NS;

	if (now_ns >= line->silent_ns)
		line->restless_ns = now_ns;
	line->silent_ns = later(line->silent_ns, now_ns + gap_ns);
}

static void receive_byte(struct modbus_line *line, uint8_t byte, int64_t began_ns, int64_t now_ns)
{
	bool first = line->received_count == 0;

	keep_byte(line, byte, now_ns);
	if (line->state != MODBUS_WAITING) {
		line->strays = line->received_count;
		modbus_note_unrest(line, now_ns);
		return;
	}
	if (first && line->purpose != MODBUS_PASS)
		line->devices[line->device].counters.latency_us =
		    (uint32_t)(later(began_ns - line->sent_ns, 0) / NS_PER_US);
	if (take_echo(line))
		return;
	if (line->purpose == MODBUS_PASS)
		take_passed_octet(line, now_ns);
	else
		take_answer(line, now_ns);
}

void modbus_take_octets(struct modbus_line *line, const uint8_t *octets, size_t length, int64_t began_ns,
			int64_t now_ns)
{
	for (size_t i = 0; i < length; i++)
		receive_byte(line, octets[i], began_ns, now_ns);
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

	if (line->state != MODBUS_WAITING || line->purpose == MODBUS_PASS || begun == 0 || device->echoes > 0)
		return 0;
	return modbus_answer_missing(&line->request, line->received + line->strays, begun, !is_plain(device));
}

static bool receive(struct modbus_line *line, const uint8_t *bytes, size_t length, int64_t now_ns)
{
	size_t lacking;

	line->last_byte_ns = now_ns;
	modbus_take_octets(line, bytes, length, now_ns, now_ns);
	lacking = missing(line);
	line->listen_ns = lacking > 0 ? now_ns + (int64_t)lacking * line->wire.char_ns : 0;
	return true;
}

size_t modbus_build_rtu(struct modbus_line *line)
{
	return modbus_seal(line->frame, modbus_put_body(line, line->frame));
}

void modbus_remember_unanswered(struct modbus_line *line)
{
	struct modbus_device *device = &line->devices[line->device];

	if (line->purpose == MODBUS_PASS)
		modbus_add_passed(device, &line->request, line->sent_ns);
	else
		modbus_add_unanswered(device, &line->request, line->sent_ns);
}

const struct modbus_framer modbus_rtu_framer = {.build = modbus_build_rtu,
						.receive = receive,
						.remember_unanswered = modbus_remember_unanswered,
						.rest_ns = MODBUS_GAP_NS,
						.answers_are_alike = true};
