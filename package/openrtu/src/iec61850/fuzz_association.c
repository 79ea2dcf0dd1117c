/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on a connection: the input are messages of the session layer, each behind two octets of its length, first of all one
 * of the peer's or one that associates. What goes out is whole TPKTs.
 */
#include "fuzz/input.h"
#include "iec61850/association.h"
#include "iec61850/fuzz_map.h"

static struct iec61850_association association;
static uint8_t scratch[IEC61850_MESSAGE_SIZE(FUZZ_MAX_PDU)];

static void check_output(void)
{
	struct iec61850_transport *transport = &association.transport;
	size_t size, at = 0;
	const uint8_t *octets = iec61850_transport_output(transport, &size);

	while (at < size) {
		CHECK(size - at >= 7 && octets[at] == 3);
		at += (size_t)octets[at + 2] << 8 | octets[at + 3];
	}
	CHECK(at == size);
	iec61850_association_written(&association, size, NS_PER_S);
}

/* Hands over a message in one TPKT. */
static enum iec61850_end hand_over(const uint8_t *octets, size_t size)
{
	size_t room;
	uint8_t *space = iec61850_transport_space(&association.transport, &room);
	const size_t whole = size + IEC61850_DATA_HEADER;

	if (whole > room)
		return IEC61850_STUCK;
	memcpy(space, (const uint8_t[]){3, 0, (uint8_t)(whole >> 8), (uint8_t)whole, 2, 0xf0, 0x80},
	       IEC61850_DATA_HEADER);
	memcpy(space + IEC61850_DATA_HEADER, octets, size);
	iec61850_transport_received(&association.transport, whole);
	return iec61850_association_run(&association, fuzz_server(), scratch, NS_PER_S);
}

static void open_association(void)
{
	static uint8_t input_octets[IEC61850_INPUT_SIZE], message[IEC61850_MESSAGE_SIZE(FUZZ_MAX_PDU)],
	    output[IEC61850_OUTPUT_SIZE(FUZZ_MAX_PDU)];

	association.transport = (struct iec61850_transport){.input = input_octets,
							    .message = message,
							    .output = output,
							    .message_size = sizeof(message),
							    .output_size = sizeof(output)};
	iec61850_association_end(&association, fuzz_server());
	iec61850_association_open(&association, FUZZ_MAX_PDU, 0);
	association.may_control = true;
	association.transport.connected = true;
	if (next_octet() & 1) {
		association.associated = true;
		association.contexts = (struct iec61850_contexts){.acse = 1, .mms = 3};
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	enum iec61850_end end = IEC61850_STAYS;

	input = (struct input){.at = data, .end = data + size};
	open_association();
	while (end == IEC61850_STAYS && input.at < input.end) {
		const size_t wanted = (size_t)next_octet() << 3, left = (size_t)(input.end - input.at);
		const size_t count = wanted < left ? wanted : left;

		end = hand_over(input.at, count);
		input.at += count;
		check_output();
	}
	return 0;
}
