/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on the transport: the same octets, handed over at once and one by one, are the same messages, and what is wrong is
 * wrong either way.
 */
#include <string.h>

#include "fuzz/target.h"
#include "iec61850/transport.h"

#define MESSAGE_SIZE IEC61850_MESSAGE_SIZE(1000)
#define RESULTS      64

struct seen {
	enum iec61850_incoming results[RESULTS];
	size_t sizes[RESULTS];
	unsigned count;
};

static uint8_t input_octets[IEC61850_INPUT_SIZE], message[MESSAGE_SIZE], output[IEC61850_OUTPUT_SIZE(1000)];

static void look(struct iec61850_transport *transport, struct seen *seen)
{
	enum iec61850_incoming incoming;

	do {
		size_t size;

		iec61850_transport_output(transport, &size);
		iec61850_transport_written(transport, size);
		incoming = iec61850_transport_next(transport);
		CHECK(transport->message_end <= MESSAGE_SIZE &&
		      transport->input_begin <= transport->input_end);
		if (incoming != IEC61850_NOTHING && seen->count < RESULTS) {
			seen->results[seen->count] = incoming;
			seen->sizes[seen->count++] = transport->message_end;
		}
	} while (incoming == IEC61850_MESSAGE || !iec61850_transport_is_free(transport));
}

static void hand_over(const uint8_t *data, size_t size, size_t piece, struct seen *seen)
{
	struct iec61850_transport transport = {.input = input_octets,
					       .message = message,
					       .output = output,
					       .message_size = sizeof(message),
					       .output_size = sizeof(output)};

	*seen = (struct seen){.count = 0};
	iec61850_transport_open(&transport);
	while (size > 0 && (seen->count == 0 || seen->results[seen->count - 1] == IEC61850_MESSAGE)) {
		size_t room, count = size < piece ? size : piece;
		uint8_t *space = iec61850_transport_space(&transport, &room);

		if (count > room)
			count = room;
		CHECK(count > 0);
		memcpy(space, data, count);
		iec61850_transport_received(&transport, count);
		data += count;
		size -= count;
		look(&transport, seen);
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct seen whole, pieces;

	hand_over(data, size, SIZE_MAX, &whole);
	hand_over(data, size, 1, &pieces);
	CHECK(whole.count == pieces.count);
	CHECK(memcmp(whole.results, pieces.results, sizeof(whole.results)) == 0);
	CHECK(memcmp(whole.sizes, pieces.sizes, sizeof(whole.sizes)) == 0);
	return 0;
}
