/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/text.h"

#include <string.h>

#include "map/hash.h"
#include "map/layout.h"

#define CONTINUES(octet) (((octet)&0xC0u) == 0x80u)
#define DELETE           0x7F
#define C1_FIRST         0x80 /* these are control characters, too */
#define C1_LAST          0x9F
#define SURROGATE_FIRST  0xD800
#define SURROGATE_LAST   0xDFFF

static struct text_cell *cell_of(const struct map *map, uint32_t point)
{
	return &map->segments[map_owner(map, point)].texts[map->config.points[point].extra];
}

static uint32_t hash_of(const char text[MAP_TEXT_SIZE])
{
	return map_hash_octets(MAP_HASH_BASIS, text, strnlen(text, MAP_TEXT_SIZE));
}

union map_value map_text_put(struct map *map, uint32_t point, const char *text)
{
	struct text_cell *cell = cell_of(map, point);
	const union map_value value = {.u = hash_of(text)};
	const uint32_t published = map_own_sample(map, point).value.u;

	if (hash_of(cell->texts[0]) == value.u || hash_of(cell->texts[1]) == value.u)
		return value;
	strncpy(cell->texts[hash_of(cell->texts[0]) == published ? 1 : 0], text, MAP_TEXT_SIZE - 1);
	return value;
}

/* A character of UTF-8 that begins there: its octets. 0: it is none, or a control character. */
static size_t character(const uint8_t *text)
{
	if (text[0] < C1_FIRST)
		return text[0] >= ' ' && text[0] != DELETE ? 1 : 0;
	if (text[0] >= 0xC2 && text[0] <= 0xDF && CONTINUES(text[1]))
		return text[0] == 0xC2 && text[1] <= C1_LAST ? 0 : 2;
	if ((text[0] & 0xF0) == 0xE0 && CONTINUES(text[1]) && CONTINUES(text[2])) {
		const unsigned code = (text[0] & 0xFu) << 12 | (text[1] & 0x3Fu) << 6 | (text[2] & 0x3Fu);

		return code < 0x800 || (code >= SURROGATE_FIRST && code <= SURROGATE_LAST) ? 0 : 3;
	}
	return 0;
}

/* Of an owner gone wild it need not be. */
static bool is_sound(const char text[MAP_TEXT_SIZE])
{
	const uint8_t *octets = (const uint8_t *)text;
	size_t length = 1;

	for (size_t at = 0; octets[at] != '\0'; at += length) {
		length = character(octets + at);
		if (length == 0)
			return false;
	}
	return true;
}

/* Whatever its owner writes meanwhile: a text that is not whole has another hash. */
bool map_text_of(const struct map *map, uint32_t point, union map_value value, char out[MAP_TEXT_SIZE])
{
	const struct text_cell *cell = cell_of(map, point);

	for (unsigned i = 0; i < 2; i++) {
		memcpy(out, cell->texts[i], MAP_TEXT_SIZE - 1);
		out[MAP_TEXT_SIZE - 1] = '\0';
		if (hash_of(out) == value.u && is_sound(out))
			return true;
	}
	out[0] = '\0';
	return false;
}
