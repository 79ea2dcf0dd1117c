/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A position in one information object, by a type of the private range (IEC 60870-5-101, 7.2.1: 136..255 for special use); 201
 * unless configured otherwise. With APCI, data unit identifier and address it is an APDU of 35 octets:
 * docs/positioning.md, docs/figures/asdu-201.svg.
 */
#ifndef OPENRTU_IEC104_GEOPOSITION_H
#define OPENRTU_IEC104_GEOPOSITION_H

#include "iec104/asdu.h"

#define IEC104_GEOPOSITION      201
#define IEC104_GEOPOSITION_SIZE 20 /* octets of the element, time tag included */
#define IEC104_PRIVATE_FIRST    136
#define IEC104_PRIVATE_LAST     255

struct iec104_geoposition {
	int32_t latitude;  /* 1e-7 degree, north positive */
	int32_t longitude; /* 1e-7 degree, east positive */
	int32_t
	    altitude_dm; /* above mean sea level, -838 860.8 m to 838 860.7 m; beyond, the nearest with OV */
	uint8_t fix; /* quality indicator of GGA (NMEA 0183): 0 none, 1 autonomous .. 8 simulated; 0..15 */
	uint8_t satellites; /* used; 15 stands for 15 and more */
	uint8_t quality;    /* QDS: enum map_quality */
	bool time_invalid;
	int64_t wall_ns; /* of the fix: since 1970, UTC */
};

/* May a position have this type. */
bool iec104_is_private(unsigned type);

/* Encodes the element. */
void iec104_geoposition_encode(uint8_t out[IEC104_GEOPOSITION_SIZE],
			       const struct iec104_geoposition *position, const struct map_zone *zone);
/* False: latitude or longitude are beyond 90 or 180 degrees. A time tag that is none has time_invalid. */
bool iec104_geoposition_decode(const uint8_t element[IEC104_GEOPOSITION_SIZE], const struct map_zone *zone,
			       struct iec104_geoposition *out);

#endif
