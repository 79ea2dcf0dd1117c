/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A device of a line: what it has not answered yet, what it does not give, whether it lives. */
#include "line_parts.h"

#define BITS_STEP 8 /* bits that make an answer one byte longer */

int64_t modbus_next_backoff(int64_t backoff_ns)
{
	return earlier(later(2 * backoff_ns, MODBUS_FIRST_PROBE_NS), MODBUS_RAREST_PROBE_NS);
}

bool modbus_is_readable(const struct modbus_device *device)
{
	return device->unit != MODBUS_BROADCAST && device->object_count > 0;
}

/* ---- what is unanswered (line.h, "Late answers") -------------------------------------------- */

static uint16_t answer_bytes(const struct modbus_request *request)
{
	return modbus_is_read(request->function) ? modbus_read_bytes(request->function, request->count) : 0;
}

void modbus_add_unanswered(struct modbus_device *device, const struct modbus_request *request,
			   int64_t sent_ns)
{
	device->trust_ns = later(device->trust_ns, sent_ns + device->response_timeout_ns + MODBUS_LATE_NS);
	if (device->unanswered_count < MODBUS_UNANSWERED_MAX)
		device->unanswered[device->unanswered_count++] =
		    (struct modbus_unanswered){request->function, answer_bytes(request)};
}

void modbus_forget_unanswered(struct modbus_device *device, int64_t now_ns)
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
bool modbus_owes(const struct modbus_device *device, uint8_t function)
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
void modbus_settle_unanswered(struct modbus_device *device, const struct modbus_request *request,
			      bool is_exception, int64_t sent_ns, int64_t now_ns)
{
	if (is_exception && modbus_owes(device, request->function)) {
		distrust_everything(device, now_ns);
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

/* ---- life and death of a device --------------------------------------------------------------- */

void modbus_replan(struct modbus_line *line, struct modbus_device *device)
{
	device->read_count = modbus_is_readable(device) ? modbus_plan(&line->wire, device->objects,
								      device->object_count, device->reads)
							: 0;
	device->cursor = 0;
}

/*
 * The device lives but does not give this read (exception 0: it is silent). Halves it, since one object
 * that the device does not have, or a hole, spoils it for all. A single object, or what a busy device
 * does not give now, is asked for ever more rarely. True when the read was halved.
 */
bool modbus_refuse_read(struct modbus_line *line, uint32_t index, uint32_t read_index, uint8_t exception,
			int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];
	struct modbus_read *read = &device->reads[read_index];

	if (!modbus_is_of_the_moment(exception) &&
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
			modbus_refuse_read(line, index, read, 0, now_ns);
}

void modbus_device_answered(struct modbus_line *line, uint32_t index, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];
	bool was_gone = device->backoff_ns > MODBUS_FIRST_PROBE_NS;

	device->failures = 0;
	device->backoff_ns = 0;
	refuse_silent_reads(line, index, now_ns);
	if (device->alive || !modbus_is_readable(device))
		return;
	/* It may be another one that now has this address, and refuse other things. */
	if (was_gone)
		modbus_replan(line, device);
	device->alive = true;
	device->cursor = 0;
	line->events->alive(line->context, index, true, now_ns);
}

static void set_backoff(struct modbus_device *device, int64_t backoff_ns, int64_t now_ns)
{
	device->backoff_ns = backoff_ns;
	device->next_probe_ns = now_ns + backoff_ns;
}

void modbus_device_died(struct modbus_line *line, uint32_t index, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];

	if (!device->alive)
		return;
	device->alive = false;
	set_backoff(device, MODBUS_FIRST_PROBE_NS, now_ns);
	line->events->alive(line->context, index, false, now_ns);
}

void modbus_device_silent(struct modbus_line *line, uint32_t index, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[index];

	device->failures++;
	if (!device->alive && line->purpose == MODBUS_PROBE) {
		set_backoff(device, modbus_next_backoff(device->backoff_ns), now_ns);
		line->probed_in_vain = true;
	} else if (device->failures > device->retries) {
		modbus_device_died(line, index, now_ns);
	}
}
