/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The keys of a slave's tables and of the objects in them. */
#include "modbus/config_meaning_schema.h"
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
#define FORMAT_NAME(number, name, registers, coding, one) name,
static const char *const formats[] = {MODBUS_FILE_FORMATS(FORMAT_NAME) NULL}; /* from INT16 on */
static const char *const bit_orders[] = {"off_on", "on_off", NULL};

CONFIG_TABLE(bit_number_table, .name = "bit_number",
	     .json = CONFIG_JSON({"type" : "integer", "minimum" : 0, "maximum" : 15}));
CONFIG_TABLE(knot_table, .name = "knot",
	     .json = CONFIG_JSON({
		     "type" : "array",
		     "minItems" : 2,
		     "maxItems" : 2,
		     "items" : {"type" : "number", "minimum" : -3.4e+38, "maximum" : 3.4e+38}
	     }));

const struct config_rule modbus_object_rules[OBJECT_KEYS] = {
    [OBJECT_ADDRESS] = {MODBUS_KEY_ADDRESS, CONFIG_INTEGER, .low = 0, .high = MODBUS_ADDRESS_LAST,
			CONFIG_SAYS(
			    "Modbus address, from 0: this or `register`. An object of two bits, or of two "
			    "to four registers, covers this one and the next, but for `second_address`.",
			    .unset = true)},
    [OBJECT_REGISTER] = {MODBUS_KEY_REGISTER, CONFIG_TEXT, .low = MODBUS_NUMBER_SHORT,
			 .high = MODBUS_NUMBER_LONG,
			 CONFIG_SAYS("Instead of `address`: the number that a manual prints, as a string: "
				     "40001 and 400001 are holding register 0.",
				     .see = "configuration.md#manuals-numbers",
				     .pattern = "^[0134][0-9]{4,5}$")},
    [OBJECT_TYPE] = {"type", CONFIG_CHOICE, .choices = modbus_type_names,
		     CONFIG_SAYS(
			 "Information type: single or double of coils, discrete inputs and a register's bit, "
			 "single without the key; one of the others of registers, scaled without the key.",
			 .see = "configuration.md#types", .unset = true)},
    [OBJECT_NAME] =
	{CONFIG_KEY_NAME, CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1,
	 CONFIG_SAYS(
	     "Name of the point, once in the file, without spaces and the characters `*?[]\\`. Without it, "
	     "p⟨port⟩.⟨id⟩.⟨letter⟩⟨address⟩, the letter being c, d, i or h for the four tables.",
	     .pattern = "^[^\\u0000-\\u0020\\u007f*?\\[\\]\\\\]*$")},
    [OBJECT_UNIT] = {"unit", CONFIG_TEXT, .low = 1, .high = 15,
		     CONFIG_SAYS("Unit of the value, for the list of points, SNMP and IEC 61850.",
				 .see = "iec61850.md#logical-nodes")},
    [OBJECT_DECIMALS] = {"decimals", CONFIG_INTEGER, .low = 0, .high = 7,
			 CONFIG_SAYS("Of float: decimals of the value as SNMP has it, a whole number.",
				     .otherwise = 3)},
    [OBJECT_LN] = CONFIG_LN_RULE,
    [OBJECT_IOA] = {"ioa", CONFIG_INTEGER, .low = 1, .high = MODBUS_IOA_MAX,
		    CONFIG_SAYS(
			"Information object address, once in a station. Without it, the address plus 1, "
			"10001, 30001 or 40001 for the four tables; needed from address 10000 on.")},
    [OBJECT_GROUP] =
	{"group", CONFIG_INTEGER, .low = 1, .high = 16,
	 CONFIG_SAYS("Interrogation group. Without it, the point answers only the station interrogation.")},
    [OBJECT_SELECT] =
	{"select", CONFIG_BOOLEAN,
	 CONFIG_SAYS(
	     "A command needs a selection first (select before operate). Only coils and holding_registers.")},
    [OBJECT_FORMAT] = {"format", CONFIG_CHOICE, .choices = formats,
		       CONFIG_SAYS(
			   "Of bitstring (uint16, uint32), normalized, scaled, float and counter: what the "
			   "registers hold, one to four of them. Without it, int16 for normalized and "
			   "scaled, float32 for float, int32 for counter, uint32 for bitstring; uint16 "
			   "with `bits`.",
			   .see = "configuration.md#formats", .unset = true)},
    [OBJECT_BIT] = {"bit", CONFIG_INTEGER, .low = 0, .high = 15,
		    CONFIG_SAYS(
			"Makes an object of registers one bit of its register, 0 the least significant; a "
			"double has this one and the next. Needs `ioa`.",
			.unset = true)},
    [OBJECT_BITS] = {"bits", CONFIG_ARRAY, .high = 2,
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
    [OBJECT_INVERTED] = {"inverted", CONFIG_BOOLEAN,
			 CONFIG_SAYS(
			     "Of single and double: each bit means the opposite, also of a command.")},
    [OBJECT_SIGNED] = {"signed", CONFIG_BOOLEAN, .fallback = true,
		       CONFIG_SAYS("Of normalized and scaled without `format`: false is format uint16; what "
				   "is beyond 32767 then overflows (OV).")},
    [OBJECT_WORD_ORDER] = {"word_order", CONFIG_CHOICE, .choices = orders,
			   CONFIG_SAYS(
			       "Of two to four registers: big has the high word in the first register.")},
    [OBJECT_BYTE_ORDER] =
	{"byte_order", CONFIG_CHOICE, .choices = orders,
	 CONFIG_SAYS(
	     "Of all register types: big has the high byte of each register first, as Modbus wants it.")},
    [OBJECT_BIT_ORDER] = {"bit_order", CONFIG_CHOICE, .choices = bit_orders,
			  CONFIG_SAYS("Of a double: which state the first of its two bits reports.")},
    [OBJECT_SCALE] = {"scale", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX, .fallback = 1,
		      CONFIG_SAYS("Of normalized, scaled and float, and of counter in a format of three "
				  "or four registers or float32: value = raw * scale + offset. Not 0.",
				  .json = CONFIG_JSON({"not" : {"const" : 0}}))},
    [OBJECT_OFFSET] = {"offset", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX,
		       CONFIG_SAYS("As scale, which see.")},
    [OBJECT_SCALE_POINTS] = {"scale_points", CONFIG_ARRAY, .high = MODBUS_OBJECT_KNOTS_MAX,
			     CONFIG_SAYS(
				 "Of normalized, scaled and float, instead of scale and offset: two pairs "
				 "`[raw, value]`, between and beyond which values lie on a line.",
				 .forms = CONFIG_FORMS(&knot_table),
				 .json = CONFIG_JSON({
					 "minItems" : 2,
					 "items" : {"$ref" : "#/$defs/knot"},
					 "examples" : [[ [ 0, 4 ], [ 27648, 20.5 ] ]]
				 }))},
    [OBJECT_SCALE_TABLE] = {"scale_table", CONFIG_ARRAY, .high = MODBUS_OBJECT_KNOTS_MAX,
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
	{"scale_register", CONFIG_INTEGER, .low = 0, .high = MODBUS_ADDRESS_LAST,
	 CONFIG_SAYS("Of normalized, scaled and float, and of counter in a format of three "
		     "or four registers or float32: Modbus address of a register of the same table that "
		     "holds the power of ten of raw, as SunSpec's scale factors do.",
		     .see = "configuration.md#scale-registers", .unset = true)},
    [OBJECT_UNIMPLEMENTED] = {"unimplemented", CONFIG_BOOLEAN,
			      CONFIG_SAYS(
				  "Of an integer format: the least value if it is signed, the greatest if it "
				  "is unsigned, means that there is no value (IV), as in SunSpec.")},
    [OBJECT_DEADBAND] = {"deadband", CONFIG_NUMBER, .low = 0, .high = FLT_MAX,
			 CONFIG_SAYS("Of normalized, scaled, float and counter: a change up to this, in the "
				     "unit of the value sent, makes no event.")},
    [OBJECT_CYCLIC] = {"cyclic_ms", CONFIG_INTEGER, .low = 100, .high = 86400000,
		       CONFIG_SAYS("Of normalized, scaled and float: milliseconds between cyclic "
				   "transmissions. Without it, none.")},
    [OBJECT_BACKGROUND] = {"background_ms", CONFIG_INTEGER, .low = 100, .high = 86400000,
			   CONFIG_SAYS("Of single, double, step and bitstring: milliseconds between "
				       "transmissions as background scan. Without it, none.")},
    [OBJECT_COUNTER_GROUP] = {"counter_group", CONFIG_INTEGER, .low = 1, .high = 4,
			      CONFIG_SAYS("Of counter: group of a counter interrogation. Without it, the "
					  "point answers only the general one.")},
    [OBJECT_FREEZE] = {"freeze_s", CONFIG_INTEGER, .low = 1, .high = 86400,
		       CONFIG_SAYS("Of counter: seconds between freezes by the gateway itself, at multiples "
				   "of the wall time. Then its frozen readings alone are events.")},
    [OBJECT_SECOND] =
	{"second_address", CONFIG_INTEGER, .low = 0, .high = MODBUS_ADDRESS_LAST,
	 CONFIG_SAYS("Of a double: Modbus address of its second bit, at most 1024 from the first. Without "
		     "it, the next one. What lies between is read with them, so the device must have it.",
		     .unset = true)},
    [OBJECT_SHORT_PULSE] =
	{"short_pulse_ms", CONFIG_INTEGER, .low = 20, .high = 60000,
	 CONFIG_SAYS(
	     "Of a coil: milliseconds of a short pulse (QU 1). Without it, such a command is refused.")},
    [OBJECT_LONG_PULSE] =
	{"long_pulse_ms", CONFIG_INTEGER, .low = 20, .high = 60000,
	 CONFIG_SAYS(
	     "Of a coil: milliseconds of a long pulse (QU 2). Without it, such a command is refused.")},
    [OBJECT_STEP] = {"step", CONFIG_NUMBER, .low = 0, .high = FLT_MAX,
		     CONFIG_SAYS("Of normalized, scaled and float holding_registers: what a regulating step "
				 "command adds or takes, in the unit of the value sent (normalized: "
				 "1/32768); an integer but for float. It needs `min` and `max`.",
				 .unset = true, .json = CONFIG_JSON({"exclusiveMinimum" : 0}))},
    [OBJECT_MIN] = {"min", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX,
		    CONFIG_SAYS("The least value that a command may give, in the unit of the value sent: a "
				"step command, and a set-point, which needs no `step`. With `max`.",
				.unset = true)},
    [OBJECT_MAX] = {"max", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX,
		    CONFIG_SAYS("The greatest value that a command may give; more than `min`. With `min`.",
				.unset = true)},
    [OBJECT_QUALITY] = {"quality", CONFIG_BOOLEAN, .fallback = true,
			CONFIG_SAYS("Of normalized: false makes it a normalized value without quality "
				    "descriptor (M_ME_ND_1), which is sent only while it is good.",
				    .see = "telecontrol.md#values-without-quality")},
    [OBJECT_BLOCKED_BY] = {"blocked_by", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1,
			   CONFIG_SAYS(
			       "Of all types but counter: name of another single point of the slave, without "
			       "such keys itself, that makes this one blocked (BL) while it is ON.",
			       .see = "telecontrol.md#what-a-device-says-of-its-values",
			       .json = CONFIG_JSON({"examples" : ["p3.2.d700"]}))},
    [OBJECT_SUBSTITUTED_BY] =
	{"substituted_by", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1,
	 CONFIG_SAYS("Of all types but counter: name of another single point of the slave, without such keys "
		     "itself, that makes this one substituted (SB) while it is ON.",
		     .json = CONFIG_JSON({"examples" : ["p3.2.d700"]}))},
    [OBJECT_NOT_TOPICAL_BY] =
	{"not_topical_by", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1,
	 CONFIG_SAYS("Of all types but counter: name of another single point of the slave, without such keys "
		     "itself, that makes this one not topical (NT) while it is ON.",
		     .json = CONFIG_JSON({"examples" : ["p3.2.d700"]}))},
    [OBJECT_PERIOD] = {"period_ms", CONFIG_INTEGER, .low = 10, .high = 86400000,
		       CONFIG_SAYS(
			   "Milliseconds between two reads from the device. Without it, the slave's.")},
    [OBJECT_READ_BACK] = {"read_back", CONFIG_BOOLEAN,
			  CONFIG_SAYS("What a command has written is read at once, and the command ends with "
				      "that. Without it, the slave's. Only coils and holding_registers.",
				      .unset = true)},
    [OBJECT_WRITE_ADDRESS] =
	{"write_address", CONFIG_INTEGER, .low = 0, .high = MODBUS_ADDRESS_LAST,
	 CONFIG_SAYS("Modbus address that commands are written to, where it is not the one that is read: a "
		     "coil of coils and discrete_inputs, a holding register of the others. With it, "
		     "discrete_inputs and input_registers take commands and their keys.",
		     .see = "configuration.md#written-elsewhere-or-only-written", .unset = true)},
    [OBJECT_WRITE_ONLY] = {"write_only", CONFIG_BOOLEAN,
			   CONFIG_SAYS("The object takes commands and is never read. It has no value, and "
				       "none of the keys about one. Only coils and holding_registers.",
				       .see = "configuration.md#written-elsewhere-or-only-written")},
};
CONFIG_TABLE(object_table, .name = "object", .rules = modbus_object_rules, .count = OBJECT_KEYS,
	     .add = modbus_put_write_only,
	     .json = CONFIG_JSON({
		     "oneOf" : [ {"required" : ["address"]}, {"required" : ["register"]} ],
		     "if" : {
			     "required" : ["address"],
			     "properties" : {"address" : {"type" : "integer", "minimum" : 10000}}
		     },
		     "then" : {"required" : ["ioa"]}
	     }));

/* What modbus_meanings cannot say: how many registers a value has, and what goes beside what. */
CONFIG_TABLE(
    two_registers_table, .name = "two_registers",
    .json = CONFIG_JSON({
	    "anyOf" : [
		    {
			    "required" : ["format"],
			    "properties" : {
				    "format" : {
					    "enum" : [
						    "int32", "uint32", "float32", "fixed24_8", "bcd32",
						    "mod10_32"
					    ]
				    }
			    }
		    },
		    {
			    "required" : ["type"],
			    "properties" : {"type" : {"enum" : [ "bitstring", "float", "counter" ]}},
			    "not" : {"anyOf" : [ {"required" : ["format"]}, {"required" : ["bits"]} ]}
		    }
	    ]
    }));
CONFIG_TABLE(three_registers_table, .name = "three_registers",
	     .json = CONFIG_JSON({
		     "required" : ["format"],
		     "properties" : {"format" : {"enum" : [ "int48", "uint48", "bcd48", "mod10_48" ]}}
	     }));
CONFIG_TABLE(four_registers_table, .name = "four_registers",
	     .json = CONFIG_JSON({
		     "required" : ["format"],
		     "properties" :
			 {"format" : {"enum" : [ "int64", "uint64", "float64", "bcd64", "mod10_64" ]}}
	     }));
CONFIG_TABLE(bits_table, .name = "bits", .add = modbus_put_bit_meanings, .forms = CONFIG_FORMS(&object_table),
	     .json = CONFIG_JSON({
		     "$ref" : "#/$defs/object",
		     "properties" : {
			     "type" : {"enum" : [ "single", "double" ], "default" : "single"},
			     "word_order" : false,
			     "byte_order" : false,
			     "scale" : false,
			     "offset" : false,
			     "scale_register" : false,
			     "bit" : false
		     },
		     "if" : {"required" : ["type"], "properties" : {"type" : {"const" : "double"}}},
		     "then" : {
			     "properties" : {"write_address" : {"maximum" : 65534}},
			     "if" : {"not" : {"required" : ["second_address"]}},
			     "then" : {"properties" : {"address" : {"maximum" : 65534}}}
		     }
	     }));
CONFIG_TABLE(
    registers_table, .name = "registers", .add = modbus_put_register_meanings,
    .forms = CONFIG_FORMS(&object_table, &two_registers_table, &three_registers_table, &four_registers_table),
    .json = CONFIG_JSON({
	    "$ref" : "#/$defs/object",
	    "properties" : {
		    "type" : {
			    "enum" : [ "step", "bitstring", "normalized", "scaled", "float", "counter" ],
			    "default" : "scaled"
		    }
	    },
	    "allOf" : [
		    {"if" : {"required" : ["format"]}, "then" : {"properties" : {"signed" : false}}}, {
			    "if" : {"required" : ["type"], "properties" : {"type" : {"const" : "bitstring"}}},
			    "then" : {"properties" : {"format" : {"enum" : [ "uint16", "uint32" ]}}}
		    },
		    {
			    "if" : {"$ref" : "#/$defs/four_registers"},
			    "then" : {
				    "properties" : {
					    "address" : {"maximum" : 65532},
					    "write_address" : {"maximum" : 65532},
					    "bits" : false
				    }
			    },
			    "else" : {
				    "if" : {"$ref" : "#/$defs/three_registers"},
				    "then" : {
					    "properties" : {
						    "address" : {"maximum" : 65533},
						    "write_address" : {"maximum" : 65533},
						    "bits" : false
					    }
				    },
				    "else" : {
					    "if" : {"$ref" : "#/$defs/two_registers"},
					    "then" : {
						    "properties" : {
							    "address" : {"maximum" : 65534},
							    "write_address" : {"maximum" : 65534},
							    "bits" : false
						    }
					    },
					    "else" : {"properties" : {"word_order" : false}}
				    }
			    }
		    },
		    {
			    "if" : {"required" : ["bits"]},
			    "then" : {"required" : ["ioa"], "properties" : {"signed" : false}}
		    },
		    {
			    "if" : {"properties" : {"type" : {"const" : "counter"}}, "required" : ["type"]},
			    "then" : {"properties" : {"format" : {"not" : {"const" : "fixed24_8"}}}}
		    },
		    {
			    "if" : {
				    "anyOf" : [
					    {
						    "properties" : {
							    "type" :
								{"enum" : [ "normalized", "scaled", "float" ]}
						    }
					    },
					    {
						    "required" : [ "type", "format" ],
						    "properties" : {
							    "type" : {"const" : "counter"},
							    "format" : {
								    "enum" : [
									    "int48", "uint48", "int64",
									    "uint64", "float32", "float64",
									    "bcd48", "bcd64", "mod10_48",
									    "mod10_64"
								    ]
							    }
						    }
					    }
				    ]
			    },
			    "else" :
				{"properties" : {"scale" : false, "offset" : false, "scale_register" : false}}
		    },
		    {
			    "if" : {"anyOf" : [ {"required" : ["scale"]}, {"required" : ["offset"]} ]},
			    "then" : {"properties" : {"scale_points" : false, "scale_table" : false}}
		    },
		    {
			    "if" : {"required" : ["scale_points"]},
			    "then" : {"properties" : {"scale_table" : false}}
		    },
		    {
			    "if" : {
				    "anyOf" : [
					    {
						    "required" : ["format"],
						    "properties" : {
							    "format" : {
								    "enum" : [
									    "float32", "float64", "bcd16",
									    "bcd32", "bcd48", "bcd64",
									    "mod10_32", "mod10_48", "mod10_64"
								    ]
							    }
						    }
					    },
					    {
						    "required" : ["type"],
						    "properties" : {"type" : {"const" : "float"}},
						    "not" : {
							    "anyOf" : [
								    {"required" : ["format"]},
								    {"required" : ["bits"]}
							    ]
						    }
					    }
				    ]
			    },
			    "then" : {"properties" : {"unimplemented" : false}}
		    }
	    ]
    }));
CONFIG_TABLE(register_bits_table, .name = "register_bits", .add = modbus_put_bit_meanings,
	     .forms = CONFIG_FORMS(&object_table),
	     .json = CONFIG_JSON({
		     "$ref" : "#/$defs/object",
		     "required" : ["ioa"],
		     "properties" : {
			     "type" : {"enum" : [ "single", "double" ], "default" : "single"},
			     "second_address" : false,
			     "word_order" : false,
			     "scale" : false,
			     "offset" : false,
			     "scale_register" : false,
			     "short_pulse_ms" : false,
			     "long_pulse_ms" : false
		     },
		     "if" : {"required" : ["type"], "properties" : {"type" : {"const" : "double"}}},
		     "then" : {"properties" : {"bit" : {"maximum" : 14}}}
	     }));
CONFIG_TABLE(register_table, .name = "register",
	     .forms = CONFIG_FORMS(&register_bits_table, &registers_table),
	     .json = CONFIG_JSON({
		     "if" : {"type" : "object", "required" : ["bit"]},
		     "then" : {"$ref" : "#/$defs/register_bits"},
		     "else" : {"$ref" : "#/$defs/registers"}
	     }));
CONFIG_SHARED_TABLE(modbus_coil_table, .name = "coil", .forms = CONFIG_FORMS(&bits_table),
		    .json = CONFIG_JSON({"$ref" : "#/$defs/bits"}));
CONFIG_SHARED_TABLE(modbus_discrete_input_table, .name = "discrete_input", .add = modbus_put_commands,
		    .forms = CONFIG_FORMS(&bits_table),
		    .json = CONFIG_JSON({"$ref" : "#/$defs/bits", "properties" : {"write_only" : false}}));
CONFIG_TABLE(commanded_register_table, .name = "commanded_register",
	     .json = CONFIG_JSON({
		     "dependentRequired" : {"step" : [ "min", "max" ], "min" : ["max"], "max" : ["min"]},
		     "if" : {"properties" : {"type" : {"enum" : [ "normalized", "scaled" ]}}},
		     "then" : {"properties" : {"step" : {"multipleOf" : 1}}}
	     }));
CONFIG_SHARED_TABLE(modbus_input_register_table, .name = "input_register", .add = modbus_put_commands,
		    .forms = CONFIG_FORMS(&register_table, &commanded_register_table),
		    .json = CONFIG_JSON({
			    "$ref" : "#/$defs/register",
			    "properties" : {"write_only" : false},
			    "if" : {"required" : ["write_address"]},
			    "then" : {"$ref" : "#/$defs/commanded_register"}
		    }));
CONFIG_SHARED_TABLE(modbus_holding_register_table, .name = "holding_register",
		    .forms = CONFIG_FORMS(&register_table, &commanded_register_table),
		    .json = CONFIG_JSON({
			    "$ref" : "#/$defs/register",
			    "allOf" : [ {"$ref" : "#/$defs/commanded_register"} ]
		    }));
const char *const modbus_status_keys[MODBUS_STATUS_BITS] = {
    [MODBUS_BLOCKED_BY] = "blocked_by",
    [MODBUS_SUBSTITUTED_BY] = "substituted_by",
    [MODBUS_NOT_TOPICAL_BY] = "not_topical_by",
};
