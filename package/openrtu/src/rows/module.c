/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rows/rows.h"

#include <string.h>

#include "journal/stats.h"
#include "map/time_ns.h"
#include "rows/words.h"

static json_t *journal_state(const struct map *map)
{
	const struct journal_stats *stats = journal_stats_of(map);
	uint32_t written_s = stats->written_s;
	json_t *state = json_object();

	json_object_set_new(state, "events", json_integer(stats->events));
	json_object_set_new(state, "written_s", rows_age(written_s * NS_PER_S));
	json_object_set_new(state, "records", json_integer(stats->records));
	json_object_set_new(state, "kib", json_integer(stats->kib));
	json_object_set_new(state, "longest_ms", json_integer(stats->longest_ms));
	json_object_set_new(state, "left_out", json_integer(stats->left_out));
	json_object_set_new(state, "failures", json_integer(stats->failures));
	json_object_set_new(state, "failing", json_boolean(stats->failing));
	return state;
}

json_t *rows_module(const struct map *map, uint32_t index)
{
	struct map_module module;
	json_t *row = json_object();

	map_module(map, index, &module);
	json_object_set_new(row, "name", json_string(module.name));
	json_object_set_new(row, "kind", json_string(module.kind));
	json_object_set_new(row, "state", json_string(words_module_state(module.state)));
	json_object_set_new(row, "alive", json_boolean(module.alive));
	json_object_set_new(row, "pid", module.pid != 0 ? json_integer(module.pid) : json_null());
	json_object_set_new(row, "up_s", module.alive ? rows_age(module.started_ns) : json_null());
	json_object_set_new(row, "starts", json_integer(module.generation));
	json_object_set_new(row, "restarts", json_integer(module.restarts));
	json_object_set_new(row, "points", json_integer(module.point_count));
	json_object_set_new(row, "lost_events", json_integer(module.lost_events));
	if (strcmp(module.kind, JOURNAL_KIND) == 0)
		json_object_set_new(row, "journal", journal_state(map));
	return row;
}

json_t *rows_counter(const char *module, const struct map_counter *counter)
{
	return json_pack("{s:s, s:s, s:I}", "module", module, "counter", counter->name, "value",
			 (json_int_t)counter->value);
}
