/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The station and its parts: rtuStation, rtuHealth, and what each agent has (RFC 3418, RFC 3411). */
#include "snmp/agent.h"

#include <string.h>

#define SCALAR(group, number, reader)                                                                        \
	{                                                                                                    \
		.prefix = {1, group, number}, .prefix_length = 3, .read = reader                             \
	}

static void index_from_1(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	(void)agent;
	out[0] = row + 1;
}

/* ---- system (RFC 3418) ------------------------------------------------------------------ */

static bool read_description(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)agent, (void)column, (void)row;
	snmp_put_text(out, "OpenRTU " OPENRTU_VERSION);
	return true;
}

static void put_object_id(struct snmp_value *out, const uint32_t *ids, uint32_t length)
{
	out->syntax = SNMP_OID;
	out->size = (uint16_t)length;
	memcpy(out->ids, ids, length * sizeof(uint32_t));
}

/* sysObjectID: where OPENRTU-MIB is, since no product has a name of its own. */
static bool read_object_id(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)column, (void)row;
	put_object_id(out, agent->settings->base, agent->settings->base_length);
	return true;
}

static bool read_uptime(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)column, (void)row;
	snmp_put_number(out, SNMP_TICKS, (uint32_t)((agent->now_ns - agent->started_ns) / (10 * NS_PER_MS)));
	return true;
}

static bool read_name(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)column, (void)row;
	snmp_put_text(out, agent->settings->station);
	return true;
}

static bool read_contact(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)column, (void)row;
	snmp_put_text(out, agent->settings->contact);
	return true;
}

static bool read_location(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)column, (void)row;
	snmp_put_text(out, agent->settings->location);
	return true;
}

/* Transport and applications: layers 4 and 7. */
static bool read_services(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)agent, (void)column, (void)row;
	snmp_put_number(out, SNMP_INTEGER, 1 << (4 - 1) | 1 << (7 - 1));
	return true;
}

#define SYSTEM(number, reader)                                                                               \
	{                                                                                                    \
		.prefix = {number}, .prefix_length = 1, .read = reader                                       \
	}
const struct snmp_table snmp_system_scalars[7] = {
    SYSTEM(1, read_description), SYSTEM(2, read_object_id), SYSTEM(3, read_uptime),  SYSTEM(4, read_contact),
    SYSTEM(5, read_name),        SYSTEM(6, read_location),  SYSTEM(7, read_services)};

/* ---- sysORTable: of which modules of the MIB there are objects ------------------------------- */

struct resource {
	uint32_t ids[8];
	uint8_t length;
	const char *text;
};

#define RESOURCE(words, ...)                                                                                 \
	{                                                                                                    \
		.ids = {__VA_ARGS__}, .length = sizeof((uint32_t[]){__VA_ARGS__}) / sizeof(uint32_t),        \
		.text = words                                                                                \
	}
static const struct resource resources[] = {
    RESOURCE("SNMPv2-MIB (RFC 3418)", 1, 3, 6, 1, 6, 3, 1),
    RESOURCE("IF-MIB (RFC 2863)", 1, 3, 6, 1, 2, 1, 31),
    RESOURCE("HOST-RESOURCES-MIB (RFC 2790)", 1, 3, 6, 1, 2, 1, 25),
    RESOURCE("SNMP-FRAMEWORK-MIB (RFC 3411)", 1, 3, 6, 1, 6, 3, 10),
    RESOURCE("SNMP-MPD-MIB (RFC 3412)", 1, 3, 6, 1, 6, 3, 11),
    RESOURCE("SNMP-TARGET-MIB (RFC 3413)", 1, 3, 6, 1, 6, 3, 12),
    RESOURCE("SNMP-USER-BASED-SM-MIB (RFC 3414)", 1, 3, 6, 1, 6, 3, 15),
};
#define RESOURCES (sizeof(resources) / sizeof(resources[0]))

/* All are there from the start on: sysORLastChange and sysORUpTime are 0. */
static bool read_resources_changed(struct snmp_agent *agent, uint32_t column, uint32_t row,
				   struct snmp_value *out)
{
	(void)agent, (void)column, (void)row;
	snmp_put_number(out, SNMP_TICKS, 0);
	return true;
}

static uint32_t count_resources(const struct snmp_agent *agent)
{
	(void)agent;
	return RESOURCES + 1; /* and OPENRTU-MIB, whose place is the configuration's */
}

enum { RESOURCE_ID = 2, RESOURCE_TEXT, RESOURCE_UP_TIME };

static bool read_resource(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	if (column == RESOURCE_UP_TIME)
		return read_resources_changed(agent, column, row, out);
	if (column == RESOURCE_TEXT)
		snmp_put_text(out, row == RESOURCES ? "OPENRTU-MIB" : resources[row].text);
	else if (row == RESOURCES)
		return read_object_id(agent, column, row, out);
	else
		put_object_id(out, resources[row].ids, resources[row].length);
	return true;
}

const struct snmp_table snmp_resources_changed = SYSTEM(8, read_resources_changed);
const struct snmp_table snmp_resource_table = {.prefix = {9},
					       .prefix_length = 1,
					       .first = RESOURCE_ID,
					       .last = RESOURCE_UP_TIME,
					       .indexes = 1,
					       .count = count_resources,
					       .index = index_from_1,
					       .read = read_resource};

/* ---- snmpEngine ---------------------------------------------------------------------------- */

static bool read_engine_id(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)column, (void)row;
	out->syntax = SNMP_OCTETS;
	out->size = agent->engine_id_size;
	memcpy(out->octets, agent->engine_id, agent->engine_id_size);
	return true;
}

static bool read_boots(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)column, (void)row;
	snmp_put_number(out, SNMP_INTEGER, agent->boots);
	return true;
}

static bool read_engine_time(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)column, (void)row;
	snmp_put_number(out, SNMP_INTEGER, (agent->now_ns - agent->started_ns) / NS_PER_S);
	return true;
}

static bool read_message_size(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)column, (void)row;
	snmp_put_number(out, SNMP_INTEGER, agent->settings->max_message);
	return true;
}

const struct snmp_table snmp_engine_scalars[4] = {SYSTEM(1, read_engine_id), SYSTEM(2, read_boots),
						  SYSTEM(3, read_engine_time), SYSTEM(4, read_message_size)};

/* ---- what is counted of messages (RFC 3418, 3412, 3413, 3414) ------------------------------- */

static bool put_statistic(struct snmp_agent *agent, enum snmp_statistic which, struct snmp_value *out)
{
	snmp_put_number(out, SNMP_COUNTER, agent->statistic == NULL ? 0 : agent->statistic(which));
	return true;
}

static bool put_counter(struct snmp_agent *agent, enum snmp_counter counter, struct snmp_value *out)
{
	snmp_put_number(out, SNMP_COUNTER, agent->shared->counters[counter]);
	return true;
}

enum { IN_PACKETS = 1, BAD_VERSIONS = 3, PARSE_ERRORS = 6, AUTHENTICATION_TRAPS = 30, PROXY_DROPS = 32 };
enum { DISABLED = 2 };

/* There are no communities and no proxies. What is dropped is counted in rtuMessagesLimited. */
static bool read_message(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)row;
	if (column == IN_PACKETS)
		return put_counter(agent, SNMP_COUNT_MESSAGES, out);
	if (column == BAD_VERSIONS || column == PARSE_ERRORS)
		return put_statistic(agent, column == BAD_VERSIONS ? SNMP_BAD_VERSIONS : SNMP_PARSE_ERRORS,
				     out);
	snmp_put_number(out, column == AUTHENTICATION_TRAPS ? SNMP_INTEGER : SNMP_COUNTER,
			column == AUTHENTICATION_TRAPS ? DISABLED : 0);
	return true;
}

enum { UNKNOWN_MODELS = 1, INVALID_MESSAGES, UNKNOWN_HANDLERS };

static bool read_dispatch(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)row;
	if (column == UNKNOWN_HANDLERS)
		return put_counter(agent, SNMP_COUNT_UNKNOWN_HANDLERS, out);
	return put_statistic(agent, column == UNKNOWN_MODELS ? SNMP_UNKNOWN_MODELS : SNMP_INVALID_MESSAGES,
			     out);
}

enum { UNAVAILABLE_CONTEXTS = 4, UNKNOWN_CONTEXTS };

static bool read_contexts(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)row;
	if (column == UNKNOWN_CONTEXTS)
		return put_counter(agent, SNMP_COUNT_UNKNOWN_CONTEXTS, out);
	snmp_put_number(out, SNMP_COUNTER, 0);
	return true;
}

static bool read_usm(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)row;
	return put_statistic(agent, (enum snmp_statistic)(SNMP_USM_LEVELS + column - 1), out);
}

static void index_0(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	(void)agent, (void)row;
	out[0] = 0;
}

/* Scalars first to last of a group. */
#define GROUP(number, first_, last_, reader)                                                                 \
	{                                                                                                    \
		.entry = number, .first = first_, .last = last_, .indexes = 1, .index = index_0,             \
		.read = reader                                                                               \
	}
const struct snmp_table snmp_message_groups[3] = {GROUP(11, IN_PACKETS, IN_PACKETS, read_message),
						  GROUP(11, BAD_VERSIONS, PARSE_ERRORS, read_message),
						  GROUP(11, AUTHENTICATION_TRAPS, PROXY_DROPS, read_message)};
const struct snmp_table snmp_dispatch_group = GROUP(1, UNKNOWN_MODELS, UNKNOWN_HANDLERS, read_dispatch);
const struct snmp_table snmp_context_group = GROUP(1, UNAVAILABLE_CONTEXTS, UNKNOWN_CONTEXTS, read_contexts);
const struct snmp_table snmp_usm_group = GROUP(1, 1, 6, read_usm);

/* ---- rtuStation -------------------------------------------------------------------------- */

static bool read_starts(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)column, (void)row;
	snmp_put_number(out, SNMP_COUNTER, map_starts(agent->map));
	return true;
}

static bool read_started(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	struct map_module rtud;

	(void)column, (void)row;
	map_module(agent->map, MAP_RTUD, &rtud);
	snmp_put_moment(agent, out, rtud.started_ns);
	return true;
}

static bool read_configuration(struct snmp_agent *agent, uint32_t column, uint32_t row,
			       struct snmp_value *out)
{
	(void)column, (void)row;
	snmp_put_number(out, SNMP_GAUGE, agent->configuration);
	return true;
}

static bool read_points(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)column, (void)row;
	snmp_put_number(out, SNMP_GAUGE, agent->config->point_count);
	return true;
}

const struct snmp_table snmp_station_scalars[5] = {
    SCALAR(1, 1, read_name),          SCALAR(1, 2, read_starts), SCALAR(1, 3, read_started),
    SCALAR(1, 4, read_configuration), SCALAR(1, 5, read_points),
};

enum { DEVICE_NAME = 2, DEVICE_CA, DEVICE_MODULE, DEVICE_POINTS, DEVICE_INVALID };

static uint32_t count_devices(const struct snmp_agent *agent)
{
	return agent->config->set_count;
}

static uint32_t invalid_points(struct snmp_agent *agent, const struct map_set *set)
{
	uint32_t invalid = 0;

	for (uint32_t i = 0; i < set->point_count; i++) {
		struct map_sample sample;

		if (!map_read(agent->map, set->first_point + i, &sample) || (sample.quality & MAP_INVALID))
			invalid++;
	}
	return invalid;
}

static bool read_device(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	const struct map_set *set = &agent->config->sets[row];
	struct map_module module;

	switch (column) {
	case DEVICE_NAME:
		snmp_put_text(out, set->name);
		return true;
	case DEVICE_CA:
		snmp_put_number(out, SNMP_GAUGE, set->ca);
		return true;
	case DEVICE_MODULE:
		map_module(agent->map, set->module, &module);
		snmp_put_text(out, module.name);
		return true;
	case DEVICE_POINTS:
		snmp_put_number(out, SNMP_GAUGE, set->point_count);
		return true;
	default:
		snmp_put_number(out, SNMP_GAUGE, invalid_points(agent, set));
		return true;
	}
}

const struct snmp_table snmp_device_table = {.prefix = {1, 1, 7},
					     .prefix_length = 3,
					     .first = DEVICE_NAME,
					     .last = DEVICE_INVALID,
					     .indexes = 1,
					     .count = count_devices,
					     .index = index_from_1,
					     .read = read_device};

/* ---- rtuHealth --------------------------------------------------------------------------- */

enum { MODULE_NAME = 2, MODULE_STATE, MODULE_ALIVE, MODULE_RESTARTS, MODULE_HEARTBEAT, MODULE_LOST };

static uint32_t count_modules(const struct snmp_agent *agent)
{
	return map_module_count(agent->map);
}

static bool read_module(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	struct map_module module;

	map_module(agent->map, row, &module);
	switch (column) {
	case MODULE_NAME:
		snmp_put_text(out, module.name);
		return true;
	case MODULE_STATE:
		snmp_put_number(out, SNMP_INTEGER, module.state + 1);
		return true;
	case MODULE_ALIVE:
		snmp_put_truth(out, module.alive);
		return true;
	case MODULE_RESTARTS:
		snmp_put_number(out, SNMP_COUNTER, module.restarts);
		return true;
	case MODULE_HEARTBEAT:
		snmp_put_number(out, SNMP_GAUGE, module.heartbeat_age_ms);
		return true;
	default:
		snmp_put_number(out, SNMP_COUNTER, module.lost_events);
		return true;
	}
}

const struct snmp_table snmp_module_table = {.prefix = {1, 9, 1},
					     .prefix_length = 3,
					     .first = MODULE_NAME,
					     .last = MODULE_LOST,
					     .indexes = 1,
					     .count = count_modules,
					     .index = index_from_1,
					     .read = read_module};

/* The rows of counters: all of the first module, all of the second … Their number may grow while modules start. */
static uint32_t counters_of(const struct snmp_agent *agent, uint32_t module)
{
	struct map_counter counter;
	uint32_t count = 0;

	while (map_counter(agent->map, module, count, &counter))
		count++;
	return count;
}

static uint32_t count_counters(const struct snmp_agent *agent)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < map_module_count(agent->map); i++)
		count += counters_of(agent, i);
	return count;
}

/* Of a row the module and the counter's number in it. False: there are fewer. */
static bool find_counter(const struct snmp_agent *agent, uint32_t row, uint32_t *module, uint32_t *number)
{
	for (*module = 0; *module < map_module_count(agent->map); ++*module) {
		const uint32_t count = counters_of(agent, *module);

		*number = row;
		if (row < count)
			return true;
		row -= count;
	}
	return false;
}

static void index_counter(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	uint32_t module = 0, number = 0;

	find_counter(agent, row, &module, &number);
	out[0] = module + 1;
	out[1] = number + 1;
}

enum { COUNTER_NAME = 2, COUNTER_VALUE };

static bool read_counter(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	struct map_counter counter;
	uint32_t module, number;

	if (!find_counter(agent, row, &module, &number) || !map_counter(agent->map, module, number, &counter))
		return false;
	if (column == COUNTER_NAME)
		snmp_put_text(out, counter.name);
	else
		snmp_put_number(out, SNMP_COUNTER, counter.value);
	return true;
}

const struct snmp_table snmp_counter_table = {.prefix = {1, 9, 2},
					      .prefix_length = 3,
					      .first = COUNTER_NAME,
					      .last = COUNTER_VALUE,
					      .indexes = 2,
					      .count = count_counters,
					      .index = index_counter,
					      .read = read_counter};

#define OWN_COUNTER(name, counter)                                                                           \
	static bool name(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)    \
	{                                                                                                    \
		(void)column, (void)row;                                                                     \
		snmp_put_number(out, SNMP_COUNTER, agent->shared->counters[counter]);                        \
		return true;                                                                                 \
	}

OWN_COUNTER(read_limited, SNMP_COUNT_LIMITED)
OWN_COUNTER(read_denied, SNMP_COUNT_DENIED)
OWN_COUNTER(read_damaged, SNMP_COUNT_DAMAGED)

const struct snmp_table snmp_health_scalars[3] = {SCALAR(9, 3, read_limited), SCALAR(9, 4, read_denied),
						  SCALAR(9, 5, read_damaged)};
