/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the states and results of commands are called. */
#include "map/map.h"

const char *map_command_state_name(enum map_command_state state)
{
	static const char *const names[] = {
	    "inactive command",
	    "selection request",
	    "accepted selection",
	    "refused selection",
	    "interruption of selection request",
	    "interrupted selection",
	    "execution request",
	    "executing command",
	    "refused command",
	    "executed command",
	};

	return (unsigned)state < sizeof(names) / sizeof(names[0]) ? names[state] : "unknown state";
}

const char *map_command_result_name(enum map_command_result result)
{
	static const char *const names[] = {
	    "none",      "done",         "exception",       "time-out",     "too old",         "not selected",
	    "interlock", "out of range", "not commandable", "unknown fate", "no power of ten",
	};

	return (unsigned)result < sizeof(names) / sizeof(names[0]) ? names[result] : "unknown result";
}
