/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The gateway's own station: what rtu-iec104 says of its event queues (map/config.h). */
#include "iec104/config_readers.h"

#include <string.h>

#include "config/names.h"

#define GROUP_SIZE   8 /* digits of a group's number, or "others" */
#define OWN_CA_KEY   "own_ca"
#define IEC104_KEY   "iec104"
#define FIRST_LOSING 1   /* IOA of the first group's point */
#define FIRST_LOST   101 /* likewise; that of all others is behind that of the last group there can be */

static void add_point(struct map_config *config, uint32_t group, enum map_type type, const char *what,
		      uint32_t first_ioa)
{
	bool others = group == config->settings.queue_count;
	struct map_point *point = &config->points[config->point_count++];
	char number[GROUP_SIZE], name[MAP_NAME_SIZE];

	snprintf(number, sizeof(number), "%u", (unsigned)(group + 1) % 100u);
	*point = (struct map_point){
	    .set = (uint16_t)(config->set_count - 1),
	    .type = (uint8_t)type,
	    .ioa = first_ioa + (others ? MAP_NAMED_QUEUES_MAX : group),
	};
	snprintf(name, sizeof(name), "gateway.queue-%s.%s", others ? "others" : number, what);
	config_keep_name(config, point, name);
}

static void check_name(struct config_loader *loader, const struct config_place *here, const char *name)
{
	char other[MAP_NAME_SIZE];

	for (uint32_t i = 0; i + 1 < loader->config->set_count; i++) {
		const struct map_set *device = &loader->config->sets[i];

		for (uint32_t j = device->first_point; j < device->first_point + device->point_count; j++) {
			map_point_name(loader->config, &loader->config->points[j], other);
			if (strcmp(other, name) == 0)
				config_error(&loader->report, here,
					     "needs the name \"%s\", but another point has it", name);
		}
	}
}

static void check_address(struct config_loader *loader, const struct config_place *here, uint16_t ca)
{
	for (uint32_t i = 0; i + 1 < loader->config->set_count; i++)
		if (loader->config->sets[i].ca == ca)
			config_error(&loader->report, here, "%u is the common address of a device, \"%s\"",
				     ca, loader->config->sets[i].name);
}

void iec104_add_own_station(struct config_loader *loader)
{
	const struct config_place file = {.in = NULL};
	const struct config_place iec104 = config_key_of(&file, IEC104_KEY);
	const struct config_place here = config_key_of(&iec104, OWN_CA_KEY);
	struct map_config *config = loader->config;
	struct map_set *device = &config->sets[config->set_count];
	uint32_t queues = config->settings.queue_count + 1;
	char name[MAP_NAME_SIZE];

	if (iec104_settings(config)->own_ca == 0)
		return;
	config->set_count++;
	*device = (struct map_set){
	    .ca = iec104_settings(config)->own_ca,
	    .first_point = config->point_count,
	    .point_count = 2 * queues,
	    .name = "gateway",
	};
	for (uint32_t group = 0; group < queues; group++)
		add_point(config, group, MAP_SINGLE, "losing", FIRST_LOSING);
	for (uint32_t group = 0; group < queues; group++)
		add_point(config, group, MAP_BITSTRING, "lost", FIRST_LOST);
	check_address(loader, &here, device->ca);
	for (uint32_t i = 0; i < device->point_count; i++) {
		map_point_name(config, &config->points[device->first_point + i], name);
		check_name(loader, &here, name);
	}
}
