/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "foreign/config_keys.h"

#include <float.h>

#include "config/names.h"
#include "foreign/config.h"
#include "map/type.h"

#define POINTS_MAX 1024

const struct config_rule foreign_module_rules[MODULE_KEYS] = {
    [MODULE_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1, .high = MAP_NAME_SIZE - 1},
    [MODULE_PROGRAM] = {"program", CONFIG_TEXT, .required = true, .low = 1, .high = MAP_FILE_SIZE - 1},
    [MODULE_PERIOD] = {"period_ms", CONFIG_INTEGER, .low = 1, .high = 3600000, .fallback = 100},
    [MODULE_PRIORITY] = {"priority", CONFIG_INTEGER, .low = 0, .high = 98},
    [MODULE_USER] = {"user", CONFIG_TEXT, .low = 1, .high = FOREIGN_USER_SIZE - 1},
    [MODULE_MEMORY] = {"memory_mb", CONFIG_INTEGER, .low = 8, .high = 2048, .fallback = 64},
    [MODULE_HEARTBEAT_LIMIT] = {"heartbeat_limit_ms", CONFIG_INTEGER, .low = 100, .high = 5000},
    [MODULE_CA] = {"ca", CONFIG_INTEGER, .low = 1, .high = 65534},
    [MODULE_POINTS] = {"points", CONFIG_ARRAY, .high = POINTS_MAX},
    [MODULE_READS] = {"reads", CONFIG_ARRAY, .high = POINTS_MAX},
    [MODULE_COMMANDS] = {"commands", CONFIG_ARRAY, .high = POINTS_MAX},
    [MODULE_CONFIG] = {"config", CONFIG_OBJECT},
};

const struct config_rule foreign_point_rules[POINT_KEYS] = {
    [POINT_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1, .high = MAP_NAME_SIZE - 1},
    [POINT_TYPE] = {"type", CONFIG_CHOICE, .required = true, .choices = map_type_names},
    [POINT_IOA] = {"ioa", CONFIG_INTEGER, .required = true, .low = 1, .high = 16777215},
    [POINT_UNIT] = {"unit", CONFIG_TEXT, .low = 1, .high = 15},
    [POINT_LN] = CONFIG_LN_RULE,
    [POINT_DESCRIPTION] = {"description", CONFIG_TEXT, .low = 1, .high = 127},
    [POINT_INITIAL] = {"initial", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX},
    [POINT_GROUP] = {"group", CONFIG_INTEGER, .low = 1, .high = 16},
    [POINT_DEADBAND] = {"deadband", CONFIG_NUMBER, .low = 0, .high = FLT_MAX},
    [POINT_COMMAND] = {"command", CONFIG_BOOLEAN},
    [POINT_SELECT] = {"select", CONFIG_BOOLEAN},
    [POINT_SHORT_PULSE] = {"short_pulse_ms", CONFIG_INTEGER, .low = 20, .high = 60000},
    [POINT_LONG_PULSE] = {"long_pulse_ms", CONFIG_INTEGER, .low = 20, .high = 60000},
    [POINT_COUNTER_GROUP] = {"counter_group", CONFIG_INTEGER, .low = 1, .high = 4},
    [POINT_FREEZE] = {"freeze_s", CONFIG_INTEGER, .low = 1, .high = 86400},
    [POINT_RETAIN] = {"retain", CONFIG_BOOLEAN},
};
