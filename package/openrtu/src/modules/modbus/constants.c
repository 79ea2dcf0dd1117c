/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/modbus/constants.h"

#include "map/type.h"
#include "modbus/convert.h"
#include "modules/modbus/operation.h"

/* rtud has checked that it can be written. */
static struct modbus_request request_of(const struct map_config *config, const struct modbus_keep *keep,
					uint8_t unit)
{
	const struct map_point *point = &config->points[keep->point];
	const struct modbus_point written = modbus_written(config, &modbus_points(config)[keep->point]);
	const struct map_sample none = {.quality = MAP_INVALID};
	struct map_request request = {.point = keep->point};
	struct operation operation = {.count = 0};

	map_value_of((enum map_type)point->type, keep->value, &request.value);
	operation_begin(point, &written, modbus_knots(config), convert_first_exponent(&written), unit,
			&request, &none, &operation);
	return operation.writes[0];
}

void constants_make(const struct map_config *config, struct modbus_device *device)
{
	for (uint32_t i = 0; i < device->kept_count; i++) {
		struct modbus_kept *kept = &device->kept[i];
		const struct modbus_keep *keeps;

		modbus_keeps_of(config, kept->tag, &keeps);
		for (uint32_t j = 0; j < kept->constant_count; j++)
			kept->constants[j] = request_of(config, &keeps[j], device->unit);
	}
}
