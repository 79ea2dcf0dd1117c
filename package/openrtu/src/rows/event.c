/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What happened: events and lines of the log. */
#include "rows/rows.h"

#include "rows/words.h"

static void event_time(const struct map *map, int64_t time_ns, char *out)
{
	words_time(map_wall_ns(map_clock_read(map), time_ns), out);
}

static json_t *change_row(const struct map *map, const struct map_event *event)
{
	const struct map_point *point = &map_config(map)->points[event->point];
	char time[WORDS_SIZE], quality[WORDS_SIZE];
	json_t *row = json_object();

	words_time(map_event_wall_ns(event, map_clock_read(map)), time);
	words_quality(event->sample.quality, quality);
	json_object_set_new(row, "time", json_string(time));
	json_object_set_new(row, "event", json_string("change"));
	json_object_set_new(row, "name", rows_point_name(map_config(map), event->point));
	json_object_set_new(row, "type", rows_type(map_config(map), event->point));
	json_object_set_new(row, "value", rows_value(map, event->point, &event->sample.value));
	rows_set_meaning(row, "meaning", map_config(map), event->point, event->sample.value);
	if (point->type == MAP_STEP)
		json_object_set_new(row, "transient", json_boolean(event->sample.detail & 1));
	json_object_set_new(row, "quality", json_string(quality));
	json_object_set_new(row, "cause", json_string(words_cause(event->cause)));
	if (event->past)
		json_object_set_new(row, "past", json_true());
	return row;
}

static json_t *other_row(const struct map *map, const struct map_event *event)
{
	static const char *const words[] = {[MAP_EVENT_MODULE_DOWN] = "module down",
					    [MAP_EVENT_MODULE_UP] = "module up",
					    [MAP_EVENT_CLOCK] = "clock set"};
	char time[WORDS_SIZE];
	json_t *row = json_object();
	struct map_module module;

	event_time(map, event->sample.time_ns, time);
	json_object_set_new(row, "time", json_string(time));
	json_object_set_new(row, "event", json_string(words[event->kind]));
	if (event->kind != MAP_EVENT_CLOCK) {
		map_module(map, event->point, &module);
		json_object_set_new(row, "name", json_string(module.name));
	}
	return row;
}

json_t *rows_event(const struct map *map, const struct map_event *event)
{
	return event->kind == MAP_EVENT_CHANGE ? change_row(map, event) : other_row(map, event);
}

json_t *rows_log(const struct map *map, uint32_t module, const struct map_log_line *line)
{
	struct map_module description;
	char time[WORDS_SIZE];

	map_module(map, module, &description);
	event_time(map, line->time_ns, time);
	return json_pack("{s:s, s:s, s:s, s:s}", "time", time, "module", description.name, "level",
			 words_log_level(line->level), "text", line->text);
}
