/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "foreign/config_keys.h"

#include <float.h>

#include "config/names.h"
#include "foreign/config.h"
#include "map/type.h"

#define POINTS_MAX 1024

const struct config_rule foreign_point_rules[POINT_KEYS] = {
    [POINT_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1, .high = MAP_NAME_SIZE - 1,
		    CONFIG_SAYS(
			"Name of the point, once in the file, without spaces and the characters `*?[]\\`.",
			.pattern = "^[^\\u0000-\\u0020\\u007f*?\\[\\]\\\\]*$")},
    [POINT_TYPE] = {"type", CONFIG_CHOICE, .required = true, .choices = map_type_names,
		    CONFIG_SAYS("Information type.")},
    [POINT_IOA] = {"ioa", CONFIG_INTEGER, .required = true, .low = 1, .high = 16777215,
		   CONFIG_SAYS("Information object address, once in a station.")},
    [POINT_UNIT] = {"unit", CONFIG_TEXT, .low = 1, .high = 15,
		    CONFIG_SAYS("Unit of the value, for who reads it, and for IEC 61850.",
				.see = "iec61850.md#logical-nodes")},
    [POINT_LN] = CONFIG_LN_RULE,
    [POINT_DESCRIPTION] = {"description", CONFIG_TEXT, .low = 1, .high = 127,
			   CONFIG_SAYS("What it is, for who reads it.")},
    [POINT_INITIAL] = {"initial", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX,
		       CONFIG_SAYS("Its value, good, from the program's start until it is written. Without "
				   "it, the point is invalid until then.",
				   .unset = true)},
    [POINT_GROUP] =
	{"group", CONFIG_INTEGER, .low = 1, .high = 16,
	 CONFIG_SAYS("Interrogation group. Without it, the point answers only the station interrogation.")},
    [POINT_DEADBAND] = {"deadband", CONFIG_NUMBER, .low = 0, .high = FLT_MAX,
			CONFIG_SAYS("Of normalized, scaled and float: a change up to this is no event.")},
    [POINT_COMMAND] = {"command", CONFIG_BOOLEAN,
		       CONFIG_SAYS("`true`: controlling stations and `rtuctl` may command it, and the "
				   "program decides; of a step, by regulating steps. Not of a counter.")},
    [POINT_SELECT] = {"select", CONFIG_BOOLEAN,
		      CONFIG_SAYS(
			  "`true`: it is commanded only with a selection before; with `command` alone.")},
    [POINT_SHORT_PULSE] =
	{"short_pulse_ms", CONFIG_INTEGER, .low = 20, .high = 60000,
	 CONFIG_SAYS("Of single and double: what a short pulse is, in milliseconds; with command alone.")},
    [POINT_LONG_PULSE] = {"long_pulse_ms", CONFIG_INTEGER, .low = 20, .high = 60000,
			  CONFIG_SAYS("The same of a long pulse.")},
    [POINT_COUNTER_GROUP] = {"counter_group", CONFIG_INTEGER, .low = 1, .high = 4,
			     CONFIG_SAYS("Of counters: group of counter interrogation. Without it, the "
					 "counter answers only the general one.")},
    [POINT_FREEZE] = {"freeze_s", CONFIG_INTEGER, .low = 1, .high = 86400,
		      CONFIG_SAYS("Of counters: freezes the reading each so many seconds of the clock, and "
				  "sends it as an event.")},
    [POINT_RETAIN] = {"retain", CONFIG_BOOLEAN,
		      CONFIG_SAYS("`true`: a new process of the module goes on with its last value and "
				  "quality, instead of `initial`; with `journal` over a power cut, too.")},
};
CONFIG_TABLE(
    point_table, .name = "module_point", .rules = foreign_point_rules, .count = POINT_KEYS,
    .json = CONFIG_JSON({
	    "dependentRequired" :
		{"select" : ["command"], "short_pulse_ms" : ["command"], "long_pulse_ms" : ["command"]}
    }));

const struct config_rule foreign_module_rules[MODULE_KEYS] = {
    [MODULE_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1, .high = MAP_NAME_SIZE - 1,
		     CONFIG_SAYS("Name of the module, once in the file, of letters, digits, `-` and `_`; one "
				 "that begins with `rtu` is the gateway's own.",
				 .pattern = "^(?!rtu)[A-Za-z0-9_-]*$")},
    [MODULE_PROGRAM] = {"program", CONFIG_TEXT, .required = true, .low = 1, .high = MAP_FILE_SIZE - 1,
			CONFIG_SAYS("Absolute path of the program, which the module's user can read and "
				    "execute. A script names its interpreter in its first line.",
				    .pattern = "^/[^\\u0000-\\u001f\\u007f]*$")},
    [MODULE_PERIOD] = {"period_ms", CONFIG_INTEGER, .low = 1, .high = 3600000, .fallback = 100,
		       CONFIG_SAYS("Milliseconds between the beginnings of two scans. A module that waits "
				   "for its scans in the net has no period without this key.",
				   .see = "configuration.md#the-net")},
    [MODULE_PRIORITY] = {"priority", CONFIG_INTEGER, .low = 0, .high = 98,
			 CONFIG_SAYS("Real-time priority (SCHED_FIFO) of the program; 0: none.")},
    [MODULE_USER] = {"user", CONFIG_TEXT, .low = 1, .high = FOREIGN_USER_SIZE - 1,
		     CONFIG_SAYS("User of the system that the program runs as, not root and no other "
				 "module's. Without it, one that `rtud` gives it.")},
    [MODULE_MEMORY] = {"memory_mb", CONFIG_INTEGER, .low = 8, .high = 2048, .fallback = 64,
		       CONFIG_SAYS("MiB of address space that the program may have.")},
    [MODULE_HEARTBEAT_LIMIT] = {"heartbeat_limit_ms", CONFIG_INTEGER, .low = 100, .high = 5000,
				CONFIG_SAYS("Milliseconds without a sign of life after which its points are "
					    "invalid. Without it, two periods, from 100 to 5000.")},
    [MODULE_CA] = {"ca", CONFIG_INTEGER, .low = 1, .high = 65534,
		   CONFIG_SAYS(
		       "Common address of its points, not that of a device. A module with points needs it.")},
    [MODULE_POINTS] = {"points", CONFIG_ARRAY, .high = POINTS_MAX,
		       CONFIG_SAYS("Its own points, at most 1024, which it alone may write.",
				   .table = &point_table)},
    [MODULE_READS] = {"reads", CONFIG_ARRAY, .high = POINTS_MAX,
		      CONFIG_SAYS("Points of others that it reads, by name or pattern (`*`, `?`, `[ ]`). A "
				  "pattern that fits no point is an error.",
				  .json = CONFIG_JSON({"items" : {"type" : "string", "minLength" : 1}}))},
    [MODULE_COMMANDS] =
	{"commands", CONFIG_ARRAY, .high = POINTS_MAX,
	 CONFIG_SAYS("Points of others that it may command, by name or pattern; without the key, none.",
		     .json = CONFIG_JSON({"items" : {"type" : "string", "minLength" : 1}}))},
    [MODULE_CONFIG] = {"config", CONFIG_OBJECT,
		       CONFIG_SAYS("Anything that the program wants to know; `rtud` does not look into it.")},
};
CONFIG_SHARED_TABLE(foreign_module_table, .name = "module", .rules = foreign_module_rules,
		    .count = MODULE_KEYS, .json = CONFIG_JSON({"dependentRequired" : {"points" : ["ca"]}}));
