/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How a point takes commands: keys that a point of an outstation and one of a module have alike. */
#ifndef OPENRTU_CONFIG_COMMANDS_H
#define OPENRTU_CONFIG_COMMANDS_H

#include "config/keys.h"
#include "map/config.h"

#define CONFIG_NEEDS_COMMAND "is of a point that takes commands, expected \"command\": true beside it"

/* The values of "command", "select", "short_pulse_ms" and "long_pulse_ms". */
struct config_commands {
	const struct config_value *command, *select, *short_pulse, *long_pulse;
};

/* Reports what says how a command is given, of a point that takes none. place: the point's. */
void config_check_commands(struct config_report *report, const struct config_place *place,
			   const struct config_commands *values);
/* What the point has of it. */
void config_set_commands(const struct config_commands *values, struct map_point *point);

#endif
