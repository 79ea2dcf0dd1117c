/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Receivers of positions: one module for all, if the configuration has "gps". */
#include <string.h>

#include "gps/config.h"
#include "gps/config_part.h"
#include "gps/stats.h"
#include "modules/kind.h"
#include "process/calls.h"

#define USER               15   /* docs/architecture.md: from 15 down */
#define HEARTBEAT_LIMIT_MS 1000 /* a receiver speaks once a second */

static const struct call_rule calls[] = {
    CALL(poll), CALL(ppoll_time64), CALL(ppoll), CALL(sendto), SERIAL_PORT_CALLS, TCP_CONNECTION_CALLS,
};

static const struct kind_program program = {
    .name = "rtu-gps",
    .calls = calls,
    .call_count = sizeof(calls) / sizeof(calls[0]),
};

static bool plan(struct map_config *config)
{
	const uint32_t count = map_record_count(config, GPS_RECEIVERS);
	const struct map_module_plan module = {
	    .name = "rtu-gps",
	    .kind = GPS_KIND,
	    .flags = MAP_MAY_OWN,
	    .rings = {.requests = 1, .answers = 256, .events = config->settings.event_ring, .log = 128},
	    .heartbeat_limit_ms = HEARTBEAT_LIMIT_MS,
	    .section_size = (uint32_t)(count * sizeof(struct gps_stats)),
	    .user = USER,
	};
	uint32_t number;

	if (count == 0)
		return true;
	number = map_plan_module(config, &module);
	for (uint32_t i = 0; i < count; i++)
		config->sets[gps_receivers(config)[i].set].module = (uint16_t)number;
	return number != MAP_NONE;
}

/* What is not known of a fence's or a receiver's octets is no reason to keep the process. */
static bool same(const struct map_config *a, const struct map_config *b, uint32_t module, const char *name)
{
	const uint32_t count = map_record_count(a, GPS_RECEIVERS), fences = map_record_count(a, GPS_FENCES);

	(void)module, (void)name;
	if (count != map_record_count(b, GPS_RECEIVERS) || fences != map_record_count(b, GPS_FENCES))
		return false;
	for (uint32_t i = 0; i < count; i++) {
		struct gps_settings of_a = gps_receivers(a)[i], of_b = gps_receivers(b)[i];

		of_a.set = of_b.set = 0;
		if (memcmp(&of_a, &of_b, sizeof(of_a)) != 0)
			return false;
	}
	return fences == 0 || memcmp(gps_fences(a), gps_fences(b), fences * sizeof(struct gps_fence)) == 0;
}

const struct kind gps_kind = {
    .name = GPS_KIND,
    .part = &gps_part,
    .plan = plan,
    .same = same,
    .programs = &program,
    .program_count = 1,
    .group = "dialout", /* to which Debian and Buildroot give serial devices */
};
