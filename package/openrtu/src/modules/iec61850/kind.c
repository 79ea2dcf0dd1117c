/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The server of IEC 61850: one module, if the configuration has "iec61850". */
#include <string.h>
#include <sys/socket.h>

#include "iec61850/config.h"
#include "iec61850/config_part.h"
#include "iec61850/kept.h"
#include "map/limits.h"
#include "modules/iec61850/cid.h"
#include "modules/kind.h"
#include "process/calls.h"

#define USER     17 /* behind rtu-snmp, before those of others */
#define REQUESTS 256

#define SERVER_CALLS CALL(poll), CALL(ppoll_time64), CALL(ppoll), CALL(accept4), CALL(setsockopt)

static const struct call_rule plain_calls[] = {SERVER_CALLS, CALL(send), CALL(sendto)};
static const struct call_rule tls_calls[] = {SERVER_CALLS, TLS_CALLS};

static const struct kind_program programs[] = {
    {"rtu-iec61850", plain_calls, sizeof(plain_calls) / sizeof(plain_calls[0])},
    {"rtu-iec61850-tls", tls_calls, sizeof(tls_calls) / sizeof(tls_calls[0])},
};

/* Without the program there is no iec61850.tls: config_check_modules. */
static const struct kind_program *choose(const struct map_config *config)
{
	const struct iec61850_settings *settings = iec61850_settings(config);

	return &programs[settings != NULL && channel_tls_used(&settings->tls)];
}

static bool plan(struct map_config *config)
{
	const struct iec61850_settings *settings = iec61850_settings(config);
	const bool commands = settings != NULL && settings->controller_count > 0;
	const struct map_module_plan module = {
	    .name = "rtu-iec61850",
	    .kind = IEC61850_KIND,
	    .flags = MAP_HEARS_EVENTS | (commands ? MAP_MAY_REQUEST : 0u),
	    .rings = {.requests = commands ? REQUESTS : 1, .answers = 1, .events = 1, .log = 128},
	    .heartbeat_limit_ms = MAP_IDLE_HEARTBEAT_LIMIT_MS,
	    .section_size = settings == NULL ? 0 : (uint32_t)iec61850_section_size(config),
	    .history = {.at = IEC61850_HISTORY_AT,
			.readers = IEC61850_KEPT_ALL,
			.entries = settings == NULL ? 0 : settings->report_buffer},
	    .counters = IEC61850_COUNT_OF_COUNTERS,
	    .user = USER,
	};

	return settings == NULL || map_plan_module(config, &module) != MAP_NONE;
}

/* Port 102 is root's. */
static int open_socket(const struct map_config *config, const char *module)
{
	const struct iec61850_settings *settings = iec61850_settings(config);

	(void)module;
	return kind_open_port(settings->address, settings->port, SOCK_STREAM);
}

static bool same_records(const struct map_config *a, const struct map_config *b, uint32_t id, size_t size)
{
	const uint32_t count = map_record_count(b, id);

	return map_record_count(a, id) == count &&
	       (count == 0 || memcmp(map_records(a, id, size), map_records(b, id, size), count * size) == 0);
}

/* Points that are as many have the same numbers, or the module starts again for their sake. */
static bool same_units(const struct map_config *a, const struct map_config *b)
{
	for (uint32_t i = 0; i < a->point_count && i < b->point_count; i++)
		if (strcmp(map_unit_of(a, &a->points[i]), map_unit_of(b, &b->points[i])) != 0)
			return false;
	return true;
}

static bool same(const struct map_config *a, const struct map_config *b, uint32_t module, const char *name)
{
	(void)module, (void)name;
	return memcmp(iec61850_settings(a), iec61850_settings(b), sizeof(struct iec61850_settings)) == 0 &&
	       same_units(a, b) &&
	       same_records(a, b, IEC61850_ASSIGNMENTS, sizeof(struct iec61850_assignment)) &&
	       same_records(a, b, MAP_LIMITS, sizeof(struct map_limits)) &&
	       same_records(a, b, IEC61850_DATA_SETS, sizeof(struct iec61850_data_set)) &&
	       same_records(a, b, IEC61850_MEMBERS, sizeof(struct iec61850_chosen)) &&
	       same_records(a, b, IEC61850_REPORTS, sizeof(struct iec61850_report));
}

static bool listens(const struct map_config *config, const char *module, struct kind_port *out)
{
	(void)module;
	*out = (struct kind_port){SOCK_STREAM, iec61850_settings(config)->address,
				  iec61850_settings(config)->port};
	return true;
}

const struct kind iec61850_kind = {
    .name = IEC61850_KIND,
    .part = &iec61850_part,
    .plan = plan,
    .listens = listens,
    .programs = programs,
    .program_count = sizeof(programs) / sizeof(programs[0]),
    .choose = choose,
    .open = open_socket,
#if OPENRTU_IEC61850
    .describe = cid_file,
#endif
    .same = same,
    .change = kind_starts_again, /* its clients browse anew */
    .by_numbers = true, /* clients have browsed the points, and have to do so anew when they are others */
};
