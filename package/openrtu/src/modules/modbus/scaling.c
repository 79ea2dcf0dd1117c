/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/modbus/scaling.h"

#include "map/value.h"
#include "modbus/convert.h"

#define UNKNOWN 1e300 /* no factor, no power of ten */

/* False: the point names none. number: UNKNOWN if it is not known. */
static bool number_of(const struct map *map, uint32_t point, const struct modbus_extra *extra, unsigned link,
		      double *number)
{
	const struct map_config *config = map_config(map);
	uint32_t other;
	struct map_sample sample;

	if (extra->links[link] == 0)
		return false;
	other = config->sets[config->points[point].set].first_point + extra->links[link] - 1u;
	sample = map_own_sample(map, other);
	/* Beyond its limits a value is not what the device has. */
	*number = sample.quality & (MAP_INVALID | MAP_OVERFLOW)
		      ? UNKNOWN
		      : map_number((enum map_type)config->points[other].type, sample.value);
	return true;
}

int8_t scaling_apply(const struct map *map, uint32_t point, int8_t exponent, struct modbus_point *wire)
{
	const struct modbus_extra *extra = modbus_extra_of(map_config(map), wire);
	double number;

	if (extra == NULL)
		return exponent;
	if (number_of(map, point, extra, MODBUS_FACTOR_BY, &number)) {
		if (number >= UNKNOWN || !(number < 0 || number > 0))
			return CONVERT_NO_EXPONENT;
		wire->scale *= number;
	}
	if (!number_of(map, point, extra, MODBUS_SCALE_BY, &number))
		return exponent;
	if (!(number >= -CONVERT_EXPONENT_MAX && number <= CONVERT_EXPONENT_MAX) || !map_is_whole(number))
		return CONVERT_NO_EXPONENT;
	return (int8_t)number;
}
