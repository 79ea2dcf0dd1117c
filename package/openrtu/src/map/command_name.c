/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the states and results of commands are called. */
#include "map/map.h"

const char *map_command_state_name(enum map_command_state state)
{
	static const char *const names[] = {MAP_COMMAND_STATES(MAP_WORDS)};

	return (unsigned)state < sizeof(names) / sizeof(names[0]) ? names[state] : "unknown state";
}

const char *map_command_result_name(enum map_command_result result)
{
	static const char *const names[] = {MAP_COMMAND_RESULTS(MAP_WORDS)};

	return (unsigned)result < sizeof(names) / sizeof(names[0]) ? names[result] : "unknown result";
}
