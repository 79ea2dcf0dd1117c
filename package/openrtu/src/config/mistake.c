/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "config/mistake.h"

#include <ctype.h>
#include <string.h>

#define IS_TAIL(c) (((unsigned char)(c)&0xc0u) == 0x80u)

/* The character that the parser stopped at is the last that it has read. */
struct stop {
	const char *text;
	size_t length;
	size_t at;     /* of the first character of the token */
	size_t before; /* of the last character before it that is no space; at if there is none */
};

static struct config_spot spot_of(const char *text, size_t at)
{
	struct config_spot spot = {.line = 1, .column = 1};

	for (size_t i = 0; i < at; i++) {
		spot.column += !IS_TAIL(text[i]);
		if (text[i] == '\n')
			spot = (struct config_spot){.line = spot.line + 1, .column = 1};
	}
	return spot;
}

static bool begins_with(const struct config_source *source, const char *octets)
{
	return source->length >= strlen(octets) && memcmp(source->text, octets, strlen(octets)) == 0;
}

static const char *wrong_encoding(const struct config_source *source)
{
	if (begins_with(source, "\xef\xbb\xbf"))
		return "begins with a byte order mark (BOM): save it as UTF-8 without BOM";
	if (begins_with(source, "\xff\xfe") || begins_with(source, "\xfe\xff"))
		return "is UTF-16 (\"Unicode\"): save it as UTF-8";
	for (size_t i = 0; i < source->length; i++)
		if (!isspace((unsigned char)source->text[i]))
			return NULL;
	return "is empty, expected an object { }";
}

/* "... near 'token'": its length. */
static size_t token_length(const json_error_t *error)
{
	const char *near = strstr(error->text, " near '");
	size_t length = near != NULL ? strlen(near) : 0;

	return length > sizeof(" near ''") - 1 ? length - (sizeof(" near ''") - 1) : 1;
}

static struct stop stop_of(const struct config_source *source, const json_error_t *error)
{
	size_t end = (size_t)error->position, length = token_length(error);
	struct stop stop = {.text = source->text, .length = source->length};

	end = end <= source->length ? end : source->length;
	stop.at = end >= length ? end - length : 0;
	stop.before = stop.at;
	for (size_t i = stop.at; i > 0; i--) {
		if (isspace((unsigned char)source->text[i - 1]))
			continue;
		stop.before = i - 1;
		break;
	}
	return stop;
}

static char next_to(const struct stop *stop)
{
	return stop->at + 1 < stop->length ? stop->text[stop->at + 1] : '\0';
}

static bool is_comment(const struct stop *stop, char c)
{
	return c == '#' || (c == '/' && (next_to(stop) == '/' || next_to(stop) == '*'));
}

static bool ends_value(char c)
{
	return c == '"' || c == '}' || c == ']' || isalnum((unsigned char)c);
}

/* behind: the file should have ended before. */
static const char *mistake_at(struct stop *stop, bool behind)
{
	char c = stop->at < stop->length ? stop->text[stop->at] : '\0';
	char before = stop->before < stop->at ? stop->text[stop->before] : '\0';

	if (is_comment(stop, c))
		return "is a comment, which JSON does not have: delete it";
	if (behind)
		return NULL;
	if ((c == '}' || c == ']') && before == ',') {
		stop->at = stop->before;
		return c == '}' ? "is a comma behind the last entry of { }: delete it"
				: "is a comma behind the last element of [ ]: delete it";
	}
	if (c == '\'')
		return "is a single quotation mark: write names and texts as \"name\"";
	if ((c == '"' || c == '{' || c == '[') && ends_value(before))
		return "is the next entry: write a comma before it";
	return NULL;
}

const char *config_mistake(const struct config_source *source, const json_error_t *error,
			   struct config_spot *spot)
{
	const char *mistake = wrong_encoding(source);
	enum json_error_code code = json_error_code(error);
	struct stop stop;

	*spot = (struct config_spot){.line = 1, .column = 1};
	if (mistake != NULL)
		return mistake;
	if (code != json_error_invalid_syntax && code != json_error_end_of_input_expected)
		return NULL;
	stop = stop_of(source, error);
	mistake = mistake_at(&stop, code == json_error_end_of_input_expected);
	*spot = spot_of(source->text, stop.at);
	return mistake;
}
