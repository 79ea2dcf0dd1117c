/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The keys of a module of others, and of a point of it. */
#ifndef OPENRTU_FOREIGN_CONFIG_KEYS_H
#define OPENRTU_FOREIGN_CONFIG_KEYS_H

#include "config/keys.h"

enum {
	MODULE_NAME,
	MODULE_PROGRAM,
	MODULE_PERIOD,
	MODULE_PRIORITY,
	MODULE_USER,
	MODULE_MEMORY,
	MODULE_HEARTBEAT_LIMIT,
	MODULE_CA,
	MODULE_POINTS,
	MODULE_READS,
	MODULE_COMMANDS,
	MODULE_CONFIG,
	MODULE_KEYS
};

enum {
	POINT_NAME,
	POINT_TYPE,
	POINT_IOA,
	POINT_UNIT,
	POINT_LN,
	POINT_DESCRIPTION,
	POINT_INITIAL,
	POINT_GROUP,
	POINT_DEADBAND,
	POINT_COMMAND,
	POINT_SELECT,
	POINT_SHORT_PULSE,
	POINT_LONG_PULSE,
	POINT_COUNTER_GROUP,
	POINT_FREEZE,
	POINT_RETAIN,
	POINT_KEYS
};

extern const struct config_rule foreign_module_rules[MODULE_KEYS];
extern const struct config_rule foreign_point_rules[POINT_KEYS];

extern const struct config_table foreign_module_table;

#endif
