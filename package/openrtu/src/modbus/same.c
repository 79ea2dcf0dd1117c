/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modbus/same.h"

#include <string.h>

#include "modbus/config.h"

static bool same_knots(const struct map_config *a, const struct modbus_point *of_a,
		       const struct map_config *b, const struct modbus_point *of_b)
{
	return of_a->knot_count == of_b->knot_count &&
	       (of_a->knot_count == 0 ||
		memcmp(&modbus_knots(a)[of_a->first_knot], &modbus_knots(b)[of_b->first_knot],
		       of_a->knot_count * sizeof(struct modbus_knot)) == 0);
}

static bool same_extra(const struct map_config *a, const struct modbus_point *of_a,
		       const struct map_config *b, const struct modbus_point *of_b)
{
	const struct modbus_extra *in_a = modbus_extra_of(a, of_a), *in_b = modbus_extra_of(b, of_b);

	if (in_a == NULL || in_b == NULL)
		return in_a == in_b;
	return memcmp(in_a, in_b, sizeof(*in_a)) == 0;
}

static bool same_keeps(const struct map_config *a, uint32_t in_a, const struct map_config *b, uint32_t in_b)
{
	const struct modbus_keep *of_a, *of_b;
	const uint32_t count = modbus_keeps_of(a, in_a, &of_a);

	if (modbus_keeps_of(b, in_b, &of_b) != count)
		return false;
	for (uint32_t i = 0; i < count; i++)
		if (of_a[i].period_ms != of_b[i].period_ms || of_a[i].has_value != of_b[i].has_value ||
		    memcmp(&of_a[i].value, &of_b[i].value, sizeof(of_a[i].value)) != 0)
			return false;
	return true;
}

bool modbus_same_point(const struct map_config *a, uint32_t in_a, const struct map_config *b, uint32_t in_b)
{
	struct modbus_point of_a = modbus_points(a)[in_a], of_b = modbus_points(b)[in_b];

	if (!same_knots(a, &of_a, b, &of_b) || !same_extra(a, &of_a, b, &of_b) ||
	    !same_keeps(a, in_a, b, in_b))
		return false;
	of_a.first_knot = of_b.first_knot = 0;
	of_a.extra = of_b.extra = 0;
	return memcmp(&of_a, &of_b, sizeof(of_a)) == 0; /* it has no padding */
}

_Static_assert(sizeof(struct modbus_point) == 32, "16 octets and two doubles");
