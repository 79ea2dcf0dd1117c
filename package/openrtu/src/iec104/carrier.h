/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Points of types that the standard does not have. */
#ifndef OPENRTU_IEC104_CARRIER_H
#define OPENRTU_IEC104_CARRIER_H

#include "map/map.h"
#include "map/type.h"

/*
 * The type of the standard that carries a point of this type. An integer goes as a bitstring of 32 bits, which keeps them all; an
 * angle as a short float in degrees, which keeps 24: from 128 degrees on the nearest multiple of 2^-16 degree, 0.85 m off at most
 * on the equator. A position goes exactly as geoposition.h has it.
 */
static inline enum map_type iec104_carrier_of(const struct map_point *point)
{
	return map_types[point->type].carrier;
}

/* A value that came by the carrier of a point's type, as the point has it. False: it cannot hold it; out is not written. */
bool iec104_take_carried(const struct map_point *point, union map_value carried, union map_value *out);

#endif
