/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/modbus/scaling.h"

#include "map/value.h"
#include "modbus/convert.h"

#define UNKNOWN 1e300 /* no factor, no power of ten */

static struct map_sample sample_of(const struct map *map, uint32_t point, struct scaling_read read)
{
	for (size_t i = 0; i < read.count; i++)
		if (read.updates[i].point == point)
			return read.updates[i].sample;
	return map_own_sample(map, point);
}

/* False: the point names none. number: UNKNOWN if it is not known. */
static bool number_of(const struct map *map, uint32_t point, const struct modbus_extra *extra, unsigned link,
		      struct scaling_read read, double *number)
{
	const struct map_config *config = map_config(map);
	uint32_t other;
	struct map_sample sample;

	if (extra->links[link] == 0)
		return false;
	other = config->sets[config->points[point].set].first_point + extra->links[link] - 1u;
	sample = sample_of(map, other, read);
	/* Beyond its limits a value is not what the device has. */
	*number = sample.quality & (MAP_INVALID | MAP_OVERFLOW)
		      ? UNKNOWN
		      : map_number((enum map_type)config->points[other].type, sample.value);
	return true;
}

bool scaling_is_by_others(const struct map_config *config, const struct modbus_point *wire)
{
	const struct modbus_extra *extra = modbus_extra_of(config, wire);

	return extra != NULL && (extra->links[MODBUS_SCALE_BY] != 0 || extra->links[MODBUS_FACTOR_BY] != 0);
}

int8_t scaling_apply(const struct map *map, uint32_t point, int8_t exponent, struct modbus_point *wire,
		     struct scaling_read read)
{
	const struct modbus_extra *extra = modbus_extra_of(map_config(map), wire);
	double number;

	if (extra == NULL)
		return exponent;
	if (number_of(map, point, extra, MODBUS_FACTOR_BY, read, &number)) {
		if (number >= UNKNOWN || !(number < 0 || number > 0))
			return CONVERT_NO_EXPONENT;
		wire->scale *= number;
	}
	if (!number_of(map, point, extra, MODBUS_SCALE_BY, read, &number))
		return exponent;
	if (!(number >= -CONVERT_EXPONENT_MAX && number <= CONVERT_EXPONENT_MAX) || !map_is_whole(number))
		return CONVERT_NO_EXPONENT;
	return (int8_t)number;
}
