/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What modbus_meanings says, as conditions of a JSON Schema: in a build with the option schema. */
#include "modbus/config_meaning_schema.h"

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
		if (modbus_meanings[earlier].types != 0 &&
		    (modbus_meanings[earlier].types & types) == (modbus_meanings[key].types & types))
			return false;
	return true;
}

/* Of an object that has one of these types: which keys its type, or each of these types, gives no meaning. */
static bool put_types(json_t *schema, unsigned types, enum map_type usual)
{
	bool done = true;

	for (unsigned key = 0; done && key < OBJECT_KEYS; key++) {
		const unsigned meant = modbus_meanings[key].types & types;
		json_t *where;

		if (modbus_meanings[key].types == 0 || meant == types || !is_first_of_its_types(key, types))
			continue;
		where = meant == 0 ? schema : on_condition(schema, is_of(meant, usual), "else");
		for (unsigned other = key; done && other < OBJECT_KEYS; other++)
			if (modbus_meanings[other].types != 0 &&
			    (modbus_meanings[other].types & types) == meant)
				done = forbid(where, other);
	}
	return done;
}

bool modbus_put_bit_meanings(json_t *schema)
{
	return put_types(schema, MODBUS_BIT_TYPES, MAP_SINGLE);
}

bool modbus_put_register_meanings(json_t *schema)
{
	return put_types(schema, MODBUS_REGISTER_TYPES, MAP_SCALED);
}

bool modbus_put_write_only(json_t *schema)
{
	const char *name = modbus_object_rules[OBJECT_WRITE_ONLY].name;
	json_t *is = json_pack("{s:[s], s:{s:{s:b}}}", "required", name, "properties", name, "const", true);
	json_t *then = on_condition(schema, is, "then");
	bool done = then != NULL;

	for (unsigned key = 0; done && key < OBJECT_KEYS; key++)
		if (modbus_meanings[key].of_reading)
			done = forbid(then, key);
	return done;
}

bool modbus_put_commands(json_t *schema)
{
	json_t *is = json_pack("{s:[s]}", "required", modbus_object_rules[OBJECT_WRITE_ADDRESS].name);
	json_t *otherwise = on_condition(schema, is, "else");
	bool done = otherwise != NULL;

	for (unsigned key = 0; done && key < OBJECT_KEYS; key++)
		if (modbus_meanings[key].of_commands)
			done = forbid(otherwise, key);
	return done;
}
