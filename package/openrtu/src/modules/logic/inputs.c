/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The first scan waits for what it reads, so that what the program remembers does not depend on who started first. */
#include <inttypes.h>

#include "logic/config.h"
#include "map/time_ns.h"
#include "modules/logic/host.h"

#define LIMIT_NS (10 * NS_PER_S) /* a device that is dead holds a program up no longer */

static uint32_t owner_of(const struct map_config *config, uint32_t point)
{
	return config->sets[config->points[point].set].module;
}

static const struct logic_instance *instance_of(const struct map_config *config, uint32_t module)
{
	const struct logic_instance *instances = logic_instances(config);

	for (uint32_t i = 0; i < map_record_count(config, LOGIC_INSTANCES); i++)
		if (instances[i].module == module)
			return &instances[i];
	return NULL;
}

static uint32_t links_end(const struct map_config *config, const struct logic_instance *instance)
{
	const struct logic_instance *end =
	    logic_instances(config) + map_record_count(config, LOGIC_INSTANCES);

	return instance + 1 < end ? instance[1].first_link : map_record_count(config, LOGIC_LINKS);
}

/* The modules that a program reads, and those that these read, if they are programs. */
static map_modules sources_of(const struct map_config *config, uint32_t module)
{
	map_modules found = 0, open = map_module_bit(module);

	while (open != 0) {
		const uint32_t next = (uint32_t)__builtin_ctzll(open);
		const struct logic_instance *instance = instance_of(config, next);

		open &= open - 1;
		for (uint32_t i = instance == NULL ? 0 : instance->first_link;
		     instance != NULL && i < links_end(config, instance); i++) {
			const map_modules owner =
			    map_module_bit(owner_of(config, logic_links(config)[i].point));

			if (owner == map_module_bit(next) || (found & owner) != 0)
				continue;
			found |= owner;
			open |= owner;
		}
	}
	return found;
}

/* Programs that read each other do not wait for each other. */
void inputs_begin(struct host *host)
{
	const struct map_config *config = map_config(host->map);
	const map_modules self = map_module_bit(map_self(host->map));

	for (uint16_t i = 0; i < host->logic.head->points; i++) {
		struct host_point *point = &host->points[i];

		point->awaited = !point->own && !host->logic.points[i].written &&
				 (sources_of(config, owner_of(config, point->point)) & self) == 0;
	}
	host->inputs_until_ns = map_now_ns() + LIMIT_NS;
}

static void say_missing(const struct host *host, uint32_t point, uint32_t count)
{
	const struct map_config *config = map_config(host->map);
	char name[MAP_NAME_SIZE];

	map_point_name(config, &config->points[point], name);
	map_log(host->map, MAP_LOG_WARNING,
		"begins without %s, which has not been read for %" PRId64 " s; inputs that are missing: %u",
		name, (int64_t)(LIMIT_NS / NS_PER_S), count);
}

bool inputs_are_known(struct host *host, int64_t now_ns)
{
	uint32_t missing = 0, first = MAP_NONE;

	for (uint16_t i = 0; i < host->logic.head->points; i++) {
		struct host_point *point = &host->points[i];
		struct map_sample sample;

		if (!point->awaited)
			continue;
		point->awaited =
		    !map_read(host->map, point->point, &sample) || (sample.quality & MAP_INVALID) != 0;
		if (point->awaited && missing++ == 0)
			first = point->point;
	}
	if (missing != 0 && now_ns < host->inputs_until_ns)
		return false;
	if (missing != 0)
		say_missing(host, first, missing);
	return true;
}
