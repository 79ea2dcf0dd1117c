/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The gateway's own station: what rtu-iec104 says of its event queues (map/config.h). */
#include "iec104/config_readers.h"

#include "config/sets.h"

#define GROUP_SIZE   8 /* digits of a group's number, or "others" */
#define OWN_CA_KEY   "own_ca"
#define IEC104_KEY   "iec104"
#define FIRST_LOSING 1   /* IOA of the first group's point */
#define FIRST_LOST   101 /* likewise; that of all others is behind that of the last group there can be */

static void add_point(struct config_loader *loader, const struct config_place *here, uint32_t group,
		      enum map_type type, const char *what, uint32_t first_ioa)
{
	bool others = group == loader->config->settings.queue_count;
	char number[GROUP_SIZE], name[MAP_NAME_SIZE];

	snprintf(number, sizeof(number), "%u", (unsigned)(group + 1) % 100u);
	snprintf(name, sizeof(name), "gateway.queue-%s.%s", others ? "others" : number, what);
	config_add_point(loader, here, name, type, first_ioa + (others ? MAP_NAMED_QUEUES_MAX : group));
}

void iec104_add_own_station(struct config_loader *loader)
{
	const struct config_place file = {.in = NULL};
	const struct config_place iec104 = config_key_of(&file, IEC104_KEY);
	const struct config_place here = config_key_of(&iec104, OWN_CA_KEY);
	struct iec104_settings *settings = iec104_settings(loader->config);
	uint32_t queues = loader->config->settings.queue_count + 1;

	if (settings->own_ca == 0)
		return;
	settings->own_set = (uint16_t)loader->config->set_count;
	config_add_set(loader, &here, settings->own_ca, "gateway");
	for (uint32_t group = 0; group < queues; group++)
		add_point(loader, &here, group, MAP_SINGLE, "losing", FIRST_LOSING);
	for (uint32_t group = 0; group < queues; group++)
		add_point(loader, &here, group, MAP_BITSTRING, "lost", FIRST_LOST);
}
