/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Points and their commands. */
#include "rows/rows.h"

#include "map/meaning.h"
#include "map/text.h"
#include "map/time_ns.h"
#include "map/type.h"
#include "rows/words.h"

json_t *rows_point_name(const struct map_config *config, uint32_t point)
{
	char name[MAP_NAME_SIZE];

	map_point_name(config, &config->points[point], name);
	return json_string(name);
}

json_t *rows_age(int64_t time_ns)
{
	return time_ns == 0 ? json_null() : json_real((double)(map_now_ns() - time_ns) / NS_PER_S);
}

json_t *rows_module_name(const struct map *map, uint32_t index)
{
	struct map_module module;

	if (index >= map_module_count(map))
		return json_null();
	map_module(map, index, &module);
	return json_string(module.name);
}

void rows_set_meaning(json_t *row, const char *key, const struct map_config *config, uint32_t point,
		      union map_value value)
{
	const char *meaning = map_meaning(config, point, value);

	if (*meaning != '\0')
		json_object_set_new(row, key, json_string(meaning));
}

json_t *rows_value(const struct map *map, uint32_t point, const union map_value *value)
{
	const struct map_point *object = &map_config(map)->points[point];
	char text[MAP_TEXT_SIZE];

	if (!(object->flags & MAP_POINT_TEXT))
		return words_value(object->type, value);
	return map_text_of(map, point, *value, text) ? json_string(text) : json_null();
}

json_t *rows_type(const struct map_config *config, uint32_t point)
{
	const struct map_point *object = &config->points[point];

	return json_string(object->flags & MAP_POINT_TEXT ? "text" : words_type(object->type));
}

json_t *rows_point(const struct map *map, uint32_t index)
{
	const struct map_config *config = map_config(map);
	const struct map_point *point = &config->points[index];
	const struct map_set *set = &config->sets[point->set];
	struct map_sample sample = {.quality = MAP_INVALID};
	json_t *row = json_object();
	char quality[WORDS_SIZE];

	map_read(map, index, &sample);
	words_quality(sample.quality, quality);
	json_object_set_new(row, "name", rows_point_name(config, index));
	json_object_set_new(row, "type", rows_type(config, index));
	json_object_set_new(row, "value",
			    sample.time_ns != 0 ? rows_value(map, index, &sample.value) : json_null());
	if (sample.time_ns != 0)
		rows_set_meaning(row, "meaning", config, index, sample.value);
	if (point->type == MAP_STEP)
		json_object_set_new(row, "transient", json_boolean(sample.detail & 1));
	json_object_set_new(row, "quality", json_string(quality));
	json_object_set_new(row, "age_s", rows_age(sample.time_ns));
	json_object_set_new(row, "owner", rows_module_name(map, map_owner(map, index)));
	json_object_set_new(row, "ca", json_integer(set->ca));
	json_object_set_new(row, "ioa", json_integer(point->ioa));
	json_object_set_new(row, "never_read", json_boolean(point->flags & MAP_POINT_NEVER_READ));
	json_object_set_new(row, "forced", rows_force_of_point(map, index));
	return row;
}

/* Without what the configuration does not say of it. */
static void set_present(json_t *row, const struct map *map, uint32_t index)
{
	const struct map_point *point = &map_config(map)->points[index];
	const char *unit = map_unit_of(map_config(map), point);
	struct map_sample sample = {.quality = MAP_INVALID};
	char quality[WORDS_SIZE], expected[WORDS_LONG_SIZE];

	map_read(map, index, &sample);
	words_quality(sample.quality, quality);
	if (sample.time_ns != 0)
		rows_set_meaning(row, "present_meaning", map_config(map), index, sample.value);
	json_object_set_new(row, "present",
			    sample.time_ns != 0 ? words_value(point->type, &sample.value) : json_null());
	json_object_set_new(row, "quality", json_string(quality));
	if (*unit != '\0')
		json_object_set_new(row, "unit", json_string(unit));
	json_object_set_new(row, "expected",
			    json_string(words_expected_of(map_config(map), index, expected)));
	if (point->min < point->max) {
		json_object_set_new(row, "min", json_real(map_shortest(point->min)));
		json_object_set_new(row, "max", json_real(map_shortest(point->max)));
	}
}

json_t *rows_command(const struct map *map, uint32_t index)
{
	const struct map_point *point = &map_config(map)->points[index];
	struct map_command command = {.state = MAP_INACTIVE};
	bool used = map_command_read(map, index, &command) && command.time_ns != 0;
	json_t *row = json_object();

	json_object_set_new(row, "name", rows_point_name(map_config(map), index));
	json_object_set_new(row, "type", json_string(words_type(point->type)));
	json_object_set_new(row, "state", json_string(map_command_state_name(command.state)));
	json_object_set_new(row, "result", json_string(map_command_result_name(command.result)));
	if (command.result == MAP_RESULT_EXCEPTION)
		json_object_set_new(row, "exception", json_integer(command.detail));
	json_object_set_new(row, "value", used ? words_value(point->type, &command.value) : json_null());
	if (used)
		rows_set_meaning(row, "meaning", map_config(map), index, command.value);
	json_object_set_new(row, "age_s", rows_age(command.time_ns));
	json_object_set_new(row, "requester", used ? rows_module_name(map, command.requester) : json_null());
	json_object_set_new(row, "select", json_boolean(point->flags & MAP_POINT_SELECT));
	set_present(row, map, index);
	return row;
}
