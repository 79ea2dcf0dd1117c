/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on the services: the input is a PDU. Whatever it is, the answer is one whole element of BER that the agreed size holds,
 * or nothing.
 */
#include "iec61850/fuzz_map.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static uint8_t octets[FUZZ_MAX_PDU];
	const struct ber_element pdu = {.value = data, .size = size};
	struct ber_writer writer = {.octets = octets, .at = sizeof(octets)};
	struct ber_reader reader;
	struct ber_element answer;

	if (iec61850_serve(fuzz_server(), &pdu, &writer) == IEC61850_SILENT) {
		CHECK(writer.at == sizeof(octets));
		return 0;
	}
	reader = (struct ber_reader){octets + writer.at, octets + sizeof(octets)};
	CHECK(!writer.full && ber_next(&reader, &answer) && reader.at == reader.end);
	return 0;
}
