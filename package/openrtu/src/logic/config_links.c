/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Which points of the gateway the points of the programs are, and what does not go together. */
#include <string.h>

#include "logic/config_readers.h"
#include "logic/value.h"
#include "map/type.h"

/* ---- links ------------------------------------------------------------------------------- */

static const char *name_of(const struct logic_reading *reading, const struct logic_point *point)
{
	const char *name = logic_name(&reading->logic, point->name);
	const char *other = json_string_value(json_object_get(reading->names, name));

	return other != NULL ? other : name;
}

static bool is_commanded(const struct logic *logic, const char *name)
{
	for (uint16_t i = 0; i < logic->head->commands; i++)
		if (strcmp(logic_name(logic, logic->commands[i].name), name) == 0)
			return true;
	return false;
}

static void check_foreign(struct config_loader *loader, const struct logic_reading *reading,
			  const struct logic_point *point, const struct map_point *is)
{
	const char *name = logic_name(&reading->logic, point->name);
	struct logic_place place;
	const struct config_place *here = logic_place_key(&place, reading, "program");

	if (point->written)
		config_error(&loader->report, here,
			     "writes %s, which is not among its points; a COMMAND can ask its device", name);
	else if (logic_decides(&reading->logic, name))
		config_error(&loader->report, here, "has a REQUEST for %s, which is not among its points",
			     name);
	else if (is->flags & MAP_POINT_TEXT)
		config_error(&loader->report, here,
			     "declares %s, which is a text: no point of a program is a STRING", name);
	else if (!logic_value_fits((enum map_type)is->type, point->type, false))
		config_error(&loader->report, here, "declares %s with a type that no %s point fits", name,
			     map_types[is->type].name);
	else if (is_commanded(&reading->logic, name) && !(is->flags & MAP_POINT_COMMAND))
		config_error(&loader->report, here, "commands %s, which takes no commands", name);
}

static void check_own(struct config_loader *loader, const struct logic_reading *reading,
		      const struct logic_point *point)
{
	const char *name = logic_name(&reading->logic, point->name);
	struct logic_place place;

	if (is_commanded(&reading->logic, name))
		config_error(&loader->report, logic_place_key(&place, reading, "program"),
			     "commands %s, a point of its own", name);
}

static void link_point(struct config_loader *loader, const struct logic_reading *reading,
		       const struct logic_point *point, struct logic_link *out)
{
	const struct map_config *config = loader->config;
	const struct map_set *set = &config->sets[reading->instance->set];
	const char *name = name_of(reading, point);
	struct logic_place place;

	out->point = config_index_name(&loader->index, config, name);
	if (out->point == MAP_NONE) {
		config_error(&loader->report, logic_place_key(&place, reading, "program"),
			     "names the point \"%s\", which there is not: \"points\" has its own, \"names\" "
			     "what others are called",
			     name);
	} else if (config->points[out->point].set != reading->instance->set) {
		check_foreign(loader, reading, point, &config->points[out->point]);
	} else {
		const struct logic_own_point *own = &reading->points[out->point - set->first_point];

		check_own(loader, reading, point);
		out->initial = own->initial;
		out->has_initial = own->has_initial;
	}
}

static uint32_t count_links(const struct logic_readings *readings)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < readings->count; i++)
		count += readings->readings[i].logic.head->points;
	return count;
}

static void link_all(struct config_loader *loader, struct logic_readings *readings, struct logic_link *links)
{
	uint32_t next = 0;

	for (uint32_t i = 0; i < readings->count; i++) {
		struct logic_reading *reading = &readings->readings[i];

		reading->instance->first_link = next;
		for (uint16_t j = 0; j < reading->logic.head->points; j++)
			link_point(loader, reading, &reading->logic.points[j], &links[next++]);
	}
}

bool logic_link(struct config_loader *loader, struct logic_readings *readings)
{
	uint32_t count = count_links(readings);
	struct logic_link *links = config_allocate(count, sizeof(*links));
	const bool ready = config_index_renew(&loader->index, loader->config);

	map_add_section(loader->config, LOGIC_LINKS, sizeof(*links), count, links);
	if (links != NULL && ready)
		link_all(loader, readings, links);
	return links != NULL && ready;
}
