/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a line makes of the frames of Modbus TCP: MODBUS Messaging on TCP/IP Implementation Guide V1.0b, 4.4.2. */
#include "line_parts.h"
#include "map/time_ns.h"

/* The numbers of transactions come again after some time, though not before this. */
#define OVERDUE_NS (60 * NS_PER_S)

static struct modbus_overdue *find_overdue(struct modbus_line *line, uint16_t transaction, int64_t now_ns)
{
	for (uint32_t i = 0; i < MODBUS_OVERDUE_MAX; i++) {
		struct modbus_overdue *overdue = &line->overdue[i];

		if (overdue->sent_ns != 0 && overdue->transaction == transaction &&
		    now_ns - overdue->sent_ns < OVERDUE_NS)
			return overdue;
	}
	return NULL;
}

/* A frame that nobody waits for: a request's that has timed out, or none's. */
static void take_stranger(struct modbus_line *line, uint16_t transaction, const uint8_t *body, int64_t now_ns)
{
	struct modbus_overdue *overdue = find_overdue(line, transaction, now_ns);

	if (overdue == NULL) {
		line->counters.unasked_frames++;
		return;
	}
	line->counters.late_answers++;
	if (body[0] == overdue->unit && (body[1] & (uint8_t)~MODBUS_EXCEPTION_BIT) == overdue->function)
		modbus_tell_late(line, overdue->device, overdue->sent_ns, now_ns, now_ns);
	overdue->sent_ns = 0;
}

static void take_frame(struct modbus_line *line, const uint8_t *frame, size_t length, int64_t now_ns)
{
	uint16_t transaction = modbus_register(frame, 0);
	const uint8_t *body = frame + MODBUS_MBAP_PREFIX;
	struct modbus_device *device;
	enum modbus_verdict verdict;

	if (line->state != MODBUS_WAITING || transaction != line->transaction) {
		take_stranger(line, transaction, body, now_ns);
		return;
	}
	if (line->purpose == MODBUS_PASS) {
		modbus_pass_answered(line, body, length - MODBUS_MBAP_PREFIX, now_ns);
		return;
	}
	device = &line->devices[line->device];
	verdict = modbus_body_judge(&line->request, body, length - MODBUS_MBAP_PREFIX);
	if (verdict == MODBUS_NOT_ITS_OWN) {
		modbus_count_wrong_answer(line, body, length - MODBUS_MBAP_PREFIX, now_ns);
		return;
	}
	device->counters.latency_us = (uint32_t)(later(now_ns - line->sent_ns, 0) / NS_PER_US);
	if (modbus_is_read(line->request.function))
		modbus_learn_latency(device, device->counters.latency_us * NS_PER_US);
	modbus_request_answered(line, body, verdict == MODBUS_EXCEPTION, now_ns);
}

static size_t build(struct modbus_line *line)
{
	return modbus_mbap_seal(line->frame, ++line->transaction,
				modbus_put_body(line, line->frame + MODBUS_MBAP_PREFIX));
}

static void remember_unanswered(struct modbus_line *line)
{
	line->overdue[line->overdue_count++ % MODBUS_OVERDUE_MAX] =
	    (struct modbus_overdue){.transaction = line->transaction,
				    .unit = line->request.unit,
				    .function = line->purpose == MODBUS_PASS ? 0 : line->request.function,
				    .device = line->device,
				    .sent_ns = line->sent_ns};
}

/* A datagram is one frame, or nothing; who sends something else by UDP may be anybody. */
static void take_datagram(struct modbus_line *line, const uint8_t *bytes, size_t length, int64_t now_ns)
{
	if (modbus_mbap_length(bytes, length) == length)
		take_frame(line, bytes, length, now_ns);
	else
		line->counters.noise_bytes += (uint32_t)length;
}

static bool receive(struct modbus_line *line, const uint8_t *bytes, size_t length, int64_t now_ns)
{
	if (line->wire.datagrams) {
		take_datagram(line, bytes, length, now_ns);
		return true;
	}
	for (size_t i = 0; i < length; i++) {
		line->stream[line->stream_count++] = bytes[i];
		size_t whole = modbus_mbap_length(line->stream, line->stream_count);

		if (whole == 0)
			return false;
		if (line->stream_count < whole)
			continue;
		line->stream_count = 0;
		modbus_connection_answered(line);
		take_frame(line, line->stream, whole, now_ns);
	}
	return true;
}

const struct modbus_framer modbus_tcp_framer = {
    .build = build, .receive = receive, .remember_unanswered = remember_unanswered, .has_gateways = true};
