/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/config.h"

#include <stdio.h>

void map_point_name(const struct map_config *config, const struct map_point *point, char out[MAP_NAME_SIZE])
{
	static const char letters[] = {'c', 'd', 'i', 'h'}; /* of each table */
	const struct map_device *device = &config->devices[point->device];

	if (point->name != 0)
		snprintf(out, MAP_NAME_SIZE, "%s", &config->names[point->name]);
	else if (map_point_is_register_bit(point))
		snprintf(out, MAP_NAME_SIZE, "p%u.%u.%c%u.%u", config->lines[device->line].port, device->unit,
			 letters[point->table], point->address, point->bit);
	else
		snprintf(out, MAP_NAME_SIZE, "p%u.%u.%c%u", config->lines[device->line].port, device->unit,
			 letters[point->table], point->address);
}
