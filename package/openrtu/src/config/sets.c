/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "config/sets.h"

#include <string.h>

#include "config/names.h"

struct map_set *config_add_set(struct config_loader *loader, const struct config_place *place, uint16_t ca,
			       const char *name)
{
	struct map_config *config = loader->config;
	struct map_set *set = &config->sets[config->set_count];

	for (uint32_t i = 0; i < config->set_count; i++)
		if (config->sets[i].ca == ca)
			config_error(&loader->report, place, "%u is the common address of \"%s\"", ca,
				     config->sets[i].name);
	*set = (struct map_set){.ca = ca, .first_point = config->point_count};
	snprintf(set->name, sizeof(set->name), "%s", name);
	config->set_count++;
	return set;
}

/* What the points before it have. Without memory for that, nothing is found, and the file is not good. */
static void check_point(struct config_loader *loader, const struct config_place *place, const char *name,
			uint32_t ioa)
{
	const struct map_config *config = loader->config;

	if (!config_index_renew(&loader->index, config))
		config_out_of_memory(&loader->report);
	if (config_index_name(&loader->index, config, name) != UINT32_MAX)
		config_error(&loader->report, place, "needs the name \"%s\", but another point has it", name);
	if (config_index_ioa(&loader->index, config, config->set_count - 1, ioa) != UINT32_MAX)
		config_error(&loader->report, place,
			     "%u is the information object address of another of its points", ioa);
}

struct map_point *config_add_point(struct config_loader *loader, const struct config_place *place,
				   const char *name, enum map_type type, uint32_t ioa)
{
	struct map_config *config = loader->config;
	struct map_set *set = &config->sets[config->set_count - 1];
	struct map_point *point = &config->points[config->point_count];

	check_point(loader, place, name, ioa);
	*point =
	    (struct map_point){.set = (uint16_t)(config->set_count - 1), .type = (uint8_t)type, .ioa = ioa};
	config_keep_name(config, point, name);
	config->point_count++;
	set->point_count++;
	return point;
}
