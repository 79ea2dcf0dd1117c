/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Other stations of IEC 60870-5-104 as a southbound: one module for all, if the configuration has "outstations". */
#include <string.h>

#include "iec104/config_outstations.h"
#include "iec104/outstation_stats.h"
#include "iec104/outstations.h"
#include "modules/kind.h"
#include "process/calls.h"

#define USER                   14   /* docs/architecture.md: from 15 down */
#define HEARTBEAT_LIMIT_MS     1000 /* a station that is lost is noticed after seconds */
#define TLS_HEARTBEAT_LIMIT_MS 5000 /* a signature takes the board's processor a while */

static const struct call_rule calls[] = {
    CALL(poll),   CALL(ppoll_time64),   CALL(ppoll),   CALL(send),
    CALL(sendto), TCP_CONNECTION_CALLS, RENEWAL_CALLS,
};

static const struct call_rule tls_calls[] = {
    CALL(poll), CALL(ppoll_time64), CALL(ppoll), CALL(send), CALL(sendto), TCP_CONNECTION_CALLS, TLS_CALLS,
};

static const struct kind_program programs[] = {
    {"rtu-104m", calls, sizeof(calls) / sizeof(calls[0])},
    {"rtu-104m-tls", tls_calls, sizeof(tls_calls) / sizeof(tls_calls[0])},
};

static const struct kind_program *choose(const struct map_config *config)
{
	return &programs[iec104_outstation_tls(config) != NULL];
}

static bool plan(struct map_config *config)
{
	const uint32_t count = map_record_count(config, IEC104_OUTSTATIONS);
	const struct iec104_outstation_set *sets = iec104_outstation_sets(config);
	const struct map_module_plan module = {
	    .name = "rtu-104m",
	    .kind = IEC104_OUTSTATIONS_KIND,
	    .flags = MAP_MAY_OWN,
	    .rings = {.requests = 1, .answers = 256, .events = config->settings.event_ring, .log = 128},
	    .heartbeat_limit_ms =
		iec104_outstation_tls(config) != NULL ? TLS_HEARTBEAT_LIMIT_MS : HEARTBEAT_LIMIT_MS,
	    .section_size = (uint32_t)(count * sizeof(struct iec104_outstation_stats)),
	    .counters = (uint32_t)(count * IEC104_OUTSTATION_COUNTERS),
	    .user = USER,
	};
	uint32_t number;

	if (count == 0)
		return true;
	number = map_plan_module(config, &module);
	for (uint32_t i = 0; i < map_record_count(config, IEC104_OUTSTATION_SETS); i++)
		config->sets[sets[i].set].module = (uint16_t)number;
	return number != MAP_NONE;
}

static bool same_sets(const struct map_config *a, const struct map_config *b)
{
	const struct iec104_outstation_set *in_a = iec104_outstation_sets(a),
					   *in_b = iec104_outstation_sets(b);

	for (uint32_t i = 0; i < map_record_count(a, IEC104_OUTSTATION_SETS); i++)
		if (in_a[i].ca != in_b[i].ca || in_a[i].first_point != in_b[i].first_point)
			return false;
	return true;
}

static bool same_points(const struct map_config *a, const struct map_config *b)
{
	const struct iec104_outstation_point *in_a = iec104_outstation_points(a);
	const struct iec104_outstation_point *in_b = iec104_outstation_points(b);

	for (uint32_t i = 0; i < map_record_count(a, IEC104_OUTSTATION_POINTS); i++)
		if (in_a[i].ioa != in_b[i].ioa || in_a[i].command_ioa != in_b[i].command_ioa ||
		    in_a[i].read_ms != in_b[i].read_ms || in_a[i].select != in_b[i].select)
			return false;
	return true;
}

static bool same_count(const struct map_config *a, const struct map_config *b, uint32_t section)
{
	return map_record_count(a, section) == map_record_count(b, section);
}

static bool same_tls(const struct map_config *a, const struct map_config *b)
{
	const struct channel_tls *in_a = iec104_outstation_tls(a), *in_b = iec104_outstation_tls(b);

	return in_a == NULL || in_b == NULL ? in_a == in_b : memcmp(in_a, in_b, sizeof(*in_a)) == 0;
}

static bool same(const struct map_config *a, const struct map_config *b, uint32_t module, const char *name)
{
	const uint32_t count = map_record_count(a, IEC104_OUTSTATIONS);

	(void)module, (void)name;
	return same_tls(a, b) && same_count(a, b, IEC104_OUTSTATIONS) &&
	       same_count(a, b, IEC104_OUTSTATION_SETS) && same_count(a, b, IEC104_OUTSTATION_POINTS) &&
	       same_sets(a, b) && same_points(a, b) &&
	       memcmp(map_records(a, IEC104_OUTSTATIONS, sizeof(struct iec104_outstation)),
		      map_records(b, IEC104_OUTSTATIONS, sizeof(struct iec104_outstation)),
		      count * sizeof(struct iec104_outstation)) == 0;
}

const struct kind iec104m_kind = {
    .name = IEC104_OUTSTATIONS_KIND,
    .part = &iec104_outstations_part,
    .plan = plan,
    .same = same,
    .programs = programs,
    .program_count = sizeof(programs) / sizeof(programs[0]),
    .choose = choose,
};
