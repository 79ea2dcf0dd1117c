/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The points of a program's own: what it writes, and what controlling stations command at it. */
#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "config/names.h"
#include "config/sets.h"
#include "logic/config_readers.h"
#include "logic/value.h"
#include "map/type.h"

enum {
	POINT_NAME,
	POINT_TYPE,
	POINT_IOA,
	POINT_GROUP,
	POINT_SELECT,
	POINT_LN,
	POINT_DEADBAND,
	POINT_VALUE,
	POINT_RETAIN,
	POINT_KEYS
};
static const struct config_rule point_rules[POINT_KEYS] = {
    [POINT_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1, .high = MAP_NAME_SIZE - 1,
		    CONFIG_SAYS("Name in the program and of the point.")},
    [POINT_TYPE] =
	{"type", CONFIG_CHOICE, .choices = map_type_names,
	 CONFIG_SAYS("Type of the point. Without it, single for BOOL, bitstring for bits, scaled for SINT, "
		     "INT and USINT, integer for DINT and UINT, float for REAL and LREAL; others need it.",
		     .unset = true)},
    [POINT_IOA] = {"ioa", CONFIG_INTEGER, .required = true, .low = 1, .high = 16777215,
		   CONFIG_SAYS("Information object address.")},
    [POINT_GROUP] = {"group", CONFIG_INTEGER, .low = 1, .high = 16, CONFIG_SAYS("Interrogation group.")},
    [POINT_SELECT] = {"select", CONFIG_BOOLEAN, CONFIG_SAYS("A command needs a selection first.")},
    [POINT_LN] = CONFIG_LN_RULE,
    [POINT_DEADBAND] = {"deadband", CONFIG_NUMBER, .low = 0, .high = FLT_MAX,
			CONFIG_SAYS("Changes up to this, in the unit of the value, make no event.")},
    [POINT_VALUE] = {"value", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX,
		     CONFIG_SAYS("Value of a point that controlling stations set, until they do; without it "
				 "the point is invalid until then. A reload may change it.",
				 .see = "reload.md", .unset = true)},
    [POINT_RETAIN] = {"retain", CONFIG_BOOLEAN,
		      CONFIG_SAYS("`true`: it begins with its last value, instead of `value` or 0; with "
				  "`journal` over a power cut, too.")},
};
CONFIG_SHARED_TABLE(logic_point_table, .name = "program_point", .rules = point_rules, .count = POINT_KEYS);

static void read_type(struct config_loader *loader, const struct config_place *place,
		      const struct config_value *value, const struct logic_point *point,
		      struct logic_own_point *out)
{
	const struct config_place here = config_key_of(place, point_rules[POINT_TYPE].name);
	const unsigned type = value->given ? (unsigned)value->integer : logic_map_type(point->type);

	out->type = (uint8_t)type;
	if (value->wrong)
		return;
	if (type == MAP_TYPES)
		config_error(&loader->report, &here,
			     "is missing: the program's type for %s is none of a point; expected integer, "
			     "float or counter",
			     out->name);
	else if (!logic_value_fits((enum map_type)type, point->type, point->written))
		config_error(&loader->report, &here, "%s does not fit the program's type for %s",
			     map_types[type].name, out->name);
}

/* Whom a point takes its value from. */
static void check_use(struct config_loader *loader, const struct config_place *place,
		      const struct config_value *values, const struct logic *logic,
		      const struct logic_point *point, struct logic_own_point *out)
{
	const struct config_place select = config_key_of(place, point_rules[POINT_SELECT].name);
	const struct config_place initial = config_key_of(place, point_rules[POINT_VALUE].name);
	bool decides = logic_decides(logic, out->name);
	union map_value ignored;

	if (out->select && point->written && !decides)
		config_error(&loader->report, &select,
			     "nobody can command %s: the program writes it and has no REQUEST for it",
			     out->name);
	if (!values[POINT_VALUE].given)
		return;
	if (point->written || decides)
		config_error(&loader->report, &initial, "is for a point that controlling stations alone set");
	else if (out->type < MAP_TYPES && !logic_map_value((enum map_type)out->type, point->type,
							   values[POINT_VALUE].number, &ignored))
		config_error(&loader->report, &initial, "%g is beyond the type of %s",
			     values[POINT_VALUE].number, out->name);
}

static void read_point(struct config_loader *loader, struct logic_reading *reading, uint32_t number,
		       const json_t *json)
{
	struct logic_own_point *out = &reading->points[number];
	struct logic_place links;
	const struct config_place *place = logic_place_point(&links, reading, number);
	const struct config_place name = config_key_of(place, CONFIG_KEY_NAME);
	struct config_value values[POINT_KEYS];
	const struct logic_point *point;

	config_read_keys(&loader->report, place, json, point_rules, POINT_KEYS, values);
	if (!values[POINT_NAME].given)
		return;
	*out = (struct logic_own_point){
	    .name = values[POINT_NAME].text,
	    .ln = values[POINT_LN].given ? values[POINT_LN].text : NULL,
	    .group = (uint8_t)values[POINT_GROUP].integer,
	    .select = values[POINT_SELECT].integer != 0,
	    .retain = values[POINT_RETAIN].integer != 0,
	    .ioa = (uint32_t)values[POINT_IOA].integer,
	    .deadband = (float)values[POINT_DEADBAND].number,
	    .has_initial = values[POINT_VALUE].given,
	    .initial = (float)values[POINT_VALUE].number,
	};
	point = logic_find_point(&reading->logic, out->name);
	if (point == NULL) {
		config_error(&loader->report, &name, "\"%s\" is no point of the program", out->name);
		return;
	}
	read_type(loader, place, &values[POINT_TYPE], point, out);
	check_use(loader, place, values, &reading->logic, point, out);
	reading->instance->set_points += !point->written;
}

void logic_read_points(struct config_loader *loader, struct logic_reading *reading, const json_t *points)
{
	const json_t *point;
	size_t i;

	reading->points = config_allocate((uint32_t)json_array_size(points), sizeof(*reading->points));
	if (reading->points == NULL) {
		config_out_of_memory(&loader->report);
		return;
	}
	reading->point_count = (uint32_t)json_array_size(points);
	json_array_foreach(points, i, point)
	{
		read_point(loader, reading, (uint32_t)i, point);
	}
}

static bool is_commanded(const struct logic *logic, const struct logic_own_point *point)
{
	return !logic_find_point(logic, point->name)->written || logic_decides(logic, point->name);
}

void logic_add_set(struct config_loader *loader, struct logic_reading *reading)
{
	struct logic_place place;

	reading->instance->set = loader->config->set_count;
	config_add_set(loader, logic_place_key(&place, reading, "ca"), reading->ca, reading->instance->name);
	for (uint32_t i = 0; i < reading->point_count; i++) {
		const struct logic_own_point *own = &reading->points[i];
		struct map_point *point = config_add_point(loader, logic_place_point(&place, reading, i),
							   own->name, (enum map_type)own->type, own->ioa);

		point->group = own->group;
		point->deadband = own->deadband;
		if (is_commanded(&reading->logic, own))
			point->flags = MAP_POINT_COMMAND | (own->select ? MAP_POINT_SELECT : 0);
		point->flags |= own->retain ? MAP_POINT_RETAIN : 0;
		if (own->ln != NULL)
			config_take_ln(loader, logic_place_point(&place, reading, i),
				       loader->config->point_count - 1, own->ln);
	}
}
