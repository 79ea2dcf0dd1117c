/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the log says of commands: what was commanded, by whom, and how it ended. */
#include <inttypes.h>
#include <stdio.h>

#include "map/layout.h"

#define VALUE_SIZE  24
#define RESULT_SIZE 32
#define MORE_SIZE   40
#define NVA_ONE     32768.0
#define DOUBLE_ON   2 /* of a double command; 1: off */

/* Of a point: who operates a switch has a line each time, who writes a set-point each second has one a minute. */
static const struct map_pace pace = {60 * NS_PER_S, 20};

static void put_value(enum map_type type, const struct map_command *command, char out[VALUE_SIZE])
{
	const union map_value value = command->value;
	double number = map_number(type, value);

	if (command->step != 0) {
		snprintf(out, VALUE_SIZE, "%+d", command->step);
		return;
	}
	switch (map_types[type].form) {
	case MAP_FORM_SINGLE:
		snprintf(out, VALUE_SIZE, "%s", value.u & 1 ? "on" : "off");
		return;
	case MAP_FORM_DOUBLE:
		snprintf(out, VALUE_SIZE, "%s", value.u == DOUBLE_ON ? "on" : "off");
		return;
	case MAP_FORM_UNSIGNED:
		snprintf(out, VALUE_SIZE, "%" PRIu32, value.u);
		return;
	case MAP_FORM_FRACTION:
		number = value.i / NVA_ONE;
		break;
	case MAP_FORM_FLOAT:
		number = map_shortest(value.f);
		break;
	case MAP_FORM_SIGNED:
	case MAP_FORM_DEGREES:
		break;
	}
	snprintf(out, VALUE_SIZE, "%.10g", number);
}

static void put_result(const struct map_command *command, char out[RESULT_SIZE])
{
	const char *name = map_command_result_name((enum map_command_result)command->result);

	if (command->result == MAP_RESULT_EXCEPTION)
		snprintf(out, RESULT_SIZE, "%s %u", name, command->detail);
	else
		snprintf(out, RESULT_SIZE, "%s", name);
}

void command_log_end(struct map *map, uint32_t point, const struct map_command *command)
{
	const struct map_point *object = &map->config.points[point];
	char name[MAP_NAME_SIZE], value[VALUE_SIZE], result[RESULT_SIZE], more[MORE_SIZE] = "";
	struct map_lines *lines;

	if (object->command >= map->commanded_count)
		return; /* of a configuration since */
	lines = &map->commanded[object->command];
	if (!map_lines_take(lines, pace, command->time_ns))
		return;
	if (lines->withheld > 0)
		snprintf(more, sizeof(more), "; %" PRIu32 " more since the last line", lines->withheld);
	lines->withheld = 0;
	map_point_name(&map->config, object, name);
	put_value((enum map_type)object->type, command, value);
	put_result(command, result);
	map_log(map, command->result == MAP_RESULT_DONE ? MAP_LOG_INFO : MAP_LOG_WARNING,
		"%s = %s: %s, commanded by %s%s", name, value, result,
		map->modules[command->requester].plan.name, more);
}
