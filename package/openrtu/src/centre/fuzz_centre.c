/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on the consumer's requests: the input is a packet. What must hold: what is read is a request whose octets are all
 * looked at, and a command that is one encodes to octets from which the same command is decoded.
 */
#include <string.h>

#include "centre/request.h"
#include "fuzz/target.h"

static void check_command(const struct centre_request *request)
{
	uint8_t object[IEC104_IOA_SIZE + IEC104_ELEMENT_MAX] = {0};
	struct iec104_command command, decoded;
	uint8_t type = 0;
	size_t size;

	if (!centre_request_command(request, &command))
		return;
	size = iec104_command_encode(object + IEC104_IOA_SIZE, &command, &type);
	CHECK(size > 0 && size <= IEC104_ELEMENT_MAX - IEC104_TIME56_SIZE);
	CHECK(iec104_command_decode(type, object, &decoded));
	CHECK(decoded.type == command.type && decoded.value.u == command.value.u &&
	      decoded.step == command.step);
	CHECK(command.type == MAP_BITSTRING ||
	      (decoded.select == command.select && decoded.qualifier == command.qualifier));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct centre_request request;

	for (size_t at = 0; at < size && centre_request_read(data + at, size - at, &request);
	     at += sizeof(request)) {
		CHECK(request.id != 0);
		check_command(&request);
	}
	return 0;
}
