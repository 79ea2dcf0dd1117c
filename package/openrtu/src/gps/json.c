/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "gps/json.h"

#include <string.h>

#include "gps/number.h"

struct reader {
	const char *at, *end;
	gps_json_told *told;
	void *context;
};

struct name {
	const char *text;
	size_t size;
};

/* What is open: an object, or an array and its name. */
struct level {
	bool array;
	struct name name;
};

static bool take(struct reader *reader, char c)
{
	if (reader->at == reader->end || *reader->at != c)
		return false;
	reader->at++;
	return true;
}

static void skip_space(struct reader *reader)
{
	while (reader->at < reader->end && *reader->at != 0 && strchr(" \t\r\n", *reader->at) != NULL)
		reader->at++;
}

static bool digits(struct reader *reader)
{
	const char *begin = reader->at;

	while (reader->at < reader->end && *reader->at >= '0' && *reader->at <= '9')
		reader->at++;
	return reader->at > begin;
}

static bool hex_digits(struct reader *reader)
{
	for (int i = 0; i < 4; i++, reader->at++)
		if (reader->at == reader->end || *reader->at == 0 ||
		    strchr("0123456789abcdefABCDEF", *reader->at) == NULL)
			return false;
	return true;
}

/* Behind the opening quote. */
static bool string(struct reader *reader, struct name *out)
{
	out->text = reader->at;
	while (reader->at < reader->end) {
		char c = *reader->at++;

		if (c == '"') {
			out->size = (size_t)(reader->at - 1 - out->text);
			return true;
		}
		if ((unsigned char)c < ' ')
			return false;
		if (c != '\\')
			continue;
		if (take(reader, 'u')) {
			if (!hex_digits(reader))
				return false;
		} else if (reader->at == reader->end || *reader->at == 0 ||
			   strchr("\"\\/bfnrt", *reader->at++) == NULL) {
			return false;
		}
	}
	return false;
}

static bool number(struct reader *reader)
{
	take(reader, '-');
	if (!take(reader, '0') && !digits(reader))
		return false;
	if (take(reader, '.') && !digits(reader))
		return false;
	if (take(reader, 'e') || take(reader, 'E')) {
		if (!take(reader, '-'))
			take(reader, '+');
		return digits(reader);
	}
	return true;
}

static bool word(struct reader *reader)
{
	static const char *const words[] = {"true", "false", "null"};

	for (size_t i = 0; i < sizeof(words) / sizeof(words[0]); i++) {
		size_t size = strlen(words[i]);

		if ((size_t)(reader->end - reader->at) >= size && memcmp(reader->at, words[i], size) == 0) {
			reader->at += size;
			return true;
		}
	}
	return false;
}

static void tell(const struct reader *reader, enum gps_json_kind kind, unsigned depth, struct name name,
		 const char *text, size_t size)
{
	reader->told(reader->context, &(struct gps_json_item){kind, depth, name.text, name.size, text, size});
}

/* A string, number or word. */
static bool scalar(struct reader *reader, unsigned depth, struct name name)
{
	const char *begin = reader->at;
	enum gps_json_kind kind = GPS_JSON_WORD;
	struct name text;

	if (take(reader, '"')) {
		if (!string(reader, &text))
			return false;
		tell(reader, GPS_JSON_STRING, depth, name, text.text, text.size);
		return true;
	}
	if (*begin == '-' || (*begin >= '0' && *begin <= '9')) {
		kind = GPS_JSON_NUMBER;
		if (!number(reader))
			return false;
	} else if (!word(reader)) {
		return false;
	}
	tell(reader, kind, depth, name, begin, (size_t)(reader->at - begin));
	return true;
}

/* Closes what is closed here. False: what follows is neither an end nor a comma. */
static bool close_levels(struct reader *reader, const struct level *levels, unsigned *depth)
{
	while (*depth > 0) {
		skip_space(reader);
		if (take(reader, ','))
			return true;
		if (!take(reader, levels[*depth - 1].array ? ']' : '}'))
			return false;
		(*depth)--;
		if (!levels[*depth].array)
			tell(reader, GPS_JSON_END, *depth, levels[*depth].name, NULL, 0);
	}
	return true;
}

/* The name before a value of an object; that of the array in an array. */
static bool name_of_value(struct reader *reader, const struct level *level, struct name *out)
{
	*out = level->name;
	skip_space(reader);
	if (level->array)
		return true;
	if (!take(reader, '"') || !string(reader, out))
		return false;
	skip_space(reader);
	return take(reader, ':');
}

static bool open_level(struct reader *reader, struct level *levels, unsigned *depth, struct name name,
		       bool array)
{
	if (*depth == GPS_JSON_DEPTH)
		return false;
	if (!array)
		tell(reader, GPS_JSON_OBJECT, *depth, name, NULL, 0);
	levels[(*depth)++] = (struct level){array, name};
	return true;
}

static bool is_empty(struct reader *reader, bool array)
{
	skip_space(reader);
	return reader->at < reader->end && *reader->at == (array ? ']' : '}');
}

bool gps_json_read(const char *text, size_t size, gps_json_told *told, void *context)
{
	struct reader reader = {text, text + size, told, context};
	struct level levels[GPS_JSON_DEPTH];
	unsigned depth = 0;
	bool opened;

	skip_space(&reader);
	if (!take(&reader, '{') || !open_level(&reader, levels, &depth, (struct name){"", 0}, false))
		return false;
	opened = true;
	while (depth > 0) {
		struct name name;
		bool array;

		if (!opened || !is_empty(&reader, levels[depth - 1].array)) {
			if (!name_of_value(&reader, &levels[depth - 1], &name))
				return false;
			skip_space(&reader);
			array = reader.at < reader.end && *reader.at == '[';
			opened = array || (reader.at < reader.end && *reader.at == '{');
			if (reader.at == reader.end)
				return false;
			if (opened) {
				reader.at++;
				if (!open_level(&reader, levels, &depth, name, array))
					return false;
				continue;
			}
			if (!scalar(&reader, depth, name))
				return false;
		}
		opened = false;
		if (!close_levels(&reader, levels, &depth))
			return false;
	}
	skip_space(&reader);
	return reader.at == reader.end;
}

bool gps_json_is(const struct gps_json_item *item, const char *name)
{
	return item->name_size == strlen(name) && memcmp(item->name, name, item->name_size) == 0;
}

bool gps_json_number(const struct gps_json_item *item, unsigned decimals, int64_t *out)
{
	return item->kind == GPS_JSON_NUMBER && gps_decimal(item->text, item->size, decimals, out);
}
