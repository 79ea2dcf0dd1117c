/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The keys of a slave's tables and of the objects in them. */
#include "modbus/config_object.h"

#include <float.h>

#include "config/meanings.h"
#include "config/names.h"

const char *const modbus_table_names[MODBUS_TABLES] = {
    [MODBUS_COILS] = "coils",
    [MODBUS_DISCRETE_INPUTS] = "discrete_inputs",
    [MODBUS_INPUT_REGISTERS] = "input_registers",
    [MODBUS_HOLDING_REGISTERS] = "holding_registers",
};

const char *const modbus_type_names[] = {MAP_STANDARD_TYPES(MAP_TYPE_NAME) NULL};
static const char *const orders[] = {"big", "little", NULL};
#define FORMAT_NAME(number, name, registers, coding, one) name,
static const char *const formats[] = {MODBUS_FILE_FORMATS(FORMAT_NAME) NULL}; /* from INT16 on */
static const char *const bit_orders[] = {"off_on", "on_off", NULL};

CONFIG_TABLE(bit_number_table, .name = "bit_number",
	     .json = CONFIG_JSON({"type" : "integer", "minimum" : 0, "maximum" : 15}));
CONFIG_TABLE(kept_value_table, .name = "kept_value",
	     .json = CONFIG_JSON({"type" : "number", "minimum" : -3.4e+38, "maximum" : 3.4e+38}));
CONFIG_TABLE(knot_table, .name = "knot",
	     .json = CONFIG_JSON({
		     "type" : "array",
		     "minItems" : 2,
		     "maxItems" : 2,
		     "items" : {"type" : "number", "minimum" : -3.4e+38, "maximum" : 3.4e+38}
	     }));

const struct config_rule modbus_object_rules[OBJECT_KEYS] = {
    [OBJECT_ADDRESS] = {MODBUS_KEY_ADDRESS, CONFIG_INTEGER, .page = true, .low = 0,
			.high = MODBUS_ADDRESS_LAST,
			CONFIG_SAYS(
			    "Modbus address, from 0: this or `register`. An object of two bits, or of two "
			    "to four registers, covers this one and the next, but for `second_address`.",
			    .unset = true)},
    [OBJECT_REGISTER] = {MODBUS_KEY_REGISTER, CONFIG_TEXT, .page = true, .low = MODBUS_NUMBER_SHORT,
			 .high = MODBUS_NUMBER_LONG,
			 CONFIG_SAYS("Instead of `address`: the number that a manual prints, as a string: "
				     "40001 and 400001 are holding register 0.",
				     .see = "configuration.md#manuals-numbers",
				     .pattern = "^[0134][0-9]{4,5}$")},
    [OBJECT_TYPE] = {"type", CONFIG_CHOICE, .page = true, .choices = modbus_type_names,
		     CONFIG_SAYS(
			 "Information type: single or double of coils, discrete inputs and a register's bit, "
			 "single without the key; one of the others of registers, scaled without the key.",
			 .see = "configuration.md#types", .unset = true)},
    [OBJECT_NAME] =
	{CONFIG_KEY_NAME, CONFIG_TEXT, .page = true, .low = 1, .high = MAP_NAME_SIZE - 1,
	 CONFIG_SAYS(
	     "Name of the point, once in the file, without spaces and the characters `*?[]\\`. Without it, "
	     "p⟨port⟩.⟨id⟩.⟨letter⟩⟨address⟩, the letter being c, d, i or h for the four tables.",
	     .pattern = "^[^\\u0000-\\u0020\\u007f*?\\[\\]\\\\]*$")},
    [OBJECT_UNIT] = {"unit", CONFIG_TEXT, .page = true, .low = 1, .high = 15,
		     CONFIG_SAYS("Unit of the value, for the list of points, SNMP and IEC 61850.",
				 .see = "iec61850.md#logical-nodes")},
    [OBJECT_NAMES] =
	{CONFIG_KEY_NAMES, CONFIG_OBJECT, .page = true,
	 CONFIG_SAYS(
	     "What its values are called, by the value sent, an integer. Of all types but normalized "
	     "and counter. A command gives one of these.",
	     .see = "configuration.md#names-of-values",
	     .json = CONFIG_JSON({
		     "minProperties" : 1,
		     "maxProperties" : 64,
		     "propertyNames" : {
			     "anyOf" : [
				     {"pattern" : "^(0|-?([1-9][0-9]{0,8}|1[0-9]{9}|20[0-9]{8}))$"},
				     {"pattern" : "^-?(21[0-3][0-9]{7}|214[0-6][0-9]{6})$"},
				     {"pattern" : "^-?(2147[0-3][0-9]{5}|21474[0-7][0-9]{4})$"},
				     {"pattern" : "^-?(214748[0-2][0-9]{3}|2147483[0-5][0-9]{2})$"},
				     {"pattern" : "^(-?(21474836[0-3][0-9]|214748364[0-7])|-2147483648)$"}
			     ]
		     },
		     "additionalProperties" : {
			     "type" : "string",
			     "minLength" : 1,
			     "maxLength" : 31,
			     "pattern" : "^[^\\u0000-\\u001f\\u007f]+$",
			     "not" : {
				     "anyOf" : [
					     {"pattern" : "^ *[-+]?[0-9]+([.][0-9]*)?([eE][-+]?[0-9]+)?$"},
					     {"pattern" : "^ *[-+]?[.][0-9]+([eE][-+]?[0-9]+)?$"},
					     {"pattern" : "^ *[-+]?0[xX][0-9a-fA-F.]+([pP][-+]?[0-9]+)?$"},
					     {"pattern" : "^ *[-+]?[iI][nN][fF]([iI][nN][iI][tT][yY])?$"},
					     {"pattern" : "^ *[-+]?[nN][aA][nN]([(][0-9a-zA-Z_]*[)])?$"}
				     ]
			     }
		     },
		     "examples" : [ {"0" : "off", "1" : "on"} ]
	     }))},
    [OBJECT_DECIMALS] = {"decimals", CONFIG_INTEGER, .page = true, .low = 0, .high = 7,
			 CONFIG_SAYS("Of float: decimals of the value as SNMP has it, a whole number.",
				     .otherwise = 3)},
    [OBJECT_LN] = CONFIG_LN_RULE,
    [OBJECT_IOA] = {"ioa", CONFIG_INTEGER, .page = true, .low = 1, .high = MODBUS_IOA_MAX,
		    CONFIG_SAYS(
			"Information object address, once in a station. Without it, the address plus 1, "
			"10001, 30001 or 40001 for the four tables; needed from address 10000 on.")},
    [OBJECT_GROUP] =
	{"group", CONFIG_INTEGER, .page = true, .low = 1, .high = 16,
	 CONFIG_SAYS("Interrogation group. Without it, the point answers only the station interrogation.")},
    [OBJECT_SELECT] =
	{"select", CONFIG_BOOLEAN, .page = true,
	 CONFIG_SAYS(
	     "A command needs a selection first (select before operate). Only coils and holding_registers.")},
    [OBJECT_FORMAT] =
	{"format", CONFIG_CHOICE, .page = true, .choices = formats,
	 CONFIG_SAYS(
	     "Of bitstring (uint16, uint32), normalized, scaled, float and counter: what the "
	     "registers hold, one to four of them. Without it, int16 for normalized and "
	     "scaled, float32 for float, int32 for counter, uint32 for bitstring; uint16 "
	     "with `bits`. string and string16, of bitstring or without a type, make the object a text.",
	     .see = "configuration.md#formats", .unset = true)},
    [OBJECT_LENGTH] = {"length", CONFIG_INTEGER, .page = true, .low = 1, .high = MODBUS_TEXT_MAX,
		       CONFIG_SAYS(
			   "Of format string and string16, which need it: registers that the text has.",
			   .see = "configuration.md#texts", .unset = true)},
    [OBJECT_BIT] = {"bit", CONFIG_INTEGER, .page = true, .low = 0, .high = 15,
		    CONFIG_SAYS(
			"Makes an object of registers one bit of its register, 0 the least significant; a "
			"double has this one and the next. Needs `ioa`.",
			.unset = true)},
    [OBJECT_BITS] = {"bits", CONFIG_ARRAY, .page = true, .high = 2,
		     CONFIG_SAYS(
			 "Of normalized, scaled, float and bitstring in a format of one register: the "
			 "first and the last bit of it that the object has, 0 the least significant, "
			 "as `[8, 15]`, the high octet. Needs `ioa`.",
			 .see = "configuration.md#bits-of-a-register",
			 .forms = CONFIG_FORMS(&bit_number_table),
			 .json = CONFIG_JSON({
				 "minItems" : 2,
				 "items" : {"$ref" : "#/$defs/bit_number"},
				 "examples" : [ [ 0, 7 ], [ 8, 15 ], [ 4, 4 ] ]
			 }))},
    [OBJECT_INVERTED] = {"inverted", CONFIG_BOOLEAN, .page = true,
			 CONFIG_SAYS(
			     "Of single and double: each bit means the opposite, also of a command.")},
    [OBJECT_SIGNED] = {"signed", CONFIG_BOOLEAN, .page = true, .fallback = true,
		       CONFIG_SAYS("Of normalized and scaled without `format`: false is format uint16; what "
				   "is beyond 32767 then overflows (OV).")},
    [OBJECT_WORD_ORDER] = {"word_order", CONFIG_CHOICE, .page = true, .choices = orders,
			   CONFIG_SAYS(
			       "Of two to four registers: big has the high word in the first register.")},
    [OBJECT_BYTE_ORDER] =
	{"byte_order", CONFIG_CHOICE, .page = true, .choices = orders,
	 CONFIG_SAYS(
	     "Of all register types: big has the high byte of each register first, as Modbus wants it.")},
    [OBJECT_BIT_ORDER] = {"bit_order", CONFIG_CHOICE, .page = true, .choices = bit_orders,
			  CONFIG_SAYS("Of a double: which state the first of its two bits reports.")},
    [OBJECT_SCALE] = {"scale", CONFIG_NUMBER, .page = true, .low = -FLT_MAX, .high = FLT_MAX, .fallback = 1,
		      CONFIG_SAYS("Of normalized, scaled and float, and of counter in a format of three "
				  "or four registers or float32: value = raw * scale + offset. Not 0.",
				  .json = CONFIG_JSON({"not" : {"const" : 0}}))},
    [OBJECT_OFFSET] = {"offset", CONFIG_NUMBER, .page = true, .low = -FLT_MAX, .high = FLT_MAX,
		       CONFIG_SAYS("As scale, which see.")},
    [OBJECT_SCALE_POINTS] = {"scale_points", CONFIG_ARRAY, .page = true, .high = MODBUS_OBJECT_KNOTS_MAX,
			     CONFIG_SAYS(
				 "Of normalized, scaled and float, instead of scale and offset: two pairs "
				 "`[raw, value]`, between and beyond which values lie on a line.",
				 .forms = CONFIG_FORMS(&knot_table),
				 .json = CONFIG_JSON({
					 "minItems" : 2,
					 "items" : {"$ref" : "#/$defs/knot"},
					 "examples" : [[ [ 0, 4 ], [ 27648, 20.5 ] ]]
				 }))},
    [OBJECT_SCALE_TABLE] = {"scale_table", CONFIG_ARRAY, .page = true, .high = MODBUS_OBJECT_KNOTS_MAX,
			    CONFIG_SAYS(
				"Of normalized, scaled and float, instead of scale and offset: 2 to 32 pairs "
				"`[raw, value]` with raw rising, between which values lie on lines. Beyond "
				"them, the value is the last one with OV, and a command is refused.",
				.forms = CONFIG_FORMS(&knot_table),
				.json = CONFIG_JSON({
					"minItems" : 2,
					"items" : {"$ref" : "#/$defs/knot"},
					"examples" : [[ [ 0, -10 ], [ 100, 0 ], [ 1000, 0.5 ] ]]
				}))},
    [OBJECT_SCALE_REGISTER] =
	{"scale_register", CONFIG_INTEGER, .page = true, .low = 0, .high = MODBUS_ADDRESS_LAST,
	 CONFIG_SAYS("Of normalized, scaled and float, and of counter in a format of three "
		     "or four registers or float32: Modbus address of a register of the same table that "
		     "holds the power of ten of raw, as SunSpec's scale factors do.",
		     .see = "configuration.md#scale-registers", .unset = true)},
    [OBJECT_UNIMPLEMENTED] = {"unimplemented", CONFIG_BOOLEAN, .page = true,
			      CONFIG_SAYS(
				  "Of an integer format: the least value if it is signed, the greatest if it "
				  "is unsigned, means that there is no value (IV), as in SunSpec.")},
    [OBJECT_DEADBAND] = {"deadband", CONFIG_NUMBER, .page = true, .low = 0, .high = FLT_MAX,
			 CONFIG_SAYS("Of normalized, scaled, float and counter: a change up to this, in the "
				     "unit of the value sent, makes no event.")},
    [OBJECT_CYCLIC] = {"cyclic_ms", CONFIG_INTEGER, .page = true, .low = 100, .high = 86400000,
		       CONFIG_SAYS("Of normalized, scaled and float: milliseconds between cyclic "
				   "transmissions. Without it, none.")},
    [OBJECT_BACKGROUND] = {"background_ms", CONFIG_INTEGER, .page = true, .low = 100, .high = 86400000,
			   CONFIG_SAYS("Of single, double, step and bitstring: milliseconds between "
				       "transmissions as background scan. Without it, none.")},
    [OBJECT_COUNTER_GROUP] = {"counter_group", CONFIG_INTEGER, .page = true, .low = 1, .high = 4,
			      CONFIG_SAYS("Of counter: group of a counter interrogation. Without it, the "
					  "point answers only the general one.")},
    [OBJECT_FREEZE] = {"freeze_s", CONFIG_INTEGER, .page = true, .low = 1, .high = 86400,
		       CONFIG_SAYS("Of counter: seconds between freezes by the gateway itself, at multiples "
				   "of the wall time. Then its frozen readings alone are events.")},
    [OBJECT_SECOND] =
	{"second_address", CONFIG_INTEGER, .page = true, .low = 0, .high = MODBUS_ADDRESS_LAST,
	 CONFIG_SAYS("Of a double: Modbus address of its second bit, at most 1024 from the first. Without "
		     "it, the next one. What lies between is read with them, so the device must have it.",
		     .unset = true)},
    [OBJECT_SHORT_PULSE] =
	{"short_pulse_ms", CONFIG_INTEGER, .page = true, .low = 20, .high = 60000,
	 CONFIG_SAYS(
	     "Of a coil: milliseconds of a short pulse (QU 1). Without it, such a command is refused.")},
    [OBJECT_LONG_PULSE] =
	{"long_pulse_ms", CONFIG_INTEGER, .page = true, .low = 20, .high = 60000,
	 CONFIG_SAYS(
	     "Of a coil: milliseconds of a long pulse (QU 2). Without it, such a command is refused.")},
    [OBJECT_STEP] = {"step", CONFIG_NUMBER, .page = true, .low = 0, .high = FLT_MAX,
		     CONFIG_SAYS("Of normalized, scaled and float holding_registers: what a regulating step "
				 "command adds or takes, in the unit of the value sent (normalized: "
				 "1/32768); an integer but for float. It needs `min` and `max`.",
				 .unset = true, .json = CONFIG_JSON({"exclusiveMinimum" : 0}))},
    [OBJECT_MIN] = {"min", CONFIG_NUMBER, .page = true, .low = -FLT_MAX, .high = FLT_MAX,
		    CONFIG_SAYS("The least value that a command may give, in the unit of the value sent: a "
				"step command, and a set-point, which needs no `step`. With `max`.",
				.unset = true)},
    [OBJECT_MAX] = {"max", CONFIG_NUMBER, .page = true, .low = -FLT_MAX, .high = FLT_MAX,
		    CONFIG_SAYS("The greatest value that a command may give; more than `min`. With `min`.",
				.unset = true)},
    [OBJECT_QUALITY] = {"quality", CONFIG_BOOLEAN, .page = true, .fallback = true,
			CONFIG_SAYS("Of normalized: false makes it a normalized value without quality "
				    "descriptor (M_ME_ND_1), which is sent only while it is good.",
				    .see = "telecontrol.md#values-without-quality")},
    [OBJECT_BLOCKED_BY] = {"blocked_by", CONFIG_TEXT, .page = true, .low = 1, .high = MAP_NAME_SIZE - 1,
			   CONFIG_SAYS(
			       "Of all types but counter: name of another single point of the slave, without "
			       "such keys itself, that makes this one blocked (BL) while it is ON.",
			       .see = "telecontrol.md#what-a-device-says-of-its-values",
			       .json = CONFIG_JSON({"examples" : ["p3.2.d700"]}))},
    [OBJECT_SUBSTITUTED_BY] =
	{"substituted_by", CONFIG_TEXT, .page = true, .low = 1, .high = MAP_NAME_SIZE - 1,
	 CONFIG_SAYS("Of all types but counter: name of another single point of the slave, without such keys "
		     "itself, that makes this one substituted (SB) while it is ON.",
		     .json = CONFIG_JSON({"examples" : ["p3.2.d700"]}))},
    [OBJECT_NOT_TOPICAL_BY] =
	{"not_topical_by", CONFIG_TEXT, .page = true, .low = 1, .high = MAP_NAME_SIZE - 1,
	 CONFIG_SAYS("Of all types but counter: name of another single point of the slave, without such keys "
		     "itself, that makes this one not topical (NT) while it is ON.",
		     .json = CONFIG_JSON({"examples" : ["p3.2.d700"]}))},
    [OBJECT_SCALE_BY] =
	{"scale_by", CONFIG_TEXT, .page = true, .low = 1, .high = MAP_NAME_SIZE - 1,
	 CONFIG_SAYS("Of normalized, scaled and float: name of another point of the slave, of any table, "
		     "that holds the power of ten of raw.",
		     .see = "configuration.md#scale-registers",
		     .json = CONFIG_JSON({"examples" : ["p3.2.h77"]}))},
    [OBJECT_FACTOR_BY] =
	{"factor_by", CONFIG_TEXT, .page = true, .low = 1, .high = MAP_NAME_SIZE - 1,
	 CONFIG_SAYS(
	     "Of normalized, scaled and float: name of another point of the slave, of any table, that "
	     "raw is multiplied by, as with the ratio of a transformer.",
	     .see = "configuration.md#scale-registers", .json = CONFIG_JSON({"examples" : ["p3.2.h77"]}))},
    [OBJECT_PERIOD] = {"period_ms", CONFIG_INTEGER, .page = true, .low = 10, .high = 86400000,
		       CONFIG_SAYS(
			   "Milliseconds between two reads from the device. Without it, the slave's; of "
			   "a text, an hour.")},
    [OBJECT_PAGE] = {"page", CONFIG_INTEGER, .low = 0, .high = UINT16_MAX,
		     CONFIG_SAYS(
			 "What is written to the slave's `page_address` before each read of the object. "
			 "It takes no commands.",
			 .see = "configuration.md#pages", .unset = true)},
    [OBJECT_READ_BACK] = {"read_back", CONFIG_BOOLEAN, .page = true,
			  CONFIG_SAYS("What a command has written is read at once, and the command ends with "
				      "that. Without it, the slave's. Only coils and holding_registers.",
				      .unset = true)},
    [OBJECT_WRITE_ADDRESS] =
	{"write_address", CONFIG_INTEGER, .page = true, .low = 0, .high = MODBUS_ADDRESS_LAST,
	 CONFIG_SAYS("Modbus address that commands are written to, where it is not the one that is read: a "
		     "coil of coils and discrete_inputs, a holding register of the others. With it, "
		     "discrete_inputs and input_registers take commands and their keys.",
		     .see = "configuration.md#written-elsewhere-or-only-written", .unset = true)},
    [OBJECT_WRITE_ONLY] = {"write_only", CONFIG_BOOLEAN, .page = true,
			   CONFIG_SAYS("The object takes commands and is never read. It has no value, and "
				       "none of the keys about one. Only coils and holding_registers.",
				       .see = "configuration.md#written-elsewhere-or-only-written")},
    [OBJECT_READ_ONLY] = {"read_only", CONFIG_BOOLEAN, .page = true,
			  CONFIG_SAYS("The object is read and takes no commands, as a measured value that a "
				      "device has among its settings. Only coils and holding_registers.",
				      .see = "configuration.md#written-elsewhere-or-only-written")},
    [OBJECT_WRITE_VALUES] =
	{"write_values", CONFIG_ARRAY, .high = MODBUS_OBJECT_KEPT_MAX,
	 CONFIG_SAYS(
	     "What the gateway itself writes to the object, one after the other and from the first again, "
	     "in the unit of the value sent. With `write_at_return` or `write_every_ms`; without it, "
	     "these write what was commanded last.",
	     .see = "configuration.md#written-by-the-gateway-itself",
	     .forms = CONFIG_FORMS(&kept_value_table), .json = CONFIG_JSON({
							       "minItems" : 1,
							       "items" : {"$ref" : "#/$defs/kept_value"},
							       "examples" : [ [1], [ 0, 1 ] ]
						       }))},
    [OBJECT_WRITE_AT_RETURN] =
	{"write_at_return", CONFIG_BOOLEAN,
	 CONFIG_SAYS("The gateway writes the object when its device answers for the first time, and when it "
		     "is back. Not of double and counter.",
		     .see = "configuration.md#written-by-the-gateway-itself")},
    [OBJECT_WRITE_EVERY] =
	{"write_every_ms", CONFIG_INTEGER, .low = 100, .high = 86400000,
	 CONFIG_SAYS(
	     "Milliseconds between two writes of the object by the gateway itself, for as long as its "
	     "device answers; also what `write_at_return` does.",
	     .see = "configuration.md#written-by-the-gateway-itself")},
};
const struct config_inside modbus_object_inside = {
    .rules = modbus_object_rules, .count = OBJECT_KEYS, .whole = true};
const char *const modbus_link_keys[MODBUS_LINKS] = {
    [MODBUS_BLOCKED_BY] = "blocked_by",         [MODBUS_SUBSTITUTED_BY] = "substituted_by",
    [MODBUS_NOT_TOPICAL_BY] = "not_topical_by", [MODBUS_SCALE_BY] = "scale_by",
    [MODBUS_FACTOR_BY] = "factor_by",
};
