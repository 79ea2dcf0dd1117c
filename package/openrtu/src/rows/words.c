/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rows/words.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <time.h>

#include "map/meaning.h"
#include "map/time_ns.h"
#include "map/type.h"

#define COUNT(array)   (sizeof(array) / sizeof((array)[0]))
#define ANGLE_DECIMALS 7

#define BIT_AND_WORD(name, bit, word, letters)   {bit, word},
#define WORD_AND_COMMA(name, bit, word, letters) word ","
_Static_assert(sizeof(MAP_QUALITIES(WORD_AND_COMMA)) <= WORDS_SIZE, "all at once");

static const double NVA_ONE = 32768; /* IEC 60870-5-101, 7.2.6.6 */

static const char *word(const char *const *words, size_t count, unsigned index)
{
	return index < count ? words[index] : "unknown";
}

const char *words_type(enum map_type type)
{
	return type < MAP_TYPES ? map_types[type].name : "unknown";
}

const char *words_module_state(enum map_module_state state)
{
	static const char *const words[] = {MAP_MODULE_STATES(MAP_WORDS)};

	return word(words, COUNT(words), state);
}

const char *words_cause(enum map_cause cause)
{
	static const char *const words[] = {MAP_CAUSES(MAP_WORDS)};

	return word(words, COUNT(words), cause);
}

const char *words_clock_source(enum map_clock_source source)
{
	static const char *const words[] = {"none", "controlling station", "system, synchronised",
					    "system, no longer synchronised"};

	return word(words, COUNT(words), source);
}

const char *words_log_level(enum map_log_level level)
{
	static const char *const words[] = {MAP_LOG_LEVELS(MAP_WORDS)};

	return word(words, COUNT(words), level);
}

void words_quality(uint8_t quality, char *out)
{
	static const struct {
		uint8_t bit;
		const char *word;
	} bits[] = {MAP_QUALITIES(BIT_AND_WORD)};
	size_t used = 0;

	strcpy(out, "good");
	for (size_t i = 0; i < COUNT(bits); i++)
		if (quality & bits[i].bit)
			used += (size_t)snprintf(out + used, WORDS_SIZE - used, "%s%s", used ? "," : "",
						 bits[i].word);
}

void words_age(double seconds, char *out)
{
	static const struct {
		double below, unit;
		int decimals;
		const char *name;
	} steps[] = {
	    {9.95, 1, 1, "s"},      {120, 1, 0, "s"},          {7200, 60, 0, "min"},
	    {172800, 3600, 0, "h"}, {INFINITY, 86400, 0, "d"},
	};
	size_t i = 0;

	while (i + 1 < COUNT(steps) && seconds >= steps[i].below)
		i++;
	snprintf(out, WORDS_SIZE, "%.*f %s", steps[i].decimals, seconds / steps[i].unit, steps[i].name);
}

static void put_time(int64_t wall_ns, int digits, int64_t unit_ns, char *out)
{
	time_t seconds = (time_t)(wall_ns / NS_PER_S);
	char date[WORDS_SIZE / 2];
	struct tm utc;

	gmtime_r(&seconds, &utc);
	strftime(date, sizeof(date), "%Y-%m-%dT%H:%M:%S", &utc);
	snprintf(out, WORDS_SIZE, "%s.%0*dZ", date, digits, (int)(wall_ns % NS_PER_S / unit_ns));
}

void words_time(int64_t wall_ns, char *out)
{
	put_time(wall_ns, 3, NS_PER_MS, out);
}

void words_time_us(int64_t wall_ns, char *out)
{
	put_time(wall_ns, 6, NS_PER_US, out);
}

/* ---- values ------------------------------------------------------------------------------ */

static const char *const single_words[] = {"off", "on"};
static const char *const double_words[] = {"intermediate", "off", "on", "indeterminate"};

json_t *words_value(enum map_type type, const union map_value *value)
{
	switch (map_types[type].form) {
	case MAP_FORM_SINGLE:
		return json_string(single_words[value->u & 1]);
	case MAP_FORM_DOUBLE:
		return json_string(double_words[value->u & 3]);
	case MAP_FORM_SIGNED:
		return json_integer(value->i);
	case MAP_FORM_UNSIGNED:
		return json_integer(value->u);
	case MAP_FORM_FRACTION:
		return json_real(value->i / NVA_ONE);
	case MAP_FORM_FLOAT:
		return isfinite(value->f) ? json_real(map_shortest(value->f)) : json_null();
	case MAP_FORM_DEGREES:
		return json_real(map_number(type, *value));
	}
	return json_null();
}

bool words_angle(const json_t *row, const json_t *value, char *out)
{
	const char *type = json_string_value(json_object_get(row, "type"));

	if (!json_is_real(value) || value != json_object_get(row, "value") || type == NULL ||
	    strcmp(type, map_types[MAP_ANGLE].name) != 0)
		return false;
	snprintf(out, WORDS_SIZE, "%.*f", ANGLE_DECIMALS, json_real_value(value));
	return true;
}

bool words_meaning(const json_t *row, const json_t *value, char *out)
{
	const char *meaning = json_string_value(json_object_get(row, "meaning"));

	if (meaning == NULL || value == NULL || value != json_object_get(row, "value"))
		return false;
	if (json_is_string(value))
		snprintf(out, WORDS_SIZE, "%s (%s)", meaning, json_string_value(value));
	else
		snprintf(out, WORDS_SIZE, "%s (%.0f)", meaning, json_number_value(value));
	return true;
}

static bool is_in_range(enum map_type type, double value)
{
	return value >= map_types[type].low && value <= map_types[type].high;
}

static bool parse_integer(const char *text, enum map_type type, long long *out)
{
	char *end;

	errno = 0;
	*out = strtoll(text, &end, 0);
	return *text != '\0' && *end == '\0' && errno == 0 && is_in_range(type, (double)*out);
}

static bool parse_number(const char *text, double *out)
{
	char *end;

	*out = strtod(text, &end);
	return *text != '\0' && *end == '\0' && isfinite(*out);
}

static bool parse_degrees(const char *text, union map_value *out)
{
	double number;

	return parse_number(text, &number) && map_value_of(MAP_ANGLE, number, out);
}

static bool parse_signed(const char *text, enum map_type type, union map_value *out)
{
	long long number;

	if (!parse_integer(text, type, &number))
		return false;
	out->i = (int32_t)number;
	return true;
}

static bool parse_on_off(const char *text, uint32_t off, uint32_t on, union map_value *out)
{
	bool is_on = strcasecmp(text, "on") == 0 || strcmp(text, "1") == 0;
	bool is_off = strcasecmp(text, "off") == 0 || strcmp(text, "0") == 0;

	out->u = is_on ? on : off;
	return is_on || is_off;
}

static bool parse_bits(const char *text, union map_value *out)
{
	long long number;

	if (!parse_integer(text, MAP_BITSTRING, &number))
		return false;
	out->u = (uint32_t)number;
	return true;
}

static bool parse_fraction(const char *text, union map_value *out)
{
	double number;

	if (!parse_number(text, &number))
		return false;
	number = round(number * NVA_ONE);
	if (!is_in_range(MAP_NORMALIZED, number))
		return false;
	out->i = (int32_t)number;
	return true;
}

static bool parse_float(const char *text, union map_value *out)
{
	double number;

	return parse_number(text, &number) && map_value_of(MAP_FLOAT, number, out);
}

bool words_parse_value(enum map_type type, const char *text, union map_value *out)
{
	switch (map_types[type].form) {
	case MAP_FORM_SINGLE:
		return parse_on_off(text, 0, 1, out);
	case MAP_FORM_DOUBLE:
		return parse_on_off(text, 1, 2, out);
	case MAP_FORM_SIGNED:
		return parse_signed(text, type, out);
	case MAP_FORM_UNSIGNED:
		return parse_bits(text, out);
	case MAP_FORM_FRACTION:
		return parse_fraction(text, out);
	case MAP_FORM_FLOAT:
		return parse_float(text, out);
	case MAP_FORM_DEGREES:
		return parse_degrees(text, out);
	}
	return false;
}

bool words_parse_point(const struct map_config *config, uint32_t point, const char *text,
		       union map_value *out)
{
	const enum map_type type = (enum map_type)config->points[point].type;
	const struct map_meaning *meanings;
	long long number;

	if (map_meaning_value(config, point, text, out))
		return true;
	/* Of two states the numbers are those that the names have, and not off and on. */
	if (map_meanings_of(config, point, &meanings) > 0 && parse_integer(text, type, &number))
		return map_value_of(type, (double)number, out);
	return words_parse_value(type, text, out);
}

/* As many names as there is room for. */
const char *words_expected_of(const struct map_config *config, uint32_t point, char *out)
{
	const struct map_meaning *meanings;
	const uint32_t count = map_meanings_of(config, point, &meanings);
	size_t length = 0;

	if (count == 0)
		snprintf(out, WORDS_LONG_SIZE, "%s", map_types[config->points[point].type].expected);
	for (uint32_t i = 0; i < count; i++) {
		const bool fits = length + strlen(meanings[i].text) + sizeof(", …") < WORDS_LONG_SIZE;

		length += (size_t)snprintf(out + length, WORDS_LONG_SIZE - length, "%s%s", i == 0 ? "" : ", ",
					   fits ? meanings[i].text : "…");
		if (!fits)
			break;
	}
	return out;
}
