/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/meaning.h"

#include <string.h>

#include "map/type.h"

static enum map_type type_of(const struct map_config *config, uint32_t point)
{
	return (enum map_type)config->points[point].type;
}

uint32_t map_meanings_of(const struct map_config *config, uint32_t point, const struct map_meaning **first)
{
	uint32_t count;

	*first = map_records_of(config, MAP_MEANINGS, sizeof(**first), point, &count);
	return count;
}

const char *map_meaning(const struct map_config *config, uint32_t point, union map_value value)
{
	const struct map_meaning *meanings;
	const uint32_t count = map_meanings_of(config, point, &meanings);
	const double number = map_number(type_of(config, point), value);

	for (uint32_t i = 0; i < count; i++)
		if (number >= meanings[i].number && number <= meanings[i].number)
			return meanings[i].text;
	return "";
}

bool map_meaning_value(const struct map_config *config, uint32_t point, const char *text,
		       union map_value *out)
{
	const struct map_meaning *meanings;
	const uint32_t count = map_meanings_of(config, point, &meanings);

	for (uint32_t i = 0; i < count; i++)
		if (strcmp(meanings[i].text, text) == 0)
			return map_value_of(type_of(config, point), meanings[i].number, out);
	return false;
}

bool map_meaning_allows(const struct map_config *config, uint32_t point, union map_value value)
{
	const struct map_meaning *meanings;

	return map_meanings_of(config, point, &meanings) == 0 || map_meaning(config, point, value)[0] != '\0';
}
