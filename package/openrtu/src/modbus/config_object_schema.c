/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The schema of a slave's objects, in a build with the option schema: what modbus_applies_to says, as conditions, and what it cannot say. */
#include "modbus/config_object.h"

/* ---- what modbus_applies_to says: functions for `add` of a table; false: there is no memory ----- */

/* The member of that name, made if it is not there. NULL: there is no memory. */
static json_t *member(json_t *object, const char *name, json_t *(*make)(void))
{
	if (json_object_get(object, name) == NULL && json_object_set_new(object, name, make()) != 0)
		return NULL;
	return json_object_get(object, name);
}

/* An object that the schema describes must not have the key. */
static bool forbid(json_t *schema, unsigned key)
{
	return json_object_set_new(member(schema, "properties", json_object), modbus_object_rules[key].name,
				   json_false()) == 0;
}

static json_t *names_of(unsigned types)
{
	json_t *names = json_array();

	for (unsigned type = 0; modbus_type_names[type] != NULL; type++)
		if (types & MODBUS_TYPE(type))
			json_array_append_new(names, json_string(modbus_type_names[type]));
	return names;
}

/* Holds for an object of one of the types. usual: the type of one that names none. */
static json_t *is_of(unsigned types, enum map_type usual)
{
	json_t *is = json_pack("{s:{s:{s:o}}}", "properties", "type", "enum", names_of(types));

	if (!(types & MODBUS_TYPE(usual)))
		json_object_set_new(is, "required", json_pack("[s]", "type"));
	return is;
}

/* Behind the conditions that the schema has: if it is so, then, or else, what the result is about to hold. */
static json_t *on_condition(json_t *schema, json_t *is, const char *branch)
{
	json_t *condition = json_pack("{s:o, s:{}}", "if", is, branch);

	return json_array_append_new(member(schema, "allOf", json_array), condition) == 0
		   ? json_object_get(condition, branch)
		   : NULL;
}

static bool is_first_of_its_types(unsigned key, unsigned types)
{
	for (unsigned earlier = 0; earlier < key; earlier++)
		if (modbus_applies_to[earlier].types != 0 &&
		    (modbus_applies_to[earlier].types & types) == (modbus_applies_to[key].types & types))
			return false;
	return true;
}

/* Of an object that has one of these types: which keys its type, or each of these types, gives no meaning. */
static bool put_types(json_t *schema, unsigned types, enum map_type usual)
{
	bool done = true;

	for (unsigned key = 0; done && key < OBJECT_KEYS; key++) {
		const unsigned meant = modbus_applies_to[key].types & types;
		json_t *where;

		if (modbus_applies_to[key].types == 0 || meant == types || !is_first_of_its_types(key, types))
			continue;
		where = meant == 0 ? schema : on_condition(schema, is_of(meant, usual), "else");
		for (unsigned other = key; done && other < OBJECT_KEYS; other++)
			if (modbus_applies_to[other].types != 0 &&
			    (modbus_applies_to[other].types & types) == meant)
				done = forbid(where, other);
	}
	return done;
}

/* The values that each type has, as the keys of `names` write them. */
static const struct {
	enum map_type type;
	const char *pattern;
} named_values[] = {
    {MAP_SINGLE, "^[01]$"},
    {MAP_DOUBLE, "^[0-3]$"},
    {MAP_STEP, "^(0|-?([1-9]|[1-5][0-9]|6[0-3])|-64)$"},
    {MAP_BITSTRING, "^[0-9]"},
    {MAP_SCALED, "^(0|-?([1-9][0-9]{0,3}|[12][0-9]{4}|3[01][0-9]{3}|32[0-6][0-9]{2}|327[0-5][0-9]|"
		 "3276[0-7])|-32768)$"},
};

static bool put_named_values(json_t *schema, unsigned types, enum map_type usual)
{
	bool done = true;

	for (size_t i = 0; done && i < sizeof(named_values) / sizeof(named_values[0]); i++) {
		json_t *then;

		if (!(types & MODBUS_TYPE(named_values[i].type)))
			continue;
		then = on_condition(schema, is_of(MODBUS_TYPE(named_values[i].type), usual), "then");
		done =
		    then != NULL &&
		    json_object_set_new(then, "properties",
					json_pack("{s:{s:{s:s}}}", modbus_object_rules[OBJECT_NAMES].name,
						  "propertyNames", "pattern", named_values[i].pattern)) == 0;
	}
	return done;
}

/* Of bits, in a table of bits or in a register: what their type gives no meaning. */
static bool put_types_of_bits(json_t *schema)
{
	return put_types(schema, MODBUS_BIT_TYPES, MAP_SINGLE) &&
	       put_named_values(schema, MODBUS_BIT_TYPES, MAP_SINGLE);
}

/* The same of what fills registers. */
static bool put_types_of_registers(json_t *schema)
{
	return put_types(schema, MODBUS_REGISTER_TYPES, MAP_SCALED) &&
	       put_named_values(schema, MODBUS_REGISTER_TYPES, MAP_SCALED);
}

/* What is only written has no keys of what is read. */
static bool put_write_only(json_t *schema)
{
	const char *name = modbus_object_rules[OBJECT_WRITE_ONLY].name;
	json_t *is = json_pack("{s:[s], s:{s:{s:b}}}", "required", name, "properties", name, "const", true);
	json_t *then = on_condition(schema, is, "then");
	bool done = then != NULL;

	for (unsigned key = 0; done && key < OBJECT_KEYS; key++)
		if (modbus_applies_to[key].of_reading)
			done = forbid(then, key);
	return done;
}

static bool put_read_alone(json_t *schema, json_t *is)
{
	json_t *then = on_condition(schema, is, "then");
	bool done = then != NULL;

	for (unsigned key = 0; done && key < OBJECT_KEYS; key++)
		if (!modbus_applies_to_read_alone(key))
			done = forbid(then, key);
	return done;
}

/* What is on a page, or read only, takes no commands. */
static bool put_object(json_t *schema)
{
	const char *read_only = modbus_object_rules[OBJECT_READ_ONLY].name;

	return put_write_only(schema) &&
	       put_read_alone(schema,
			      json_pack("{s:[s]}", "required", modbus_object_rules[OBJECT_PAGE].name)) &&
	       put_read_alone(schema, json_pack("{s:[s], s:{s:{s:b}}}", "required", read_only, "properties",
						read_only, "const", true));
}

/* Where nothing but a write_address makes something to command, no other key of commands means anything. */
static bool put_commands(json_t *schema)
{
	json_t *is = json_pack("{s:[s]}", "required", modbus_object_rules[OBJECT_WRITE_ADDRESS].name);
	json_t *otherwise = on_condition(schema, is, "else");
	bool done = otherwise != NULL;

	for (unsigned key = 0; done && key < OBJECT_KEYS; key++)
		if (modbus_applies_to[key].of_commands)
			done = forbid(otherwise, key);
	return done;
}

/* A text has what it is read with, and nothing of numbers and commands. */
static bool put_text(json_t *schema)
{
	bool done = true;

	for (unsigned key = 0; done && key < OBJECT_KEYS; key++)
		if (!modbus_applies_to_texts(key))
			done = forbid(schema, key);
	return done;
}

/* ---- the tables -------------------------------------------------------------------------- */

CONFIG_TABLE(
    object_table, .name = "object", .rules = modbus_object_rules, .count = OBJECT_KEYS, .add = put_object,
    .json = CONFIG_JSON({
	    "oneOf" : [ {"required" : ["address"]}, {"required" : ["register"]} ],
	    "if" : {
		    "required" : ["address"],
		    "properties" : {"address" : {"type" : "integer", "minimum" : 10000}}
	    },
	    "then" : {"required" : ["ioa"]},
	    "allOf" : [
		    {
			    "if" : {"required" : ["scale_by"]},
			    "then" : {"properties" : {"scale_register" : false}}
		    },
		    {"if" : {"required" : ["factor_by"]}, "then" : {"properties" : {"scale_table" : false}}},
		    {
			    "if" : {"required" : ["write_values"]},
			    "then" : {
				    "anyOf" : [
					    {"required" : ["write_every_ms"]}, {
						    "required" : ["write_at_return"],
						    "properties" : {"write_at_return" : {"const" : true}}
					    }
				    ]
			    }
		    },
		    {
			    "if" : {
				    "anyOf" : [
					    {"required" : ["write_values"]},
					    {"required" : ["write_at_return"]},
					    {"required" : ["write_every_ms"]}
				    ]
			    },
			    "then" : {
				    "properties" :
					{"scale_register" : false, "scale_by" : false, "factor_by" : false}
			    }
		    },
		    {"if" : {"required" : ["names"]}, "then" : {"properties" : {"step" : false}}}
	    ]
    }));

/* What modbus_applies_to cannot say: how many registers a value has, and what goes beside what. */
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
CONFIG_TABLE(text_format_table, .name = "text_format",
	     .json = CONFIG_JSON(
		 {"required" : ["format"], "properties" : {"format" : {"enum" : [ "string", "string16" ]}}}));
CONFIG_TABLE(
    text_table, .name = "text", .add = put_text,
    .json = CONFIG_JSON({"required" : ["length"], "properties" : {"type" : {"const" : "bitstring"}}}));
CONFIG_TABLE(bits_table, .name = "bits", .add = put_types_of_bits, .forms = CONFIG_FORMS(&object_table),
	     .json = CONFIG_JSON({
		     "$ref" : "#/$defs/object",
		     "properties" : {
			     "type" : {"enum" : [ "single", "double" ], "default" : "single"},
			     "word_order" : false,
			     "byte_order" : false,
			     "scale" : false,
			     "offset" : false,
			     "scale_register" : false,
			     "bit" : false,
			     "length" : false,
			     "write_values" : {"items" : {"enum" : [ 0, 1 ]}}
		     },
		     "if" : {"required" : ["type"], "properties" : {"type" : {"const" : "double"}}},
		     "then" : {
			     "properties" : {"write_address" : {"maximum" : 65534}},
			     "if" : {"not" : {"required" : ["second_address"]}},
			     "then" : {"properties" : {"address" : {"maximum" : 65534}}}
		     }
	     }));
CONFIG_TABLE(
    registers_table, .name = "registers", .add = put_types_of_registers,
    .forms = CONFIG_FORMS(&object_table, &two_registers_table, &three_registers_table, &four_registers_table,
			  &text_format_table, &text_table),
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
			    "then" : {
				    "properties" :
					{"format" : {"enum" : [ "uint16", "uint32", "string", "string16" ]}}
			    }
		    },
		    {
			    "if" : {"$ref" : "#/$defs/text_format"},
			    "then" : {"$ref" : "#/$defs/text"},
			    "else" : {"properties" : {"length" : false}}
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
CONFIG_TABLE(register_bits_table, .name = "register_bits", .add = put_types_of_bits,
	     .forms = CONFIG_FORMS(&object_table),
	     .json = CONFIG_JSON({
		     "$ref" : "#/$defs/object",
		     "required" : ["ioa"],
		     "properties" : {
			     "type" : {"enum" : [ "single", "double" ], "default" : "single"},
			     "second_address" : false,
			     "length" : false,
			     "word_order" : false,
			     "scale" : false,
			     "offset" : false,
			     "scale_register" : false,
			     "short_pulse_ms" : false,
			     "long_pulse_ms" : false,
			     "write_values" : {"items" : {"enum" : [ 0, 1 ]}}
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
CONFIG_SHARED_TABLE(modbus_discrete_input_table, .name = "discrete_input", .add = put_commands,
		    .forms = CONFIG_FORMS(&bits_table),
		    .json = CONFIG_JSON({
			    "$ref" : "#/$defs/bits",
			    "properties" : {"write_only" : false, "read_only" : false}
		    }));
CONFIG_TABLE(commanded_register_table, .name = "commanded_register",
	     .json = CONFIG_JSON({
		     "dependentRequired" : {"step" : [ "min", "max" ], "min" : ["max"], "max" : ["min"]},
		     "if" : {"properties" : {"type" : {"enum" : [ "normalized", "scaled" ]}}},
		     "then" : {"properties" : {"step" : {"multipleOf" : 1}}}
	     }));
CONFIG_SHARED_TABLE(modbus_input_register_table, .name = "input_register", .add = put_commands,
		    .forms = CONFIG_FORMS(&register_table, &commanded_register_table),
		    .json = CONFIG_JSON({
			    "$ref" : "#/$defs/register",
			    "properties" : {"write_only" : false, "read_only" : false},
			    "if" : {"required" : ["write_address"]},
			    "then" : {"$ref" : "#/$defs/commanded_register"}
		    }));
CONFIG_SHARED_TABLE(modbus_holding_register_table, .name = "holding_register",
		    .forms = CONFIG_FORMS(&register_table, &commanded_register_table),
		    .json = CONFIG_JSON({
			    "$ref" : "#/$defs/register",
			    "allOf" : [ {"$ref" : "#/$defs/commanded_register"} ]
		    }));
