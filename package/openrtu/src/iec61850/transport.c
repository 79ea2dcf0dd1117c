/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/transport.h"

#include <string.h>

#define TPKT_VERSION 3
#define TPKT_HEADER  4

/* Codes of TPDUs (ISO/IEC 8073, 13.1) and of the parameters of a connection (13.3.4). */
enum { CR = 0xe0, CC = 0xd0, DR = 0x80, DT = 0xf0, END_OF_MESSAGE = 0x80 };
enum { TPDU_SIZE = 0xc0, CALLING_SELECTOR = 0xc1, CALLED_SELECTOR = 0xc2 };

#define CONNECTION_FIXED 7 /* length, code, two references, class */
#define SELECTOR_MAX     32
#define OUR_REFERENCE    1

void iec61850_transport_open(struct iec61850_transport *transport)
{
	transport->input_begin = transport->input_end = transport->message_end = 0;
	transport->output_begin = transport->output_end = 0;
	transport->tpdu_size = 1 << IEC61850_TPDU_EXPONENT_MAX;
	transport->connected = transport->handed_on = false;
}

/* ---- octets that come -------------------------------------------------------------------- */

uint8_t *iec61850_transport_space(struct iec61850_transport *transport, size_t *size)
{
	const size_t waiting = transport->input_end - transport->input_begin;

	if (transport->input_begin > 0) {
		memmove(transport->input, transport->input + transport->input_begin, waiting);
		transport->input_begin = 0;
		transport->input_end = waiting;
	}
	*size = IEC61850_INPUT_SIZE - waiting;
	return transport->input + waiting;
}

void iec61850_transport_received(struct iec61850_transport *transport, size_t size)
{
	transport->input_end += size;
}

static void put(struct iec61850_transport *transport, const void *octets, size_t size)
{
	memcpy(transport->output + transport->output_end, octets, size);
	transport->output_end += size;
}

/*
 * 03 00 00 16  11 e0 0000 0001 00  c0 01 0d  c2 02 0001  c1 02 0001
 * The parameters come back as they were: who called names both selectors.
 */
static bool accept_connection(struct iec61850_transport *transport, const uint8_t *tpdu, size_t size)
{
	uint8_t answer[TPKT_HEADER + CONNECTION_FIXED + 3 + 2 * (2 + SELECTOR_MAX)] = {TPKT_VERSION};
	unsigned exponent = IEC61850_TPDU_EXPONENT_MAX;
	size_t end = TPKT_HEADER + CONNECTION_FIXED;

	if (size < CONNECTION_FIXED || (tpdu[6] & 0xf0) != 0) /* class 0 alone */
		return false;
	for (size_t at = CONNECTION_FIXED; at < size;) {
		const uint8_t *parameter = tpdu + at;

		if (size - at < 2 || size - at - 2 < parameter[1])
			return false;
		at += 2u + parameter[1];
		if (parameter[0] == TPDU_SIZE) {
			if (parameter[1] != 1 || parameter[2] < IEC61850_TPDU_EXPONENT_MIN)
				return false;
			if (parameter[2] < exponent)
				exponent = parameter[2];
		} else if (parameter[0] == CALLING_SELECTOR || parameter[0] == CALLED_SELECTOR) {
			if (parameter[1] > SELECTOR_MAX || end + 2 + parameter[1] + 3 > sizeof(answer))
				return false;
			memcpy(answer + end, parameter, 2u + parameter[1]);
			end += 2u + parameter[1];
		}
	}
	memcpy(answer + end, (const uint8_t[]){TPDU_SIZE, 1, (uint8_t)exponent}, 3);
	end += 3;
	answer[3] = (uint8_t)end;
	answer[4] = (uint8_t)(end - TPKT_HEADER - 1);
	answer[5] = CC;
	memcpy(answer + 6, tpdu + 4, 2); /* its reference is the destination now */
	answer[9] = OUR_REFERENCE;
	put(transport, answer, end);
	transport->tpdu_size = 1u << exponent;
	transport->connected = true;
	return true;
}

static enum iec61850_incoming take_data(struct iec61850_transport *transport, const uint8_t *tpdu,
					size_t size)
{
	const size_t count = size - 3;

	if (tpdu[0] != 2 || transport->message_size - transport->message_end < count)
		return IEC61850_WRONG;
	memcpy(transport->message + transport->message_end, tpdu + 3, count);
	transport->message_end += count;
	return (tpdu[2] & END_OF_MESSAGE) != 0 ? IEC61850_MESSAGE : IEC61850_NOTHING;
}

static enum iec61850_incoming take(struct iec61850_transport *transport, const uint8_t *tpdu, size_t size)
{
	if (size < 3 || tpdu[0] + 1u > size)
		return IEC61850_WRONG;
	if (!transport->connected)
		return (tpdu[1] & 0xf0) == CR && tpdu[0] + 1u == size &&
			       accept_connection(transport, tpdu, size)
			   ? IEC61850_NOTHING
			   : IEC61850_WRONG;
	if (tpdu[1] == DR)
		return IEC61850_ENDED;
	return tpdu[1] == DT ? take_data(transport, tpdu, size) : IEC61850_WRONG;
}

enum iec61850_incoming iec61850_transport_next(struct iec61850_transport *transport)
{
	enum iec61850_incoming result = IEC61850_NOTHING;

	if (!iec61850_transport_is_free(transport))
		return IEC61850_NOTHING;
	if (transport->handed_on)
		transport->message_end = 0;
	transport->handed_on = false;
	while (result == IEC61850_NOTHING && iec61850_transport_is_free(transport)) {
		const uint8_t *packet = transport->input + transport->input_begin;
		const size_t waiting = transport->input_end - transport->input_begin;
		size_t size;

		if (waiting < TPKT_HEADER)
			return waiting > 0 && packet[0] != TPKT_VERSION ? IEC61850_WRONG : IEC61850_NOTHING;
		size = (size_t)packet[2] << 8 | packet[3];
		if (packet[0] != TPKT_VERSION || size < IEC61850_DATA_HEADER || size > IEC61850_INPUT_SIZE)
			return IEC61850_WRONG;
		if (waiting < size)
			return IEC61850_NOTHING;
		transport->input_begin += size;
		result = take(transport, packet + TPKT_HEADER, size - TPKT_HEADER);
	}
	transport->handed_on = result == IEC61850_MESSAGE;
	return result;
}

/* ---- octets that go ---------------------------------------------------------------------- */

void iec61850_transport_send(struct iec61850_transport *transport, const uint8_t *octets, size_t size)
{
	const size_t most = transport->tpdu_size - 3;

	transport->output_begin = transport->output_end = 0;
	do {
		const size_t count = size < most ? size : most, length = count + IEC61850_DATA_HEADER;
		const uint8_t header[IEC61850_DATA_HEADER] = {TPKT_VERSION,
							      0,
							      (uint8_t)(length >> 8),
							      (uint8_t)length,
							      2,
							      DT,
							      count == size ? END_OF_MESSAGE : 0};

		put(transport, header, sizeof(header));
		put(transport, octets, count);
		octets += count;
		size -= count;
	} while (size > 0);
}

const uint8_t *iec61850_transport_output(const struct iec61850_transport *transport, size_t *size)
{
	*size = transport->output_end - transport->output_begin;
	return transport->output + transport->output_begin;
}

void iec61850_transport_written(struct iec61850_transport *transport, size_t size)
{
	transport->output_begin += size;
	if (transport->output_begin == transport->output_end)
		transport->output_begin = transport->output_end = 0;
}
