/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "config/meanings.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "config/sections.h"
#include "map/meaning.h"
#include "map/type.h"

/* As the number is written, without sign or zeros that say nothing. */
static bool read_number(const char *text, enum map_type type, int32_t *number)
{
	union map_value value;
	char again[16], *end;
	long long read;

	errno = 0;
	read = strtoll(text, &end, 10);
	if (errno != 0 || *end != '\0' || read < INT32_MIN || read > INT32_MAX ||
	    !map_value_of(type, (double)read, &value))
		return false;
	*number = (int32_t)read;
	snprintf(again, sizeof(again), "%d", *number);
	return strcmp(text, again) == 0;
}

/* A command that gives it would mean another value. */
static bool is_number(const char *text)
{
	char *end;

	strtod(text, &end);
	return end != text && *end == '\0';
}

static bool is_text(const json_t *json)
{
	const char *text = json_string_value(json);
	const size_t length = text == NULL ? 0 : strlen(text);

	for (size_t i = 0; i < length; i++)
		if ((unsigned char)text[i] < ' ' || text[i] == 0x7f)
			return false;
	return length > 0 && length < MAP_MEANING_SIZE;
}

static bool is_twice(const json_t *names, const char *key, const char *text)
{
	const char *other;
	json_t *json;

	json_object_foreach((json_t *)names, other, json)
	{
		if (strcmp(other, key) == 0)
			return false;
		if (json_is_string(json) && strcmp(json_string_value(json), text) == 0)
			return true;
	}
	return false;
}

static void check_meaning(struct config_report *report, const struct config_place *here, enum map_type type,
			  const json_t *names, const char *key, const json_t *text)
{
	int32_t number;

	if (!read_number(key, type, &number))
		config_error(report, here, "is no value of type %s, expected an integer as \"3\"",
			     map_types[type].name);
	if (!is_text(text))
		config_error(report, here, "is no name, expected a string of 1 to %d printable bytes",
			     MAP_MEANING_SIZE - 1);
	else if (is_number(json_string_value(text)))
		config_error(report, here, "\"%s\" is a number, expected a name", json_string_value(text));
	else if (is_twice(names, key, json_string_value(text)))
		config_error(report, here, "\"%s\" is the name of another value", json_string_value(text));
}

void config_check_meanings(struct config_report *report, const struct config_place *place, enum map_type type,
			   const json_t *names)
{
	const char *key;
	json_t *text;

	if (json_object_size(names) == 0 || json_object_size(names) > CONFIG_MEANINGS_MAX) {
		config_error(report, place, "has %zu names, expected 1 to %d", json_object_size(names),
			     CONFIG_MEANINGS_MAX);
		return;
	}
	json_object_foreach((json_t *)names, key, text)
	{
		const struct config_place here = config_key_of(place, key);

		check_meaning(report, &here, type, names, key, text);
	}
}

static int by_number(const void *left, const void *right)
{
	const struct map_meaning *a = left, *b = right;

	return (a->number > b->number) - (a->number < b->number);
}

void config_keep_meanings(struct config_report *report, struct map_config *config, uint32_t point,
			  const json_t *names)
{
	const uint32_t before = map_record_count(config, MAP_MEANINGS);
	struct map_meaning *meanings;
	const char *key;
	json_t *text;

	if (!config_make_room(report, config, MAP_MEANINGS, sizeof(*meanings), json_object_size(names)))
		return;
	json_object_foreach((json_t *)names, key, text)
	{
		struct map_meaning *meaning = map_next_record(config, MAP_MEANINGS);

		*meaning = (struct map_meaning){.point = point, .number = (int32_t)strtol(key, NULL, 10)};
		snprintf(meaning->text, sizeof(meaning->text), "%s", json_string_value(text));
	}
	meanings = map_records(config, MAP_MEANINGS, sizeof(*meanings));
	qsort(meanings + before, json_object_size(names), sizeof(*meanings), by_number);
}
