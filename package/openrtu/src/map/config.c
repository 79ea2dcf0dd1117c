/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/config.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Of map_label. */
#define LABEL_BIT (1u << 23)

void map_point_name(const struct map_config *config, const struct map_point *point, char out[MAP_NAME_SIZE])
{
	const struct map_set *set = &config->sets[point->set];
	const uint32_t label = point->name;

	if (!(label & MAP_LABEL))
		snprintf(out, MAP_NAME_SIZE, "%s", &config->names[point->name]);
	else if (label & LABEL_BIT)
		snprintf(out, MAP_NAME_SIZE, "%s.%c%u.%u", set->prefix, (int)(label >> 24 & 0x7f),
			 (unsigned)(label & UINT16_MAX), (unsigned)(label >> 16 & 0xf));
	else
		snprintf(out, MAP_NAME_SIZE, "%s.%c%u", set->prefix, (int)(label >> 24 & 0x7f),
			 (unsigned)(label & UINT16_MAX));
}

void map_add_section(struct map_config *config, uint32_t id, size_t record_size, uint32_t count,
		     void *records)
{
	if (config->section_count == MAP_SECTIONS_MAX)
		abort(); /* the rooms outgrew it */
	config->sections[config->section_count++] = (struct map_section){
	    .id = id, .record_size = (uint32_t)record_size, .count = count, .records = records};
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

uint32_t map_plan_module(struct map_config *config, const struct map_module_plan *module)
{
	for (uint32_t i = 0; i < config->module_count; i++)
		if (strcmp(config->modules[i].name, module->name) == 0) {
			if (config->modules[i].kind[0] == '\0')
				config->modules[i] = *module;
			return i;
		}
	if (config->module_count == MAP_MODULES_MAX)
		return UINT32_MAX;
	config->modules[config->module_count] = *module;
	return config->module_count++;
}
