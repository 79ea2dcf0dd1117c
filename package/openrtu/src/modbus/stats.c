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

void modbus_name_counters(struct map *map, uint32_t line)
{
	const struct modbus_line_stats *stats = modbus_line_stats(map, line);
	const struct {
		const char *name;
		const _Atomic uint32_t *counter;
	} counters[] = {
	    {"requests", &stats->requests},
	    {"answers", &stats->answers},
	    {"exceptions", &stats->exceptions},
	    {"timeouts", &stats->timeouts},
	    {"crc_errors", &stats->crc_errors},
	    {"wrong_units", &stats->wrong_units},
	    {"wrong_functions", &stats->wrong_functions},
	    {"wrong_lengths", &stats->wrong_lengths},
	    {"wrong_answers", &stats->wrong_answers},
	    {"late_answers", &stats->late_answers},
	    {"unasked_frames", &stats->unasked_frames},
	    {"echoes", &stats->echoes},
	    {"noise_bytes", &stats->noise_bytes},
	    {"stuck_s", &stats->stuck_s},
	    {"commands", &stats->commands},
	    {"scan_us", &stats->scan_us},
	    {"port_errors", &stats->port_errors},
	    {"open", &stats->open},
	};

	_Static_assert(sizeof(counters) / sizeof(counters[0]) == MODBUS_LINE_COUNTERS, "all are planned");
	for (size_t i = 0; i < MODBUS_LINE_COUNTERS; i++)
		map_name_counter(map, counters[i].counter, "p%u.%s", modbus_ports(map_config(map))[line].port,
				 counters[i].name);
}
