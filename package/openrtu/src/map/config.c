/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/config.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BITS_SIZE sizeof(".255-255")

/* Of map_label: ".7", ".8-15", or nothing. */
static void bits_of_label(uint32_t label, char out[BITS_SIZE])
{
	const uint8_t first = label >> 16 & 0xf, bits = label >> 20 & 0xf;

	out[0] = '\0';
	if (bits == 1)
		snprintf(out, BITS_SIZE, ".%hhu", first);
	else if (bits > 1)
		snprintf(out, BITS_SIZE, ".%hhu-%hhu", first, (uint8_t)(first + bits - 1));
}

void map_point_name(const struct map_config *config, const struct map_point *point, char out[MAP_NAME_SIZE])
{
	const struct map_set *set = &config->sets[point->set];
	const uint32_t label = point->name;
	char bits[BITS_SIZE];

	if (!(label & MAP_LABEL)) {
		snprintf(out, MAP_NAME_SIZE, "%s", &config->names[point->name]);
		return;
	}
	bits_of_label(label, bits);
	snprintf(out, MAP_NAME_SIZE, "%s.%c%u%s", set->prefix, (int)(label >> 24 & 0x7f),
		 (unsigned)(label & UINT16_MAX), bits);
}

void map_add_section(struct map_config *config, uint32_t id, size_t record_size, uint32_t count,
		     void *records)
{
	if (config->section_count == MAP_SECTIONS_MAX)
		abort(); /* the rooms outgrew it */
	config->sections[config->section_count++] = (struct map_section){
	    .id = id, .record_size = (uint32_t)record_size, .count = count, .records = records};
}

static uint32_t point_of(const uint8_t *record)
{
	uint32_t point;

	memcpy(&point, record, sizeof(point));
	return point;
}

const void *map_records_of(const struct map_config *config, uint32_t id, size_t record_size, uint32_t point,
			   uint32_t *count)
{
	const uint8_t *records = map_records(config, id, record_size);
	const uint32_t all = records == NULL ? 0 : map_record_count(config, id);
	uint32_t low = 0, high = all;

	while (low < high) {
		const uint32_t middle = low + (high - low) / 2;

		if (point_of(records + middle * record_size) < point)
			low = middle + 1;
		else
			high = middle;
	}
	for (*count = 0; low + *count < all; ++*count)
		if (point_of(records + (low + *count) * record_size) != point)
			break;
	return *count == 0 ? NULL : records + low * record_size;
}

static struct map_section *find_section(struct map_config *config, uint32_t id)
{
	struct map_section *section = config->sections;

	while (section->id != id)
		section++;
	return section;
}

void *map_next_record(struct map_config *config, uint32_t id)
{
	struct map_section *section = find_section(config, id);

	return (uint8_t *)section->records + (size_t)section->count++ * section->record_size;
}

void map_move_section(struct map_config *config, uint32_t id, void *records)
{
	find_section(config, id)->records = records;
}

/* Of so many modules that are gone and were not planned again, the one that is so longest; MAP_MODULES_MAX: there is none. */
static uint32_t longest_gone(const struct map_config *config, uint32_t *count)
{
	uint32_t longest = MAP_MODULES_MAX;

	*count = 0;
	for (uint32_t i = 0; i < config->module_count; i++) {
		const struct map_module_plan *plan = &config->modules[i];

		if (plan->kind[0] != '\0' || !(plan->flags & MAP_IS_GONE))
			continue;
		++*count;
		if (longest == MAP_MODULES_MAX || plan->gone < config->modules[longest].gone)
			longest = i;
	}
	return longest;
}

/* UINT32_MAX: there is none. */
static uint32_t free_number(struct map_config *config)
{
	uint32_t gone;
	const uint32_t longest = longest_gone(config, &gone);

	if (gone >= MAP_GONE_MAX || (gone > 0 && config->module_count == MAP_MODULES_MAX))
		return longest;
	return config->module_count == MAP_MODULES_MAX ? UINT32_MAX : config->module_count++;
}

uint32_t map_plan_module(struct map_config *config, const struct map_module_plan *module)
{
	uint32_t number;

	for (uint32_t i = 0; i < config->module_count; i++)
		if (strcmp(config->modules[i].name, module->name) == 0) {
			if (config->modules[i].kind[0] == '\0')
				config->modules[i] = *module;
			return i;
		}
	number = free_number(config);
	if (number != UINT32_MAX)
		config->modules[number] = *module;
	return number;
}
