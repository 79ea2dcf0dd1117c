/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "config/schema.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#define NO_CONTROLS    "^[^\\u0000-\\u001f\\u007f]*$"
#define REFERENCE_SIZE 128
#define COMMENT_SIZE   160

/* How a key's name says its unit. */
static const struct unit {
	const char *ending, *unit;
} units[] = {{"_ms", "ms"},     {"_s", "s"}, {"_kb", "KiB"},          {"_mb", "MiB"},
	     {"_km_h", "km/h"}, {"_m", "m"}, {"_degrees", "degrees"}, {"_octets", "octets"}};

/* False: there is no memory. */
static bool put(json_t *object, const char *key, json_t *value)
{
	return json_object_set_new(object, key, value) == 0;
}

static bool put_text(json_t *object, const char *key, const char *text)
{
	return text == NULL || put(object, key, json_string(text));
}

static bool put_number(json_t *object, const char *key, const struct config_rule *rule, double value)
{
	return put(object, key,
		   rule->kind == CONFIG_NUMBER ? json_real(value) : json_integer((json_int_t)value));
}

static json_t *reference(const char *definition, const char *property)
{
	char text[REFERENCE_SIZE];

	snprintf(text, sizeof(text), "#/$defs/%s%s%s", definition, property != NULL ? "/properties/" : "",
		 property != NULL ? property : "");
	return json_pack("{s:s}", "$ref", text);
}

/* What is said in JSON goes before what the fields say. */
static bool put_json(json_t *object, const char *text)
{
	json_error_t error;
	json_t *more = text == NULL ? NULL : json_loads(text, 0, &error);
	const bool done = text == NULL || (more != NULL && json_object_update_recursive(object, more) == 0);

	if (text != NULL && more == NULL)
		fprintf(stderr, "%s: %s\n", text, error.text);
	json_decref(more);
	return done;
}

/* ---- a rule ------------------------------------------------------------------------------ */

static const char *unit_of(const struct config_rule *rule)
{
	const size_t length = strlen(rule->name);

	if (rule->unit != NULL || (rule->kind != CONFIG_INTEGER && rule->kind != CONFIG_NUMBER))
		return rule->unit;
	for (size_t i = 0; i < sizeof(units) / sizeof(units[0]); i++) {
		const size_t ending = strlen(units[i].ending);

		if (length > ending && strcmp(rule->name + length - ending, units[i].ending) == 0)
			return units[i].unit;
	}
	return NULL;
}

static void add_comment(char text[COMMENT_SIZE], const char *word, const char *what)
{
	const size_t used = strlen(text);

	if (what != NULL)
		snprintf(text + used, COMMENT_SIZE - used, "%s%s%s", used > 0 ? ", " : "", word, what);
}

/* For who makes a page of it; validators refuse keywords of our own. */
static bool put_comment(json_t *out, const struct config_rule *rule)
{
	const char *unit = unit_of(rule);
	char text[COMMENT_SIZE] = "";

	add_comment(text, "unit: ", unit);
	add_comment(text, "see: ", rule->see);
	add_comment(text, "page: ", rule->page ? "changes it" : NULL);
	if (text[0] == '\0')
		return true;
	return put(out, "$comment", json_string(text));
}

static bool put_bounds(json_t *out, const struct config_rule *rule)
{
	switch (rule->kind) {
	case CONFIG_INTEGER:
	case CONFIG_NUMBER:
		return put(out, "type", json_string(rule->kind == CONFIG_NUMBER ? "number" : "integer")) &&
		       put_number(out, "minimum", rule, rule->low) &&
		       put_number(out, "maximum", rule, rule->high);
	case CONFIG_BOOLEAN:
		return put(out, "type", json_string("boolean"));
	case CONFIG_TEXT:
		return put(out, "type", json_string("string")) &&
		       put(out, "minLength", json_integer((json_int_t)rule->low)) &&
		       put(out, "maxLength", json_integer((json_int_t)rule->high)) &&
		       put_text(out, "pattern", rule->pattern != NULL ? rule->pattern : NO_CONTROLS);
	case CONFIG_ARRAY:
		return put(out, "type", json_string("array")) &&
		       put(out, "maxItems", json_integer((json_int_t)rule->high));
	case CONFIG_OBJECT:
		return put(out, "type", json_string("object"));
	case CONFIG_CHOICE:
	case CONFIG_ANYTHING:
		break;
	}
	return true;
}

static bool put_choices(json_t *out, const struct config_rule *rule)
{
	json_t *choices = json_array();

	for (size_t i = 0; rule->choices[i] != NULL; i++)
		if (json_array_append_new(choices, json_string(rule->choices[i])) != 0)
			break;
	return put(out, "enum", choices);
}

/* The value that a key has which is not given. */
static bool put_default(json_t *out, const struct config_rule *rule)
{
	const double value = rule->otherwise != 0 ? rule->otherwise : rule->fallback;

	if (rule->otherwise_text != NULL)
		return put(out, "default", json_string(rule->otherwise_text));
	if (rule->required || rule->unset)
		return true;
	if (rule->kind == CONFIG_CHOICE)
		return put(out, "default", json_string(rule->choices[(size_t)value]));
	if (rule->kind == CONFIG_BOOLEAN)
		return put(out, "default", json_boolean(value != 0));
	if ((rule->kind != CONFIG_INTEGER && rule->kind != CONFIG_NUMBER) || value < rule->low)
		return true;
	return put_number(out, "default", rule, value);
}

/* NULL: there is no memory. */
static json_t *property(const struct config_rule *rule)
{
	json_t *out = json_object();
	bool done = put_text(out, "description", rule->says) && put_comment(out, rule) &&
		    put_bounds(out, rule) && (rule->kind != CONFIG_CHOICE || put_choices(out, rule)) &&
		    put_default(out, rule);

	if (done && rule->table != NULL && rule->kind == CONFIG_ARRAY)
		done = put(out, "items", reference(rule->table->name, NULL));
	else if (done && rule->table != NULL)
		done = json_object_update_new(out, reference(rule->table->name, NULL)) == 0;
	if (done && put_json(out, rule->json))
		return out;
	json_decref(out);
	return NULL;
}

/* ---- a table ----------------------------------------------------------------------------- */

static bool put_property(json_t *properties, json_t *required, const struct config_rule *rule,
			 const struct config_table *like)
{
	return put(properties, rule->name,
		   like != NULL ? reference(like->name, rule->name) : property(rule)) &&
	       (!rule->required || json_array_append_new(required, json_string(rule->name)) == 0);
}

static bool put_properties(json_t *properties, json_t *required, const struct config_table *table)
{
	const struct config_rule *own = table->own;

	for (size_t i = 0; i < table->count; i++) {
		const bool replaced = own != NULL && strcmp(own->name, table->rules[i].name) == 0;

		if (!put_property(properties, required, replaced ? own : &table->rules[i],
				  replaced ? NULL : table->like))
			return false;
	}
	return own == NULL || json_object_get(properties, own->name) != NULL ||
	       put_property(properties, required, own, NULL);
}

/* A table without rules is what its JSON says. */
static json_t *definition(const struct config_table *table)
{
	json_t *out = json_object(), *properties = json_object(), *required = json_array();
	bool done = put_properties(properties, required, table);

	if (done && table->count > 0)
		done = put(out, "type", json_string("object")) &&
		       (json_array_size(required) == 0 || put(out, "required", json_incref(required))) &&
		       put(out, "additionalProperties", json_false()) &&
		       put(out, "properties", json_incref(properties));
	done = done && put_json(out, table->json) && (table->add == NULL || table->add(out));
	json_decref(required);
	json_decref(properties);
	if (done)
		return out;
	json_decref(out);
	return NULL;
}

static bool put_definitions(json_t *definitions, const struct config_table *table);

static bool put_forms(json_t *definitions, const struct config_table *const *forms)
{
	for (; forms != NULL && *forms != NULL; forms++)
		if (!put_definitions(definitions, *forms))
			return false;
	return true;
}

/* Those that the rules of the table lead to. */
static bool put_children(json_t *definitions, const struct config_table *table)
{
	for (size_t i = 0; i <= table->count; i++) {
		const struct config_rule *rule = i < table->count ? &table->rules[i] : table->own;

		if (rule != NULL && ((rule->table != NULL && !put_definitions(definitions, rule->table)) ||
				     !put_forms(definitions, rule->forms)))
			return false;
	}
	return put_forms(definitions, table->forms);
}

static bool put_definitions(json_t *definitions, const struct config_table *table)
{
	return json_object_get(definitions, table->name) != NULL ||
	       (put(definitions, table->name, definition(table)) && put_children(definitions, table));
}

/* In $defs are the tables that the rules lead to. NULL: there is no memory. */
static json_t *schema_of(const struct config_table *file)
{
	json_t *out = json_pack("{s:s}", "$schema", "https://json-schema.org/draft/2020-12/schema");
	json_t *definitions = json_object(), *outermost = definition(file);
	bool done =
	    outermost != NULL && json_object_update(out, outermost) == 0 && put_children(definitions, file);

	if (done && json_object_get(out, "$defs") != NULL)
		done = json_object_update(json_object_get(out, "$defs"), definitions) == 0;
	else
		done = done && put(out, "$defs", json_incref(definitions));
	json_decref(outermost);
	json_decref(definitions);
	if (done)
		return out;
	json_decref(out);
	return NULL;
}

bool config_print_schema(const struct config_table *file, FILE *out)
{
	json_t *schema = schema_of(file);
	bool printed = schema != NULL && json_dumpf(schema, out, JSON_INDENT(2)) == 0;

	json_decref(schema);
	return printed && fputc('\n', out) != EOF && fflush(out) == 0;
}
