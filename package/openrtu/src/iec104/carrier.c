/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/carrier.h"

bool iec104_take_carried(const struct map_point *point, union map_value carried, union map_value *out)
{
	if (point->type != MAP_FLOAT && iec104_carrier_of(point) == MAP_FLOAT)
		return map_value_of((enum map_type)point->type, (double)carried.f, out);
	*out = carried;
	return true;
}
