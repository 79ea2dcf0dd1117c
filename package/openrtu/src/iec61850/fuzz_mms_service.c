/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on the services: the input is a PDU. Whatever it is, the answer is one whole element of BER that the agreed size holds,
 * or nothing. What it commands is answered by the map in one way or another, and so is what it then waits for.
 */
#include "iec61850/block.h"
#include "iec61850/control.h"
#include "iec61850/fuzz_map.h"
#include "iec61850/report.h"

static uint8_t octets[FUZZ_MAX_PDU];

static void check_whole(const struct ber_writer *writer)
{
	struct ber_reader reader = {octets + writer->at, octets + sizeof(octets)};
	struct ber_element answer;

	CHECK(!writer->full && ber_next(&reader, &answer) && reader.at == reader.end);
}

/* Ends what the client has begun: with an answer of any kind, with the reports that it wants, then with its going. */
static void end_commands(struct iec61850_server *server, uint8_t how)
{
	for (unsigned i = 0; i < IEC61850_CONTROLS; i++) {
		const struct map_answer answer = {
		    .id = server->controls[i].request.id, .state = how % 10, .result = how / 10 % 11};

		iec61850_control_answer(server, &answer);
	}
	iec61850_controls_tick(server);
	for (;;) {
		struct ber_writer writer = {.octets = octets, .at = sizeof(octets)};

		if (!iec61850_control_put(server, &writer, true) && !iec61850_report_put(server, &writer))
			break;
		check_whole(&writer);
	}
	iec61850_blocks_release(server, server->client);
	iec61850_controls_release(server, server->client);
	iec61850_file_release(server, server->client);
	iec61850_lists_release(server, server->client);
	memset(server->controls, 0, sizeof(server->controls));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	const struct ber_element pdu = {.value = data, .size = size};
	struct ber_writer writer = {.octets = octets, .at = sizeof(octets)};
	struct iec61850_server *server = fuzz_server();

	fuzz_changes(server);
	server->now_ns = NS_PER_S;
	server->client = octets;
	server->may_control = true;
	if (iec61850_serve(server, &pdu, &writer) == IEC61850_SILENT)
		CHECK(writer.at == sizeof(octets));
	else
		check_whole(&writer);
	end_commands(server, size > 0 ? data[size - 1] : 0);
	return 0;
}
