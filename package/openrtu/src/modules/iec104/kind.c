/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The controlled station: one module, in the map of every build and configuration. */
#include <string.h>
#include <sys/socket.h>

#include "iec104/config.h"
#include "iec104/config_part.h"
#include "iec104/counters.h"
#include "modules/kind.h"
#include "process/calls.h"

#define USER       1
#define OWN_EVENTS 256 /* of the gateway's own station, which has two for each episode of losses */

static const struct call_rule plain_calls[] = {
    CALL(epoll_wait), CALL(epoll_pwait), CALL(epoll_ctl), CALL(accept4),
    CALL(setsockopt), CALL(send),        CALL(sendto),    RENEWAL_CALLS,
};

static const struct call_rule tls_calls[] = {
    CALL(epoll_wait), CALL(epoll_pwait), CALL(epoll_ctl), CALL(accept4), CALL(setsockopt), TLS_CALLS,
};

static const struct kind_program programs[] = {
    {"rtu-iec104", plain_calls, sizeof(plain_calls) / sizeof(plain_calls[0])},
    {"rtu-iec104-tls", tls_calls, sizeof(tls_calls) / sizeof(tls_calls[0])},
};

static const struct kind_program *choose(const struct map_config *config)
{
	if (iec104_tls_used(iec104_settings(config)))
		return &programs[1]; /* without the program there is no tls: config_check_modules */
	return OPENRTU_IEC104 ? &programs[0] : NULL;
}

static bool plan(struct map_config *config)
{
	const struct iec104_settings *settings = iec104_settings(config);
	const bool owns = settings->own_ca != 0;
	const struct map_module_plan module = {
	    .name = "rtu-iec104",
	    .kind = IEC104_KIND,
	    .flags = MAP_MAY_OWN | MAP_MAY_REQUEST | MAP_HEARS_EVENTS | MAP_KEEPS_QUEUES,
	    .rings = {.requests = 256, .answers = 1, .events = owns ? OWN_EVENTS : 1, .log = 128},
	    .heartbeat_limit_ms = MAP_IDLE_HEARTBEAT_LIMIT_MS,
	    .section_size = sizeof(struct iec104_stats),
	    .counters = IEC104_COUNT_OF_COUNTERS,
	    .user = USER,
	};
	const uint32_t number = map_plan_module(config, &module);

	if (owns)
		config->sets[settings->own_set].module = (uint16_t)number;
	return number != MAP_NONE;
}

static bool same(const struct map_config *a, const struct map_config *b, uint32_t module, const char *name)
{
	struct iec104_settings of_a = *iec104_settings(a), of_b = *iec104_settings(b);

	(void)module, (void)name;
	of_a.own_set = of_b.own_set = 0;
	return memcmp(&of_a, &of_b, sizeof(of_a)) == 0;
}

/* What is looked at whenever it is needed. The listener, the memory for k, and TLS are what the process began with. */
static enum kind_change change(const struct map_config *before, const struct map_config *now)
{
	struct iec104_settings looked_at = *iec104_settings(now);
	const struct iec104_settings *was = iec104_settings(before);

	memcpy(looked_at.address, was->address, sizeof(looked_at.address));
	looked_at.port = was->port;
	looked_at.k = was->k;
	looked_at.max_connections = was->max_connections;
	looked_at.tls = was->tls;
	return memcmp(&looked_at, iec104_settings(now), sizeof(looked_at)) == 0 ? KIND_TAKES
										: KIND_STARTS_AGAIN;
}

static bool listens(const struct map_config *config, const char *module, struct kind_port *out)
{
	(void)module;
	*out =
	    (struct kind_port){SOCK_STREAM, iec104_settings(config)->address, iec104_settings(config)->port};
	return true;
}

const struct kind iec104_kind = {
    .name = IEC104_KIND,
    .part = &iec104_part,
    .plan = plan,
    .listens = listens,
    .programs = programs,
    .program_count = sizeof(programs) / sizeof(programs[0]),
    .choose = choose,
    .same = same,
    .change = change,
    .fixed = "iec104.own_ca",
    .fixed_because =
	"the process that has the masters' connections owns these points too, some for each redundancy group",
};
