/* SPDX-License-Identifier: GPL-3.0-or-later */
/* One request and what becomes of it: an answer, a refusal, nothing in time. */
#include "map/time_ns.h"
#include "modbus/line_parts.h"

#define READ_HEAD 3 /* of a read's answer, before the data: unit, function, their count */

/* A command's fate must be known, and a read that was not answered before is given up when it is not again. */
static int64_t timeout_of(const struct modbus_line *line, const struct modbus_device *device)
{
	if (line->purpose == MODBUS_IDENTIFY)
		return modbus_identify_timeout(device);
	if (line->purpose == MODBUS_PASS)
		return modbus_pass_timeout(line, device);
	if (line->purpose == MODBUS_COMMAND || line->purpose == MODBUS_KEEP ||
	    line->purpose == MODBUS_CHOOSE ||
	    (line->purpose == MODBUS_SCAN && device->reads[line->read].failures > 0))
		return device->response_timeout_ns;
	return modbus_timeout(device);
}

size_t modbus_begin(struct modbus_line *line, enum modbus_purpose purpose, uint32_t index, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];
	bool broadcast = device->broadcast;
	size_t length;

	line->purpose = purpose;
	length = line->framer->build(line);
	modbus_connection_asked(line);
	line->kept_last = purpose == MODBUS_KEEP || (purpose == MODBUS_COMMAND && line->kept_last);
	line->device = index;
	line->garbled = line->echoed = false;
	line->listen_ns = now_ns; /* whatever of the one before did not come */
	line->frame_length = length;
	line->sent_ns = now_ns + line->wire.before_ns + (int64_t)length * line->wire.char_ns;
	line->state = broadcast ? MODBUS_TURNAROUND : MODBUS_WAITING;
	line->deadline_ns = line->sent_ns + (broadcast ? MODBUS_BROADCAST_NS : timeout_of(line, device));
	line->counters.requests++;
	if (purpose != MODBUS_PASS) {
		modbus_pause_asked(&device->pause,
				   device->spoken_ns > 0 ? begun_ns(line) - device->spoken_ns : 0);
		device->counters.requests++;
	}
	device->spoken_ns = line->sent_ns;
	return length;
}

void modbus_end(struct modbus_line *line, int64_t silent_ns, int64_t now_ns)
{
	line->state = MODBUS_IDLE;
	line->strays = line->received_count;
	line->silent_ns = silent_ns;
	line->restless_ns = now_ns;
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

	device->news |= !read->given;
	read->given = true;
	read->failures = 0;
	read->pause_ns = 0;
	if (line->read == device->cursor)
		device->cursor++;
	serve_period(line, read);
	line->scan_ended_ns = now_ns;
	line->events->read(line->context, line->device, read, data, now_ns);
	/* What the device refused it gives now: what was divided for it may be whole again. */
	if (recovered)
		modbus_replan(line, device);
}

/* It is through for this time. */
static void leave_refused(struct modbus_line *line, uint8_t exception)
{
	struct modbus_device *device = &line->devices[line->device];
	struct modbus_read *read = &device->reads[line->read];

	serve_period(line, read);
	if (modbus_is_of_the_moment(exception)) /* which is shorter than a long period */
		read->due_ns = earlier(read->due_ns, read->not_before_ns);
	if (line->read == device->cursor)
		device->cursor++;
}

static void read_refused(struct modbus_line *line, uint8_t exception, int64_t now_ns)
{
	line->scan_ended_ns = now_ns;
	if (!modbus_refuse_read(line, line->device, line->read, exception, now_ns))
		leave_refused(line, exception);
}

static void page_answered(struct modbus_line *line, bool is_exception, uint8_t exception, int64_t now_ns)
{
	const struct modbus_read *read = &line->devices[line->device].reads[line->read];

	modbus_page_answered(line, is_exception, exception, now_ns);
	if (is_exception && read->not_before_ns > now_ns)
		leave_refused(line, exception);
}

static void count_answer(struct modbus_line *line, bool exception)
{
	struct modbus_device *device = &line->devices[line->device];

	line->counters.answers++;
	device->counters.answers++;
	line->counters.exceptions += exception;
	device->counters.exceptions += exception;
	device->refusing = exception;
}

/* That it does not know what nobody needs is no news. */
static bool is_refusal(const struct modbus_line *line, bool is_exception)
{
	return is_exception && line->purpose != MODBUS_IDENTIFY;
}

/* A gateway's word that it does not reach the device: it comes instead of the device's own. */
static bool is_unreachable(const struct modbus_line *line, uint8_t exception)
{
	return line->framer->has_gateways && (exception == MODBUS_NO_PATH || exception == MODBUS_NO_TARGET);
}

/* What it did not answer so far was asked too soon: no read is to blame. */
static void forgive_reads(struct modbus_device *device)
{
	for (uint32_t i = 0; i < device->read_count; i++)
		device->reads[i].failures = 0;
}

static enum modbus_patience patience_of(const struct modbus_device *device)
{
	if (device->retries > 0)
		return MODBUS_IS_PATIENT;
	return device->alive ? MODBUS_IS_KILLED : MODBUS_IS_REVIVED;
}

static void learn_pause(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->device];
	const enum modbus_patience patience = patience_of(device);
	int64_t news_ns;

	if (modbus_pause_answered(&device->pause, patience, now_ns))
		forgive_reads(device);
	news_ns = modbus_pause_news(&device->pause, patience);
	if (news_ns > 0 && line->events->pause != NULL)
		line->events->pause(line->context, line->device, news_ns, now_ns);
}

static void command_answered(struct modbus_line *line, bool is_exception, uint8_t exception, int64_t now_ns)
{
	if (exception == MODBUS_ILLEGAL_FUNCTION && modbus_turn_command(line))
		return;
	if (!is_exception)
		modbus_keep_command(line, now_ns);
	modbus_end_command(line, is_exception ? MODBUS_REFUSED : MODBUS_DONE, exception);
}

/* A gateway's word that it does not reach the device is no refusal of the device's. */
static void kept_answered(struct modbus_line *line, bool is_exception, bool unreachable, uint8_t exception,
			  int64_t now_ns)
{
	if (unreachable)
		modbus_kept_ended(line, MODBUS_TIMED_OUT, 0, now_ns);
	else
		modbus_kept_ended(line, is_exception ? MODBUS_REFUSED : MODBUS_DONE, exception, now_ns);
}

void modbus_request_answered(struct modbus_line *line, const uint8_t *body, bool is_exception, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->device];
	uint8_t exception = is_exception ? body[2] : 0;
	bool unreachable = is_unreachable(line, exception);

	modbus_end(
	    line,
	    later(later(now_ns, line->sent_ns) + line->wire.silence_ns, begun_ns(line) + line->wire.least_ns),
	    now_ns);
	count_answer(line, is_refusal(line, is_exception));
	device->heard_ns = device->spoken_ns = now_ns;
	if (line->purpose != MODBUS_IDENTIFY)
		modbus_latency_add(&device->latency, device->counters.latency_us);
	modbus_histogram_add(&line->counters.transactions, now_ns - begun_ns(line));
	if (modbus_is_read(line->request.function) && !line->echoed && device->echoes > 0)
		device->echoes--;
	modbus_settle_unanswered(device, &line->request, is_exception, line->sent_ns, now_ns);
	if (!unreachable && exception != MODBUS_ILLEGAL_FUNCTION)
		modbus_function_is_known(line, now_ns);

	if (line->purpose == MODBUS_COMMAND)
		command_answered(line, is_exception, exception, now_ns);
	else if (line->purpose == MODBUS_KEEP)
		kept_answered(line, is_exception, unreachable, exception, now_ns);
	else if (line->purpose == MODBUS_IDENTIFY)
		modbus_identify_answered(line, unreachable ? NULL : body, is_exception, now_ns);
	else if (line->purpose == MODBUS_CHOOSE && !unreachable)
		page_answered(line, is_exception, exception, now_ns);
	else if (line->purpose == MODBUS_SCAN && !is_exception)
		read_answered(line, body + READ_HEAD, now_ns);
	else if (line->purpose == MODBUS_SCAN && !unreachable)
		read_refused(line, exception, now_ns);
	if (unreachable && line->purpose == MODBUS_IDENTIFY)
		return; /* what is behind the gateway may know other functions */
	if (unreachable) {
		modbus_device_silent(line, line->device, now_ns);
	} else {
		learn_pause(line, now_ns);
		modbus_device_answered(line, line->device, now_ns);
	}
}

bool modbus_pass_answered(struct modbus_line *line, const uint8_t *body, size_t length, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->device];

	if (!modbus_answers_pass(line, body, length))
		return false;
	modbus_end(
	    line,
	    later(later(now_ns, line->sent_ns) + line->wire.silence_ns, begun_ns(line) + line->wire.least_ns),
	    now_ns);
	line->counters.answers++;
	device->heard_ns = device->spoken_ns = now_ns;
	modbus_pass_ended(line, MODBUS_DONE, body, length, now_ns);
	return true;
}

/* What it says is what the device that was asked would say. */
static bool answers_for_another(const struct modbus_line *line, const uint8_t *body, size_t length)
{
	struct modbus_request request = line->request;
	enum modbus_verdict verdict;

	request.unit = body[0];
	verdict = modbus_body_judge(&request, body, length);
	return verdict == MODBUS_ANSWER || verdict == MODBUS_EXCEPTION;
}

void modbus_tell_late(struct modbus_line *line, uint32_t index, int64_t sent_ns, int64_t began_ns,
		      int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];
	const int64_t latency_ns = began_ns - later(sent_ns, device->heard_ns);

	if (began_ns <= line->back_ns)
		return;
	if (sent_ns != 0 && latency_ns > device->response_timeout_ns) {
		device->counters.too_late++;
		device->latest_ns = later(device->latest_ns, latency_ns);
	}
	if (sent_ns != 0 && latency_ns > 0 && line->events->late != NULL)
		line->events->late(line->context, index, latency_ns, now_ns);
	device->heard_ns = device->spoken_ns = now_ns;
	modbus_pause_was_late(&device->pause);
}

static void tell_misfit(struct modbus_line *line, const uint8_t *body, size_t length, int64_t now_ns)
{
	const struct modbus_request *request = &line->request;

	if (body[0] == request->unit && body[1] == request->function && modbus_is_read(request->function) &&
	    length > READ_HEAD && line->events->misfit != NULL)
		line->events->misfit(line->context, line->device, length - READ_HEAD,
				     modbus_read_bytes(request->function, request->count), now_ns);
}

void modbus_count_wrong_answer(struct modbus_line *line, const uint8_t *body, size_t length, int64_t now_ns)
{
	struct modbus_line_counters *counters = &line->counters;

	if (body[0] != line->request.unit)
		counters->wrong_units++;
	else if ((body[1] & (uint8_t)~MODBUS_EXCEPTION_BIT) != line->request.function)
		counters->wrong_functions++;
	else if (modbus_is_read(line->request.function) ||
		 length != modbus_answer_length(&line->request) - MODBUS_CRC_LENGTH)
		counters->wrong_lengths++;
	else
		counters->wrong_answers++;
	line->devices[line->device].counters.errors++;
	tell_misfit(line, body, length, now_ns);
	if (body[0] != line->request.unit && line->events->stranger != NULL &&
	    answers_for_another(line, body, length))
		line->events->stranger(line->context, line->device, body[0], now_ns);
}

static void pass_unanswered(struct modbus_line *line, int64_t silent_ns, int64_t now_ns)
{
	line->framer->remember_unanswered(line);
	modbus_end(line, silent_ns, now_ns);
	modbus_pass_ended(line, MODBUS_TIMED_OUT, NULL, 0, now_ns);
}

static void request_unanswered(struct modbus_line *line, bool too_soon, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->device];

	if (line->purpose == MODBUS_PASS) {
		pass_unanswered(line, later(now_ns, line->last_byte_ns + MODBUS_GAP_NS), now_ns);
		return;
	}
	modbus_connection_unanswered(line);
	line->framer->remember_unanswered(line);
	modbus_end(line, later(now_ns, line->last_byte_ns + MODBUS_GAP_NS), now_ns);
	if (line->purpose == MODBUS_COMMAND)
		modbus_end_command(line, MODBUS_TIMED_OUT, 0);
	else if (line->purpose == MODBUS_KEEP)
		modbus_kept_ended(line, MODBUS_TIMED_OUT, 0, now_ns);
	else if (line->purpose == MODBUS_IDENTIFY)
		modbus_identify_answered(line, NULL, false, now_ns);
	else if ((line->purpose == MODBUS_SCAN || line->purpose == MODBUS_CHOOSE) && !too_soon)
		device->reads[line->read].failures++;
	if (line->purpose != MODBUS_KEEP &&
	    line->purpose != MODBUS_IDENTIFY) /* the reads find out whether it lives */
		modbus_device_silent(line, line->device, now_ns);
}

void modbus_request_torn(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->device];

	if (line->purpose == MODBUS_PASS) {
		pass_unanswered(line, now_ns, now_ns);
		/* What it costs to connect again is its cost, too. */
		line->pass_free_ns = later(line->pass_free_ns, now_ns + NS_PER_S);
		return;
	}
	/* A server of serial devices gives the next connection what comes late for this one. */
	line->framer->remember_unanswered(line);
	modbus_end(line, now_ns, now_ns);
	if (line->purpose == MODBUS_COMMAND)
		modbus_end_command(line, MODBUS_TIMED_OUT, 0);
	else if (line->purpose == MODBUS_KEEP)
		modbus_kept_ended(line, MODBUS_TIMED_OUT, 0, now_ns);
	/* Some hang up on what they do not know. */
	else if (line->purpose == MODBUS_IDENTIFY)
		modbus_identify_answered(line, NULL, false, now_ns);
	else if (line->purpose == MODBUS_SCAN || line->purpose == MODBUS_CHOOSE)
		device->reads[line->read].failures++;
}

void modbus_answer_garbled(struct modbus_line *line, int64_t now_ns)
{
	line->counters.crc_errors++;
	line->devices[line->device].counters.errors += line->purpose != MODBUS_PASS;
	line->received_count = line->strays = 0;
	request_unanswered(line, false, now_ns);
}

void modbus_request_timed_out(struct modbus_line *line, int64_t now_ns)
{
	line->counters.timeouts++;
	line->devices[line->device].counters.timeouts += line->purpose != MODBUS_PASS;
	request_unanswered(line,
			   line->purpose != MODBUS_IDENTIFY && line->purpose != MODBUS_PASS &&
			       modbus_pause_unanswered(&line->devices[line->device].pause, now_ns),
			   now_ns);
}
