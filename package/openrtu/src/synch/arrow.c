/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "synch/arrow.h"

#include <ctype.h>
#include <string.h>

static bool is_of_name(char c)
{
	return isalnum((unsigned char)c) || c == '-' || c == '_' || c == '.';
}

bool synch_is_name(const char *text)
{
	size_t length = 0;

	while (is_of_name(text[length]))
		length++;
	return length > 0 && length < MAP_NAME_SIZE && text[length] == '\0';
}

static const char *skip_spaces(const char *text)
{
	return text + strspn(text, " ");
}

/* A word up to the next space. NULL: it is no name. */
static const char *take_name(const char *text, char out[MAP_NAME_SIZE])
{
	const size_t length = strcspn(text, " ");

	if (length >= MAP_NAME_SIZE)
		return NULL;
	memcpy(out, text, length);
	out[length] = '\0';
	return synch_is_name(out) ? text + length : NULL;
}

static const char *take_weight(const char *text, uint8_t *out)
{
	unsigned weight = 0;
	const char *digit = text;

	for (; isdigit((unsigned char)*digit) && weight <= SYNCH_WEIGHT_MAX; digit++)
		weight = 10 * weight + (unsigned)(*digit - '0');
	*out = (uint8_t)weight;
	return digit > text && weight <= SYNCH_WEIGHT_MAX ? digit : NULL;
}

/* "->" or "-(2)->" */
static const char *take_shaft(const char *text, uint8_t *weight)
{
	static const char open[] = "-(", close[] = ")->", plain[] = "->";

	*weight = 1;
	if (strncmp(text, plain, strlen(plain)) == 0)
		return text + strlen(plain);
	if (strncmp(text, open, strlen(open)) != 0)
		return NULL;
	text = take_weight(text + strlen(open), weight);
	if (text == NULL || strncmp(text, close, strlen(close)) != 0)
		return NULL;
	return text + strlen(close);
}

bool synch_read_arrow(const char *text, struct synch_arrow *out)
{
	text = take_name(skip_spaces(text), out->from);
	if (text == NULL || *text != ' ')
		return false;
	text = take_shaft(skip_spaces(text), &out->weight);
	if (text == NULL || *text != ' ')
		return false;
	text = take_name(skip_spaces(text), out->to);
	return text != NULL && *skip_spaces(text) == '\0';
}
