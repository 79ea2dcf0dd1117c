/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on ASDUs in monitoring direction, of any type, length and number of objects. What must hold: an object is decoded
 * only of an ASDU that is as long as it says, values are in their ranges, and a position is encoded as it came, but for the
 * bits of a time tag that carry nothing.
 */
#include <string.h>

#include "fuzz/target.h"
#include "iec104/geoposition.h"
#include "iec104/information.h"

#define TIME_AT (IEC104_GEOPOSITION_SIZE - IEC104_TIME56_SIZE)
#define NOW_NS  1110965882000000000

static const struct map_zone utc;

static void check_position(const uint8_t *element)
{
	uint8_t again[IEC104_GEOPOSITION_SIZE];
	struct iec104_geoposition position, same;

	if (!iec104_geoposition_decode(element, &utc, &position))
		return;
	iec104_geoposition_encode(again, &position, &utc);
	CHECK(memcmp(element, again, TIME_AT) == 0);
	CHECK(iec104_geoposition_decode(again, &utc, &same));
	CHECK(same.time_invalid == position.time_invalid);
	CHECK(position.time_invalid || same.wall_ns == position.wall_ns);
}

static void check_information(const struct iec104_asdu *asdu, unsigned place)
{
	struct iec104_information information;

	if (!iec104_information_decode(asdu, place, &utc, NOW_NS, &information))
		return;
	CHECK(information.content != IEC104_SINGLE || information.value.u <= 1);
	CHECK(information.content != IEC104_STEP ||
	      (information.value.i >= -64 && information.value.i <= 63));
	CHECK(information.tagged || (!information.time_invalid && information.wall_ns == 0));
	CHECK(information.ioa < 1u << 24 || asdu->sequence);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct iec104_asdu asdu;
	uint32_t ioa;

	if (!iec104_asdu_decode(data, size, &asdu))
		return 0;
	for (unsigned i = 0; i <= asdu.count; i++) {
		const uint8_t *element = iec104_object(&asdu, IEC104_GEOPOSITION_SIZE, i, &ioa);

		check_information(&asdu, i);
		if (element == NULL)
			continue;
		CHECK(i < asdu.count && element >= data && element + IEC104_GEOPOSITION_SIZE <= data + size);
		check_position(element);
	}
	return 0;
}
