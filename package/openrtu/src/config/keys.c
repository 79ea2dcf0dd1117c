/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "config/keys.h"

#include <stdarg.h>
#include <string.h>

#include "config/near.h"

#define QUOTE_SIZE      64
#define EXPECTED_SIZE   1024
#define CONTROL_DELETE  0x7f
#define UTF8_IS_TAIL(c) (((unsigned char)(c)&0xc0u) == 0x80u)

/* ---- messages ---------------------------------------------------------------------------- */

static bool is_control(char c)
{
	return (unsigned char)c < ' ' || c == CONTROL_DELETE;
}

/* What the file's author wrote, fit for one line of a terminal. out: QUOTE_SIZE bytes. */
static const char *quote(const char *text, char *out)
{
	size_t length = strlen(text);

	if (length >= QUOTE_SIZE) {
		length = QUOTE_SIZE - sizeof("...");
		while (length > 0 && UTF8_IS_TAIL(text[length]))
			length--;
	}
	for (size_t i = 0; i < length; i++)
		out[i] = is_control(text[i]) ? '?' : text[i];
	strcpy(out + length, text[length] == '\0' ? "" : "...");
	return out;
}

/* Writes a place in words. out: CONFIG_PLACE_SIZE bytes; longer places are cut. */
static void place_text(const struct config_place *place, char *out)
{
	char quoted[QUOTE_SIZE];
	size_t used;

	if (place->in == NULL) {
		strcpy(out, "the file");
		return;
	}
	place_text(place->in, out);
	used = place->in->in == NULL ? 0 : strlen(out);
	if (place->key == NULL)
		snprintf(out + used, CONFIG_PLACE_SIZE - used, "[%zu]", place->index);
	else
		snprintf(out + used, CONFIG_PLACE_SIZE - used, "%s%s", used == 0 ? "" : ".",
			 quote(place->key, quoted));
}

static const struct config_place *file_of(const struct config_place *place)
{
	while (place->in != NULL)
		place = place->in;
	return place;
}

static const struct config_source *source_of(const struct config_report *report,
					     const struct config_place *place)
{
	const struct config_source *source = file_of(place)->source;

	return source != NULL ? source : &report->source;
}

void config_place_where(const struct config_report *report, const struct config_place *place, char *out)
{
	const struct config_place *instance = file_of(place)->instance;
	const struct config_source *source = source_of(report, place);
	char where[CONFIG_PLACE_SIZE], used[CONFIG_PLACE_SIZE] = "";

	place_text(place, where);
	if (instance != NULL)
		place_text(instance, used);
	snprintf(out, CONFIG_WHERE_SIZE, "%s (%.300s:%u%s%s)", where, source->path,
		 config_line_of(source, place), instance != NULL ? ", for " : "", used);
}

/* gateway.json:12: port[0].slaves[1]: message */
__attribute__((format(printf, 4, 0))) static void say(struct config_report *report, const char *prefix,
						      const struct config_place *place, const char *format,
						      va_list arguments)
{
	const struct config_place *instance = file_of(place)->instance;
	const struct config_source *source = source_of(report, place);
	char where[CONFIG_PLACE_SIZE], where_used[CONFIG_WHERE_SIZE];

	if (report->shown++ >= CONFIG_SHOWN_MAX)
		return;
	place_text(place, where);
	fprintf(report->messages, "%s:%u: %s%s: ", source->path, config_line_of(source, place), prefix,
		where);
	vfprintf(report->messages, format, arguments);
	if (instance != NULL) {
		config_place_where(report, instance, where_used);
		fprintf(report->messages, "; for %s", where_used);
	}
	fputc('\n', report->messages);
}

void config_out_of_memory(struct config_report *report)
{
	fputs("out of memory\n", report->messages);
	report->errors++;
}

void config_report_end(struct config_report *report)
{
	if (report->shown > CONFIG_SHOWN_MAX)
		fprintf(report->messages, "%s: %u more messages are not shown\n", report->source.path,
			report->shown - CONFIG_SHOWN_MAX);
}

void config_error(struct config_report *report, const struct config_place *place, const char *format, ...)
{
	va_list arguments;

	va_start(arguments, format);
	say(report, "", place, format, arguments);
	va_end(arguments);
	report->errors++;
}

void config_note(struct config_report *report, const struct config_place *place, const char *format, ...)
{
	va_list arguments;

	va_start(arguments, format);
	say(report, "note: ", place, format, arguments);
	va_end(arguments);
}

/* ---- what a rule expects ------------------------------------------------------------------ */

static void append(char *out, const char *separator, const char *word)
{
	size_t used = strlen(out);

	snprintf(out + used, EXPECTED_SIZE - used, "%s%s", separator, word);
}

/* out: EXPECTED_SIZE bytes */
static const char *expected(const struct config_rule *rule, char *out)
{
	out[0] = '\0';
	switch (rule->kind) {
	case CONFIG_INTEGER:
		snprintf(out, EXPECTED_SIZE, "an integer from %.0f to %.0f", rule->low, rule->high);
		break;
	case CONFIG_NUMBER:
		snprintf(out, EXPECTED_SIZE, "a number from %g to %g", rule->low, rule->high);
		break;
	case CONFIG_BOOLEAN:
		strcpy(out, "true or false");
		break;
	case CONFIG_TEXT:
		snprintf(out, EXPECTED_SIZE, "a string of %.0f to %.0f bytes", rule->low, rule->high);
		break;
	case CONFIG_CHOICE:
		for (size_t i = 0; rule->choices[i] != NULL; i++)
			append(out, i == 0 ? "one of " : ", ", rule->choices[i]);
		break;
	case CONFIG_ARRAY:
		strcpy(out, "an array [ ]");
		break;
	case CONFIG_OBJECT:
		strcpy(out, "an object { }");
		break;
	case CONFIG_ANYTHING:
		strcpy(out, "anything");
		break;
	}
	return out;
}

static const char *type_name(const json_t *json)
{
	switch (json_typeof(json)) {
	case JSON_OBJECT:
		return "an object";
	case JSON_ARRAY:
		return "an array";
	case JSON_STRING:
		return "a string";
	case JSON_INTEGER:
		return "an integer";
	case JSON_REAL:
		return "a decimal number";
	case JSON_TRUE:
	case JSON_FALSE:
		return "a boolean";
	case JSON_NULL:
		return "null";
	}
	return "unknown";
}

static bool has_type(enum config_kind kind, const json_t *json)
{
	switch (kind) {
	case CONFIG_INTEGER:
		return json_is_integer(json);
	case CONFIG_NUMBER:
		return json_is_number(json);
	case CONFIG_BOOLEAN:
		return json_is_boolean(json);
	case CONFIG_TEXT:
	case CONFIG_CHOICE:
		return json_is_string(json);
	case CONFIG_ARRAY:
		return json_is_array(json);
	case CONFIG_OBJECT:
		return json_is_object(json);
	case CONFIG_ANYTHING:
		return true;
	}
	return false;
}

/* ---- values ------------------------------------------------------------------------------ */

static bool read_integer(struct config_report *report, const struct config_place *place,
			 const struct config_rule *rule, struct config_value *value)
{
	value->integer = json_integer_value(value->json);
	if (value->integer >= (int64_t)rule->low && value->integer <= (int64_t)rule->high)
		return true;
	config_error(report, place, "%lld is out of range, expected %.0f to %.0f", (long long)value->integer,
		     rule->low, rule->high);
	return false;
}

static bool read_number(struct config_report *report, const struct config_place *place,
			const struct config_rule *rule, struct config_value *value)
{
	value->number = json_number_value(value->json);
	if (value->number >= rule->low && value->number <= rule->high)
		return true;
	config_error(report, place, "%g is out of range, expected %g to %g", value->number, rule->low,
		     rule->high);
	return false;
}

static bool read_text(struct config_report *report, const struct config_place *place,
		      const struct config_rule *rule, struct config_value *value)
{
	size_t length = json_string_length(value->json);

	value->text = json_string_value(value->json);
	if (length < (size_t)rule->low || length > (size_t)rule->high) {
		config_error(report, place, "is %zu bytes long, expected %.0f to %.0f bytes", length,
			     rule->low, rule->high);
		return false;
	}
	for (size_t i = 0; i < length; i++) {
		if (is_control(value->text[i])) {
			config_error(report, place, "has a control character, expected printable text");
			return false;
		}
	}
	return true;
}

static bool read_choice(struct config_report *report, const struct config_place *place,
			const struct config_rule *rule, struct config_value *value)
{
	char words[EXPECTED_SIZE], quoted[QUOTE_SIZE];
	struct near best = {.word = NULL};

	value->text = json_string_value(value->json);
	for (size_t i = 0; rule->choices[i] != NULL; i++) {
		if (strcmp(rule->choices[i], value->text) == 0) {
			value->integer = (int64_t)i;
			return true;
		}
		near_consider(&best, value->text, rule->choices[i]);
	}
	config_error(report, place, "\"%s\" is not known, expected %s%s%s%s", quote(value->text, quoted),
		     expected(rule, words), near_enough(&best) ? ", did you mean \"" : "",
		     near_enough(&best) ? best.word : "", near_enough(&best) ? "\"?" : "");
	return false;
}

static bool read_array(struct config_report *report, const struct config_place *place,
		       const struct config_rule *rule, struct config_value *value)
{
	if (json_array_size(value->json) <= (size_t)rule->high)
		return true;
	config_error(report, place, "has %zu elements, expected at most %.0f", json_array_size(value->json),
		     rule->high);
	return false;
}

static bool read_value(struct config_report *report, const struct config_place *place,
		       const struct config_rule *rule, struct config_value *value)
{
	char words[EXPECTED_SIZE];

	if (!has_type(rule->kind, value->json)) {
		config_error(report, place, "is %s, expected %s", type_name(value->json),
			     expected(rule, words));
		return false;
	}
	switch (rule->kind) {
	case CONFIG_INTEGER:
		return read_integer(report, place, rule, value);
	case CONFIG_NUMBER:
		return read_number(report, place, rule, value);
	case CONFIG_BOOLEAN:
		value->integer = json_is_true(value->json);
		return true;
	case CONFIG_TEXT:
		return read_text(report, place, rule, value);
	case CONFIG_CHOICE:
		return read_choice(report, place, rule, value);
	case CONFIG_ARRAY:
		return read_array(report, place, rule, value);
	case CONFIG_OBJECT:
	case CONFIG_ANYTHING:
		return true;
	}
	return false;
}

static void read_key(struct config_report *report, const struct config_place *place, const json_t *object,
		     const struct config_rule *rule, struct config_value *value)
{
	const struct config_place here = config_key_of(place, rule->name);
	char words[EXPECTED_SIZE];

	*value = (struct config_value){.integer = (int64_t)rule->fallback, .number = rule->fallback};
	value->json = json_object_get(object, rule->name);
	if (value->json != NULL) {
		value->given = read_value(report, &here, rule, value);
		value->wrong = !value->given;
	} else if (rule->required) {
		config_error(report, &here, "is missing, expected %s", expected(rule, words));
		value->wrong = true;
	}
}

static void refuse_unknown_key(struct config_report *report, const struct config_place *place,
			       const char *key, const struct config_rule *rules, size_t count)
{
	const struct config_place here = config_key_of(place, key);
	struct near best = {.word = NULL};
	char words[EXPECTED_SIZE] = "";

	for (size_t i = 0; i < count; i++) {
		if (strcmp(rules[i].name, key) == 0)
			return;
		near_consider(&best, key, rules[i].name);
		append(words, i == 0 ? "" : ", ", rules[i].name);
	}
	if (near_enough(&best))
		config_error(report, &here, "unknown key, did you mean \"%s\"?", best.word);
	else
		config_error(report, &here, "unknown key, expected one of %s", words);
}

void config_read_keys(struct config_report *report, const struct config_place *place, const json_t *object,
		      const struct config_rule *rules, size_t count, struct config_value *values)
{
	if (object != NULL && !json_is_object(object)) {
		config_error(report, place, "is %s, expected an object { }", type_name(object));
		for (size_t i = 0; i < count; i++)
			values[i] = (struct config_value){.wrong = true};
		return;
	}
	for (void *at = json_object_iter((json_t *)object); at != NULL;
	     at = json_object_iter_next((json_t *)object, at))
		refuse_unknown_key(report, place, json_object_iter_key(at), rules, count);
	for (size_t i = 0; i < count; i++)
		read_key(report, place, object, &rules[i], &values[i]);
}
