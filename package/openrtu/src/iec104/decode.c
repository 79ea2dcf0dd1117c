/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * For the tests: ASDUs in, information objects out. An ASDU is a line with its number of octets, and the octets; an object
 * is a line of JSON.
 *
 *	iec104-decode NOW < ASDUs; NOW: the wall time in ns since 1970
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "iec104/information.h"

static void print_object(uint8_t type, const struct iec104_information *object)
{
	printf("{\"type\": %u, \"ioa\": %" PRIu32 ", \"content\": %u, \"u\": %" PRIu32 ", \"i\": %" PRId32
	       ", \"quality\": %u, \"detail\": %u, \"elapsed_ms\": %u, \"tagged\": %d, \"time_invalid\": %d, "
	       "\"wall_ns\": %" PRId64 "}\n",
	       type, object->ioa, object->content, object->value.u, object->value.i, object->quality,
	       object->detail, object->elapsed_ms, object->tagged, object->time_invalid, object->wall_ns);
}

int main(int argc, char **argv)
{
	static const struct map_zone utc;
	uint8_t bytes[IEC104_ASDU_MAX];
	struct iec104_information object;
	struct iec104_asdu asdu;
	unsigned size;

	if (argc != 2)
		return 2;
	while (scanf("%u", &size) == 1) {
		if (getchar() != '\n' || size > sizeof(bytes) || fread(bytes, 1, size, stdin) != size ||
		    !iec104_asdu_decode(bytes, size, &asdu))
			return 2;
		for (unsigned i = 0;
		     iec104_information_decode(&asdu, i, &utc, strtoll(argv[1], NULL, 10), &object); i++)
			print_object(asdu.type, &object);
	}
	return 0;
}
