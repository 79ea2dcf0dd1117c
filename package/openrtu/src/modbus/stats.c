/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modbus/stats.h"

#include "modbus/config.h"

/* Each module has room for all lines, then for all devices: a number is a place. */
size_t modbus_stats_size(const struct map_config *config)
{
	return modbus_port_count(config) * sizeof(struct modbus_line_stats) +
	       modbus_slave_count(config) * sizeof(struct modbus_device_stats);
}

bool modbus_is_known(const struct map *map)
{
	const struct map_config *config = map_config(map);
	const uint32_t module = map_module_of_kind(map, MODBUS_KIND);

	return modbus_settings(config) != NULL && modbus_ports(config) != NULL &&
	       modbus_slaves(config) != NULL && modbus_points(config) != NULL &&
	       (module == MAP_NONE || map_section(map, module, modbus_stats_size(config)) != NULL);
}

struct modbus_line_stats *modbus_line_stats(const struct map *map, uint32_t line)
{
	const struct map_config *config = map_config(map);
	struct modbus_line_stats *lines =
	    map_section(map, modbus_ports(config)[line].module, modbus_stats_size(config));

	return &lines[line];
}

struct modbus_device_stats *modbus_device_stats(const struct map *map, uint32_t device)
{
	const struct map_config *config = map_config(map);
	const uint32_t line = modbus_slaves(config)[device].port;
	struct modbus_device_stats *devices =
	    (void *)(modbus_line_stats(map, line) - line + modbus_port_count(config));

	return &devices[device];
}
