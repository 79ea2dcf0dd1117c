/* SPDX-License-Identifier: GPL-3.0-or-later */
/* libFuzzer on what gpsd sends. What must hold: a fix has a position on the Earth, and its fields are in their ranges. */
#include <string.h>

#include "fuzz/target.h"
#include "gps/gpsd.h"
#include "map/time_ns.h"

#define BUILT_DAYS 20000

static struct gpsd_reader reader;

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct gps_fix fix;

	gpsd_reader_init(&reader, "", BUILT_DAYS);
	while (gpsd_reader_take(&reader, &data, &size, 1, &fix)) {
		CHECK(fix.latitude >= -900000000 && fix.latitude <= 900000000);
		CHECK(fix.longitude >= -1800000000 && fix.longitude <= 1800000000);
		CHECK((fix.method != GPS_NO_FIX) == ((fix.known & GPS_POSITION) != 0) &&
		      fix.method < GPS_METHODS);
		CHECK(fix.course < 36000 && fix.day_ms >= -1 && fix.day_ms < 86401000);
		CHECK(fix.sky.count <= GPS_SKY_MAX);
		CHECK(!(fix.known & GPS_TIME) || fix.time_ns >= BUILT_DAYS * S_PER_DAY * NS_PER_S);
	}
	CHECK(reader.size <= GPSD_LINE_MAX);
	return 0;
}
