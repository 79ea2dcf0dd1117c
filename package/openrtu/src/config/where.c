/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The line of a place in a file's text, which is looked for only when something is to be said of it. */
#include "config/keys.h"

#include <string.h>

/* In text that is JSON. */
struct cursor {
	const char *at, *end;
};

static char here(const struct cursor *cursor)
{
	return cursor->at < cursor->end ? *cursor->at : '\0';
}

static void skip_space(struct cursor *cursor)
{
	while (cursor->at < cursor->end && strchr(" \t\r\n", *cursor->at) != NULL && *cursor->at != '\0')
		cursor->at++;
}

static void skip_string(struct cursor *cursor)
{
	for (cursor->at++; cursor->at < cursor->end && *cursor->at != '"'; cursor->at++)
		if (*cursor->at == '\\')
			cursor->at++;
	cursor->at = cursor->at < cursor->end ? cursor->at + 1 : cursor->end;
}

static void skip_scalar(struct cursor *cursor)
{
	while (cursor->at < cursor->end && strchr(",]} \t\r\n", *cursor->at) == NULL)
		cursor->at++;
}

static void skip_value(struct cursor *cursor)
{
	unsigned depth = 0;

	do {
		char c = here(cursor);

		if (c == '"') {
			skip_string(cursor);
		} else if (c == '{' || c == '[') {
			depth++;
			cursor->at++;
		} else if (depth > 0) {
			depth -= c == '}' || c == ']';
			cursor->at++;
		} else {
			skip_scalar(cursor);
		}
	} while (depth > 0 && cursor->at < cursor->end);
}

/* Behind the comma. False: the object or array has ended. */
static bool next_member(struct cursor *cursor)
{
	skip_space(cursor);
	if (here(cursor) != ',')
		return false;
	cursor->at++;
	skip_space(cursor);
	return true;
}

/* Goes to the value of the key. *line_at: where the key is. */
static bool enter_key(struct cursor *cursor, const char *key, const char **line_at)
{
	size_t length = strlen(key);

	if (here(cursor) != '{')
		return false;
	cursor->at++;
	skip_space(cursor);
	do {
		const char *begin = cursor->at;
		bool found;

		if (here(cursor) != '"')
			return false;
		skip_string(cursor);
		found = (size_t)(cursor->at - begin) == length + 2 && memcmp(begin + 1, key, length) == 0;
		skip_space(cursor);
		if (here(cursor) != ':')
			return false;
		cursor->at++;
		skip_space(cursor);
		if (found) {
			*line_at = begin;
			return true;
		}
		skip_value(cursor);
	} while (next_member(cursor));
	return false;
}

static bool enter_element(struct cursor *cursor, size_t index, const char **line_at)
{
	if (here(cursor) != '[')
		return false;
	cursor->at++;
	skip_space(cursor);
	while (index-- > 0) {
		skip_value(cursor);
		if (!next_member(cursor))
			return false;
	}
	*line_at = cursor->at;
	return true;
}

/* As far as there is such a place: what is missing is missed where it should be. */
static bool enter(struct cursor *cursor, const struct config_place *place, const char **line_at)
{
	if (place->in == NULL) {
		skip_space(cursor);
		*line_at = cursor->at;
		return true;
	}
	if (!enter(cursor, place->in, line_at))
		return false;
	return place->key != NULL ? enter_key(cursor, place->key, line_at)
				  : enter_element(cursor, place->index, line_at);
}

unsigned config_line_of(const struct config_source *source, const struct config_place *place)
{
	struct cursor cursor = {source->text, source->text + source->length};
	const char *line_at = source->text;
	unsigned line = 1;

	enter(&cursor, place, &line_at);
	for (const char *c = source->text; c < line_at; c++)
		line += *c == '\n';
	return line;
}
