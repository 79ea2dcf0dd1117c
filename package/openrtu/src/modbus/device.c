/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A device of a line: what it has not answered yet, what it does not give, whether it lives. */
#include "line_parts.h"

#define BITS_STEP 8 /* bits that make an answer one byte longer */

#define PROBE_LENGTH 8 /* characters of a read's request */

/* Characters of answers. */
#define EXCEPTION_LENGTH    5
#define WRITE_ANSWER_LENGTH 8
#define READ_ANSWER_LEAST   5 /* without its data */

int64_t modbus_next_backoff(int64_t backoff_ns)
{
	return earlier(later(2 * backoff_ns, MODBUS_FIRST_PROBE_NS), MODBUS_RAREST_PROBE_NS);
}

bool modbus_is_readable(const struct modbus_device *device)
{
	return !device->broadcast && device->object_count > 0;
}

/* ---- what is unanswered (line.h, "Late answers") -------------------------------------------- */

static uint16_t answer_bytes(const struct modbus_request *request)
{
	return modbus_is_read(request->function) ? modbus_read_bytes(request->function, request->count) : 0;
}

void modbus_add_unanswered(struct modbus_device *device, const struct modbus_request *request,
			   int64_t sent_ns)
{
	int64_t taken_ns = sent_ns; /* by the device, which ends what it had before */

	if (device->unanswered_count == 0 || !device->alive)
		device->asked_ns = sent_ns;
	if (device->unanswered_count > 0)
		taken_ns = later(sent_ns, device->trust_ns - MODBUS_LATE_NS);
	device->trust_ns = later(device->trust_ns, taken_ns + device->response_timeout_ns + MODBUS_LATE_NS);
	if (device->unanswered_count < MODBUS_UNANSWERED_MAX)
		device->unanswered[device->unanswered_count++] =
		    (struct modbus_unanswered){request->function, answer_bytes(request), sent_ns};
}

void modbus_add_passed(struct modbus_device *device, const struct modbus_request *request, int64_t sent_ns)
{
	const int64_t asked_ns = device->asked_ns;

	modbus_add_unanswered(device, request, sent_ns);
	device->asked_ns = asked_ns;
	device->unanswered[device->unanswered_count - 1].sent_ns = 0;
}

void modbus_forget_unanswered(struct modbus_device *device, int64_t now_ns)
{
	if (now_ns < device->trust_ns)
		return;
	device->unanswered_count = 0;
	device->inherited = false;
}

/* Its answers may be off by one, that to what was sent at sent_ns still to come: only time helps. */
static void distrust_everything(struct modbus_device *device, int64_t sent_ns, int64_t now_ns)
{
	int64_t due_ns = later(sent_ns + device->response_timeout_ns, now_ns);

	device->unanswered_count = MODBUS_UNANSWERED_MAX;
	device->trust_ns = later(device->trust_ns, due_ns + MODBUS_LATE_NS);
}

/* An exception names its function only, a write's echo may equal an older one: the function decides. */
bool modbus_owes(const struct modbus_device *device, uint8_t function)
{
	if (device->inherited || device->unanswered_count == MODBUS_UNANSWERED_MAX)
		return true;
	for (uint8_t i = 0; i < device->unanswered_count; i++)
		if (device->unanswered[i].function == function)
			return true;
	return false;
}

/* A device answers in order: what is older than that has no answer any more. */
static int64_t take_unanswered(struct modbus_device *device, uint8_t count)
{
	int64_t sent_ns = device->unanswered[count - 1].sent_ns;

	for (uint8_t i = 0; i < count; i++)
		device->unanswered[i].sent_ns = 0;
	return sent_ns;
}

int64_t modbus_sent_ns(struct modbus_device *device, const uint8_t *frame)
{
	const uint8_t function = frame[1] & (uint8_t)~MODBUS_EXCEPTION_BIT;
	const bool is_exception = function != frame[1];

	if (device->unanswered_count == MODBUS_UNANSWERED_MAX)
		return 0;
	for (uint8_t i = 0; i < device->unanswered_count; i++) {
		const struct modbus_unanswered *unanswered = &device->unanswered[i];

		if (unanswered->sent_ns != 0 && unanswered->function == function &&
		    (is_exception || unanswered->bytes == 0 || unanswered->bytes == frame[2]))
			return take_unanswered(device, i + 1);
	}
	return 0;
}

size_t modbus_owed_length(const struct modbus_device *device, const uint8_t *bytes, size_t count)
{
	const uint8_t function = count < EXCEPTION_LENGTH ? 0 : bytes[1] & (uint8_t)~MODBUS_EXCEPTION_BIT;

	if (function == 0 || bytes[0] != device->unit || device->unanswered_count == MODBUS_UNANSWERED_MAX)
		return 0;
	for (uint8_t i = 0; i < device->unanswered_count; i++) {
		const struct modbus_unanswered *unanswered = &device->unanswered[i];
		size_t length =
		    unanswered->bytes == 0 ? WRITE_ANSWER_LENGTH : READ_ANSWER_LEAST + unanswered->bytes;

		if (unanswered->function != function)
			continue;
		if (bytes[1] != function)
			return EXCEPTION_LENGTH;
		if ((unanswered->bytes == 0 || unanswered->bytes == bytes[2]) && length <= count)
			return length;
	}
	return 0;
}

bool modbus_may_be_busy(const struct modbus_device *device, int64_t now_ns)
{
	return device->alive && device->unanswered_count > 0 && now_ns < device->trust_ns - MODBUS_LATE_NS;
}

/*
 * After an answer: a device answers in order, so what was asked before this request has no answer any
 * more.
 */
void modbus_settle_unanswered(struct modbus_device *device, const struct modbus_request *request,
			      bool is_exception, int64_t sent_ns, int64_t now_ns)
{
	if (is_exception && modbus_owes(device, request->function)) {
		distrust_everything(device, sent_ns, now_ns);
	} else if (device->inherited) {
		/*
		 * It may have been the answer to an inherited request: then that to this one is still
		 * to come.
		 */
		device->inherited = false;
		modbus_add_unanswered(device, request, sent_ns);
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
bool modbus_find_probe(const struct modbus_device *device, struct modbus_request *request)
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

/* ---- how long an answer is waited for (line.h, "Time-outs") ----------------------------------- */

static int64_t doubled(int64_t time_ns, uint32_t times, int64_t most_ns)
{
	while (times-- > 0 && time_ns < most_ns)
		time_ns *= 2;
	return earlier(time_ns, most_ns);
}

static void set_timeout(struct modbus_device *device)
{
	int64_t learned_ns =
	    later(MODBUS_LATENCY_FACTOR * device->slowest_ns, device->response_timeout_min_ns);

	if (device->slowest_ns == 0)
		device->timeout_ns = 0;
	else if (device->alive && device->failures >= device->retries)
		device->timeout_ns = device->response_timeout_ns;
	else
		device->timeout_ns = doubled(learned_ns, device->failures, device->response_timeout_ns);
}

int64_t modbus_timeout(const struct modbus_device *device)
{
	return device->timeout_ns > 0 ? device->timeout_ns : device->response_timeout_ns;
}

void modbus_learn_latency(struct modbus_device *device, int64_t latency_ns)
{
	int64_t faded_ns = device->slowest_ns - device->slowest_ns / MODBUS_LATENCY_FADING;

	device->slowest_ns = later(later(latency_ns, 1), faded_ns);
	set_timeout(device);
}

bool modbus_was_in_time(struct modbus_device *device, int64_t began_ns, int64_t ended_ns)
{
	int64_t latency_ns = began_ns - device->asked_ns;

	if (device->unanswered_count == 0 || latency_ns > device->response_timeout_ns)
		return false;
	if (device->alive)
		device->failures = 0;
	modbus_learn_latency(device, latency_ns);
	device->asked_ns = ended_ns;
	return true;
}

/* ---- life and death of a device --------------------------------------------------------------- */

void modbus_replan(struct modbus_line *line, struct modbus_device *device)
{
	device->read_count = modbus_is_readable(device)
				 ? modbus_plan(&line->wire, &device->limits, device->objects,
					       device->object_count, device->reads)
				 : 0;
	device->cursor = 0;
	device->news = true;
	modbus_forget_page(device);
}

void modbus_set_read_aside(struct modbus_line *line, uint32_t index, uint32_t read_index, uint8_t exception,
			   int64_t now_ns)
{
	struct modbus_read *read = &line->devices[index].reads[read_index];

	line->devices[index].news = true;
	if (read->pause_ns == 0 || read->exception != exception)
		line->events->refused(line->context, index, read, exception, now_ns);
	read->exception = exception;
	read->failures = 0;
	read->pause_ns = modbus_next_backoff(read->pause_ns);
	read->not_before_ns = now_ns + read->pause_ns;
}

/*
 * The device lives but does not give this read (exception 0: it is silent). Divides it, since one object
 * that the device does not have, or a hole, spoils it for all. A single object, or what a busy device
 * does not give now, is asked for less and less often. True when the read was divided.
 */
bool modbus_refuse_read(struct modbus_line *line, uint32_t index, uint32_t read_index, uint8_t exception,
			int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];

	device->news = true;
	modbus_forget_page(device);
	if (!modbus_is_of_the_moment(exception) &&
	    modbus_plan_split(device->objects, device->reads, &device->read_count, read_index, exception))
		return true;
	modbus_set_read_aside(line, index, read_index, exception, now_ns);
	return false;
}

/* Reads that the device left unanswered again and again while it answered others. */
static void refuse_silent_reads(struct modbus_line *line, uint32_t index, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];

	for (uint32_t read = device->read_count; read-- > 0;)
		if (device->reads[read].failures > device->retries &&
		    device->reads[read].failures >= MODBUS_SILENT_READS)
			modbus_refuse_read(line, index, read, 0, now_ns);
}

/* All its points are invalid, however long their period is. */
static void read_all_at_once(struct modbus_device *device)
{
	for (uint32_t read = 0; read < device->read_count; read++)
		device->reads[read].due_ns = 0;
}

static void write_all_at_once(struct modbus_device *device)
{
	for (uint32_t i = 0; i < device->kept_count; i++) {
		struct modbus_kept *kept = &device->kept[i];

		kept->due_ns = kept->backoff_ns = 0;
		kept->failures = kept->next = 0;
		kept->turned = false;
	}
}

void modbus_device_answered(struct modbus_line *line, uint32_t index, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];
	bool was_alive = device->alive, was_gone = !was_alive && device->failures > 0;

	device->alive = modbus_is_readable(device);
	device->vouched = false;
	device->failures = 0;
	device->lost_ns = device->backoff_ns = 0;
	set_timeout(device);
	refuse_silent_reads(line, index, now_ns);
	if (was_alive || !device->alive)
		return;
	line->living++;
	/* A command may have reached it before it was probed. */
	device->paid_ns = earlier(device->paid_ns, now_ns);
	/* It may be another one that now has this address, and refuse other things. */
	if (was_gone)
		modbus_replan(line, device);
	read_all_at_once(device);
	write_all_at_once(device);
	if (device->identity != NULL)
		modbus_identity_begin(device->identity);
	device->cursor = 0;
	line->events->alive(line->context, index, true, now_ns);
}

int64_t modbus_vain_probe_ns(const struct modbus_wire *wire, int64_t timeout_ns)
{
	return wire->before_ns + PROBE_LENGTH * wire->char_ns + timeout_ns;
}

/* Somebody has to wait while this device is waited for. */
static bool has_living_others(const struct modbus_line *line, const struct modbus_device *device)
{
	return line->living > (device->alive ? 1u : 0u);
}

/*
 * Until the next probe, if that is in vain, the device will have had its share of the line's time: for what it cost
 * since it was paid last, and for this probe. Where no other lives, nothing is lost, and it need not wait so long; nor
 * where the configuration says how long at most.
 */
static void let_rest(const struct modbus_line *line, struct modbus_device *device, int64_t now_ns)
{
	int64_t rarest_ns = device->probe_max_ns > 0 ? device->probe_max_ns : MODBUS_RAREST_PROBE_NS;
	int64_t vain_ns;

	device->paid_ns = later(device->paid_ns + MODBUS_DEAD_SHARE * device->lost_ns, now_ns);
	device->paid_ns = earlier(device->paid_ns, now_ns + MODBUS_RAREST_PROBE_NS);
	device->lost_ns = 0;
	set_timeout(device);
	vain_ns = modbus_vain_probe_ns(&line->wire, modbus_timeout(device));
	device->lone_probe_ns = now_ns + doubled(MODBUS_FIRST_PROBE_NS, device->failures, rarest_ns);
	device->next_probe_ns =
	    later(device->lone_probe_ns, device->paid_ns + (MODBUS_DEAD_SHARE - 1) * vain_ns);
	if (device->probe_max_ns > 0)
		device->next_probe_ns = earlier(device->next_probe_ns, now_ns + device->probe_max_ns);
	device->backoff_ns = modbus_probe_due_ns(line, device) - now_ns;
}

int64_t modbus_probe_due_ns(const struct modbus_line *line, const struct modbus_device *device)
{
	return line->living > 0 ? device->next_probe_ns : device->lone_probe_ns;
}

void modbus_device_died(struct modbus_line *line, uint32_t index, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];

	if (!device->alive && !device->vouched)
		return;
	line->living -= device->alive;
	device->alive = device->vouched = false;
	device->failures = 0;
	modbus_forget_page(device);
	let_rest(line, device, now_ns);
	line->events->alive(line->context, index, false, now_ns);
}

/* A process that did not run meanwhile has cost the line more, but that was not the device. */
static int64_t lost_to_request(const struct modbus_line *line, int64_t now_ns)
{
	return earlier(now_ns, line->deadline_ns + line->wire.gap_ns) - begun_ns(line);
}

void modbus_device_silent(struct modbus_line *line, uint32_t index, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];

	if (line->purpose == MODBUS_COMMAND && !device->alive)
		return;
	if (line->purpose != MODBUS_COMMAND && has_living_others(line, device))
		device->lost_ns += lost_to_request(line, now_ns);
	device->failures++;
	set_timeout(device);
	line->probed_in_vain |= !device->alive;
	if (!device->alive && !device->vouched) {
		let_rest(line, device, now_ns);
		if (device->failures == device->retries + 1u && device->counters.answers == 0 &&
		    line->events->mute != NULL)
			line->events->mute(line->context, index);
	} else if (device->failures > device->retries) {
		modbus_device_died(line, index, now_ns);
	}
}
