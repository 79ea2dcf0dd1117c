/* SPDX-License-Identifier: GPL-3.0-or-later */
/* One point, with what the lists leave out: parameters in force, and the reading that was frozen last. */
#include "rtuctl/rtuctl.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include <jansson.h>

#include "foreign/config.h"
#include "map/type.h"
#include "modbus/config.h"
#include "rows/rows.h"
#include "rows/words.h"
#include "rtuctl/listing.h"

#define KEY_WIDTH 15

static json_t *limit(double value)
{
	return isfinite(value) ? json_real(value) : json_null();
}

static json_t *loaded_names(uint32_t loaded)
{
	static const char *const names[] = {[MAP_THRESHOLD] = "threshold",
					    [MAP_SMOOTHING] = "smoothing_s",
					    [MAP_LOW_LIMIT] = "low_limit",
					    [MAP_HIGH_LIMIT] = "high_limit",
					    [MAP_CYCLIC] = "cyclic"};
	json_t *list = json_array();

	for (enum map_parameter kind = MAP_THRESHOLD; kind <= MAP_CYCLIC; kind++)
		if (loaded & 1u << kind)
			json_array_append_new(list, json_string(names[kind]));
	return list;
}

static void add_parameters(const struct map *map, uint32_t point, json_t *row)
{
	struct map_parameters parameters;

	map_parameters_read(map, point, &parameters);
	json_object_set_new(row, "threshold", json_real(parameters.threshold));
	json_object_set_new(row, "smoothing_s", json_real(parameters.smoothing_s));
	json_object_set_new(row, "low_limit", limit(parameters.low));
	json_object_set_new(row, "high_limit", limit(parameters.high));
	json_object_set_new(row, "cyclic", json_boolean(parameters.cyclic));
	json_object_set_new(row, "loaded", loaded_names(parameters.loaded));
}

static void add_total(const struct map *map, uint32_t point, json_t *row)
{
	struct map_sample total;
	char quality[WORDS_SIZE];

	if (!map_total_read(map, point, &total))
		return;
	words_quality(total.quality, quality);
	json_object_set_new(row, "frozen", words_value(MAP_COUNTER, &total.value));
	json_object_set_new(row, "frozen_quality", json_string(quality));
	json_object_set_new(row, "sequence", json_integer(total.detail & MAP_COUNTER_SEQUENCE));
	json_object_set_new(row, "carry", json_boolean(total.detail & MAP_COUNTER_CARRY));
	json_object_set_new(row, "adjusted", json_boolean(total.detail & MAP_COUNTER_ADJUSTED));
}

static void add_details(const struct map *map, uint32_t point, json_t *row)
{
	switch (map_class_of(&map_config(map)->points[point])) {
	case MAP_CLASS_MEASURED:
		add_parameters(map, point, row);
		break;
	case MAP_CLASS_TOTAL:
		add_total(map, point, row);
		break;
	case MAP_CLASS_STATE:
	case MAP_CLASS_POSITION:
	case MAP_CLASS_PATTERN:
		break;
	}
}

/* NULL: it is none of a Modbus device. */
static const struct modbus_point *wire_of(const struct map_config *config, uint32_t point)
{
	return point < map_record_count(config, MODBUS_POINTS) ? &modbus_points(config)[point] : NULL;
}

/* Null: it is read in turn. */
static json_t *period(const struct modbus_point *point)
{
	return point != NULL && point->scan_period_ms > 0 ? json_integer(point->scan_period_ms) : json_null();
}

static json_t *scale_register(const struct modbus_point *point)
{
	return point != NULL && modbus_has_scale_register(point) ? json_integer(point->second_address)
								 : json_null();
}

/* What people are told of it. */
static void add_meaning(const struct map_config *config, uint32_t point, json_t *row)
{
	const struct foreign_point *own = foreign_point_of(config, point);
	const char *unit = map_unit_of(config, &config->points[point]);

	if (*unit != '\0')
		json_object_set_new(row, "unit", json_string(unit));
	if (own == NULL)
		return;
	if (own->description != 0)
		json_object_set_new(row, "description", json_string(foreign_text(config, own->description)));
	json_object_set_new(row, "retain", json_boolean(config->points[point].flags & MAP_POINT_RETAIN));
}

static void print_row(json_t *row)
{
	const char *key;
	json_t *value;

	json_object_foreach(row, key, value)
	{
		char *number = json_dumps(value, JSON_ENCODE_ANY | JSON_REAL_PRECISION(7));
		char angle[WORDS_SIZE];
		const char *text = json_is_string(value)            ? json_string_value(value)
				   : words_angle(row, value, angle) ? angle
								    : number;

		printf("%-*s %s\n", KEY_WIDTH, key, text);
		free(number);
	}
	json_decref(row);
}

int rtuctl_show(struct map *map, const struct rtuctl_request *request)
{
	uint32_t point = rtuctl_find_point(map_config(map), request->arguments[0]);
	const struct modbus_point *wire;
	json_t *row;

	if (point == MAP_NONE)
		return RTUCTL_FAILED;
	row = rows_point(map, point);
	wire = wire_of(map_config(map), point);
	json_object_set_new(row, "period_ms", period(wire));
	json_object_set_new(row, "scale_register", scale_register(wire));
	add_details(map, point, row);
	add_meaning(map_config(map), point, row);
	if (request->json)
		listing_print_json(row);
	else
		print_row(row);
	return RTUCTL_DONE;
}
