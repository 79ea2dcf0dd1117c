/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "config/commands.h"

#include "map/type.h"

void config_check_commands(struct config_report *report, const struct config_place *place,
			   const struct config_commands *values)
{
	const struct {
		const char *key;
		const struct config_value *value;
	} needs_command[] = {{"select", values->select},
			     {"short_pulse_ms", values->short_pulse},
			     {"long_pulse_ms", values->long_pulse}};

	for (size_t i = 0; i < sizeof(needs_command) / sizeof(needs_command[0]); i++) {
		const struct config_place here = config_key_of(place, needs_command[i].key);

		if (needs_command[i].value->given && values->command->integer == 0)
			config_error(report, &here, CONFIG_NEEDS_COMMAND);
	}
}

void config_set_commands(const struct config_commands *values, struct map_point *point)
{
	if (values->command->integer == 0)
		return;
	point->flags |= MAP_POINT_COMMAND;
	if (values->select->integer != 0)
		point->flags |= MAP_POINT_SELECT;
	point->short_pulse_ms = (uint16_t)values->short_pulse->integer;
	point->long_pulse_ms = (uint16_t)values->long_pulse->integer;
	if (point->type == MAP_STEP) { /* it is commanded by regulating steps */
		point->step = 1;
		point->min = (float)map_types[MAP_STEP].low;
		point->max = (float)map_types[MAP_STEP].high;
	}
}
