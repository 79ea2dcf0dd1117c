/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/geoposition.h"

/* Octets of the element. */
enum { LATITUDE = 0, LONGITUDE = 4, ALTITUDE = 8, FIX = 11, QUALITY = 12, TIME = 13 };

#define ALTITUDE_MIN   (-(1 << 23))
#define ALTITUDE_MAX   ((1 << 23) - 1)
#define NIBBLE         0x0f
#define QUARTER_E7     900000000
#define HALF_CIRCLE_E7 1800000000

_Static_assert(TIME + IEC104_TIME56_SIZE == IEC104_GEOPOSITION_SIZE, "the octets of the element");
_Static_assert(IEC104_APCI_SIZE + IEC104_ASDU_HEADER + IEC104_IOA_SIZE + IEC104_GEOPOSITION_SIZE == 35,
	       "of the APDU");

static void put_octets(uint8_t *octets, int32_t value, unsigned count)
{
	for (unsigned i = 0; i < count; i++)
		octets[i] = (uint8_t)((uint32_t)value >> 8 * i);
}

static int32_t get_i32(const uint8_t *octets)
{
	return (int32_t)(octets[0] | (uint32_t)octets[1] << 8 | (uint32_t)octets[2] << 16 |
			 (uint32_t)octets[3] << 24);
}

static int32_t get_i24(const uint8_t *octets)
{
	int32_t value = octets[0] | octets[1] << 8 | octets[2] << 16;

	return value > ALTITUDE_MAX ? value - (1 << 24) : value;
}

static int32_t within(int32_t value, int32_t low, int32_t high)
{
	if (value < low)
		return low;
	return value > high ? high : value;
}

bool iec104_is_private(unsigned type)
{
	return type >= IEC104_PRIVATE_FIRST && type <= IEC104_PRIVATE_LAST;
}

void iec104_geoposition_encode(uint8_t out[IEC104_GEOPOSITION_SIZE],
			       const struct iec104_geoposition *position, const struct map_zone *zone)
{
	int32_t altitude_dm = within(position->altitude_dm, ALTITUDE_MIN, ALTITUDE_MAX);
	uint8_t satellites = position->satellites > NIBBLE ? NIBBLE : position->satellites;

	put_octets(out + LATITUDE, position->latitude, 4);
	put_octets(out + LONGITUDE, position->longitude, 4);
	put_octets(out + ALTITUDE, altitude_dm, 3);
	out[FIX] = (uint8_t)((position->fix & NIBBLE) | satellites << 4);
	out[QUALITY] =
	    (uint8_t)(position->quality | (altitude_dm != position->altitude_dm ? MAP_OVERFLOW : 0));
	iec104_time56_encode(out + TIME, position->wall_ns, position->time_invalid, zone);
}

bool iec104_geoposition_decode(const uint8_t element[IEC104_GEOPOSITION_SIZE], const struct map_zone *zone,
			       struct iec104_geoposition *out)
{
	*out = (struct iec104_geoposition){
	    .latitude = get_i32(element + LATITUDE),
	    .longitude = get_i32(element + LONGITUDE),
	    .altitude_dm = get_i24(element + ALTITUDE),
	    .fix = element[FIX] & NIBBLE,
	    .satellites = element[FIX] >> 4,
	    .quality = element[QUALITY],
	};
	out->time_invalid = !iec104_time56_decode(element + TIME, zone, &out->wall_ns);
	return within(out->latitude, -QUARTER_E7, QUARTER_E7) == out->latitude &&
	       within(out->longitude, -HALF_CIRCLE_E7, HALF_CIRCLE_E7) == out->longitude;
}
