/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/carrier.h"

#include "map/type.h"

bool iec104_take_carried(const struct map_point *point, union map_value carried, union map_value *out)
{
	if (point->type == MAP_ANGLE)
		return map_value_of(MAP_ANGLE, (double)carried.f, out);
	*out = carried;
	return true;
}
