/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "journal/stats.h"

struct journal_stats *journal_stats_of(const struct map *map)
{
	uint32_t module = map_module_of_kind(map, JOURNAL_KIND);

	return module == MAP_NONE ? NULL : map_section(map, module, sizeof(struct journal_stats));
}

void journal_name_counters(struct map *map)
{
	const struct journal_stats *stats = journal_stats_of(map);
	const struct {
		const char *name;
		const _Atomic uint32_t *counter;
	} counters[] = {
	    {"records", &stats->records}, {"kib", &stats->kib},           {"failures", &stats->failures},
	    {"events", &stats->events},   {"left_out", &stats->left_out}, {"longest_ms", &stats->longest_ms},
	    {"failing", &stats->failing},
	};

	_Static_assert(sizeof(counters) / sizeof(counters[0]) == JOURNAL_COUNTERS, "all are planned");
	for (size_t i = 0; i < JOURNAL_COUNTERS; i++)
		map_name_counter(map, counters[i].counter, "%s", counters[i].name);
}
