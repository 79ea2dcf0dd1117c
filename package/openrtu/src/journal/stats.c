/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "journal/stats.h"

struct journal_stats *journal_stats_of(const struct map *map)
{
	uint32_t module = map_module_of_kind(map, JOURNAL_KIND);

	return module == MAP_NONE ? NULL : map_section(map, module, sizeof(struct journal_stats));
}
