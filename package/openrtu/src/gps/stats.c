/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "gps/stats.h"

#include "gps/config.h"

struct gps_stats *gps_stats_of(const struct map *map)
{
	const uint32_t module = map_module_of_kind(map, GPS_KIND);
	const uint32_t count = map_record_count(map_config(map), GPS_RECEIVERS);

	return module == MAP_NONE ? NULL : map_section(map, module, count * sizeof(struct gps_stats));
}
