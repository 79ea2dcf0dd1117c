/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The keys of a slave's tables and of the objects in them. */
#include "modbus/config_object.h"

#include <float.h>

#include "config/names.h"

const char *const modbus_table_names[MODBUS_TABLES] = {
    [MODBUS_COILS] = "coils",
    [MODBUS_DISCRETE_INPUTS] = "discrete_inputs",
    [MODBUS_INPUT_REGISTERS] = "input_registers",
    [MODBUS_HOLDING_REGISTERS] = "holding_registers",
};

const char *const modbus_type_names[] = {MAP_STANDARD_TYPES(MAP_TYPE_NAME) NULL};
static const char *const orders[] = {"big", "little", NULL};
static const char *const formats[] = {
    "int16",  "uint16",  "int32",   "uint32", "int64",
    "uint64", "float32", "float64", NULL}; /* as enum modbus_format from INT16 on */
static const char *const bit_orders[] = {"off_on", "on_off", NULL};

const struct config_rule modbus_object_rules[OBJECT_KEYS] = {
    [OBJECT_ADDRESS] = {MODBUS_KEY_ADDRESS, CONFIG_INTEGER, .low = 0, .high = MODBUS_ADDRESS_LAST},
    [OBJECT_REGISTER] = {MODBUS_KEY_REGISTER, CONFIG_TEXT, .low = MODBUS_NUMBER_SHORT,
			 .high = MODBUS_NUMBER_LONG},
    [OBJECT_TYPE] = {"type", CONFIG_CHOICE, .choices = modbus_type_names},
    [OBJECT_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1},
    [OBJECT_UNIT] = {"unit", CONFIG_TEXT, .low = 1, .high = 15},
    [OBJECT_DECIMALS] = {"decimals", CONFIG_INTEGER, .low = 0, .high = 7},
    [OBJECT_LN] = CONFIG_LN_RULE,
    [OBJECT_IOA] = {"ioa", CONFIG_INTEGER, .low = 1, .high = MODBUS_IOA_MAX},
    [OBJECT_GROUP] = {"group", CONFIG_INTEGER, .low = 1, .high = 16},
    [OBJECT_SELECT] = {"select", CONFIG_BOOLEAN},
    [OBJECT_FORMAT] = {"format", CONFIG_CHOICE, .choices = formats},
    [OBJECT_BIT] = {"bit", CONFIG_INTEGER, .low = 0, .high = 15},
    [OBJECT_INVERTED] = {"inverted", CONFIG_BOOLEAN},
    [OBJECT_SIGNED] = {"signed", CONFIG_BOOLEAN, .fallback = true},
    [OBJECT_WORD_ORDER] = {"word_order", CONFIG_CHOICE, .choices = orders},
    [OBJECT_BYTE_ORDER] = {"byte_order", CONFIG_CHOICE, .choices = orders},
    [OBJECT_BIT_ORDER] = {"bit_order", CONFIG_CHOICE, .choices = bit_orders},
    [OBJECT_SCALE] = {"scale", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX, .fallback = 1},
    [OBJECT_OFFSET] = {"offset", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX},
    [OBJECT_SCALE_POINTS] = {"scale_points", CONFIG_ARRAY, .high = MODBUS_OBJECT_KNOTS_MAX},
    [OBJECT_SCALE_TABLE] = {"scale_table", CONFIG_ARRAY, .high = MODBUS_OBJECT_KNOTS_MAX},
    [OBJECT_SCALE_REGISTER] = {"scale_register", CONFIG_INTEGER, .low = 0, .high = MODBUS_ADDRESS_LAST},
    [OBJECT_UNIMPLEMENTED] = {"unimplemented", CONFIG_BOOLEAN},
    [OBJECT_DEADBAND] = {"deadband", CONFIG_NUMBER, .low = 0, .high = FLT_MAX},
    [OBJECT_CYCLIC] = {"cyclic_ms", CONFIG_INTEGER, .low = 100, .high = 86400000},
    [OBJECT_BACKGROUND] = {"background_ms", CONFIG_INTEGER, .low = 100, .high = 86400000},
    [OBJECT_COUNTER_GROUP] = {"counter_group", CONFIG_INTEGER, .low = 1, .high = 4},
    [OBJECT_FREEZE] = {"freeze_s", CONFIG_INTEGER, .low = 1, .high = 86400},
    [OBJECT_SECOND] = {"second_address", CONFIG_INTEGER, .low = 0, .high = MODBUS_ADDRESS_LAST},
    [OBJECT_SHORT_PULSE] = {"short_pulse_ms", CONFIG_INTEGER, .low = 20, .high = 60000},
    [OBJECT_LONG_PULSE] = {"long_pulse_ms", CONFIG_INTEGER, .low = 20, .high = 60000},
    [OBJECT_STEP] = {"step", CONFIG_NUMBER, .low = 0, .high = FLT_MAX},
    [OBJECT_MIN] = {"min", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX},
    [OBJECT_MAX] = {"max", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX},
    [OBJECT_QUALITY] = {"quality", CONFIG_BOOLEAN, .fallback = true},
    [OBJECT_BLOCKED_BY] = {"blocked_by", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1},
    [OBJECT_SUBSTITUTED_BY] = {"substituted_by", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1},
    [OBJECT_NOT_TOPICAL_BY] = {"not_topical_by", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1},
    [OBJECT_PERIOD] = {"period_ms", CONFIG_INTEGER, .low = 10, .high = 60000},
    [OBJECT_READ_BACK] = {"read_back", CONFIG_BOOLEAN},
};
const char *const modbus_status_keys[MODBUS_STATUS_BITS] = {
    [MODBUS_BLOCKED_BY] = "blocked_by",
    [MODBUS_SUBSTITUTED_BY] = "substituted_by",
    [MODBUS_NOT_TOPICAL_BY] = "not_topical_by",
};
