/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * End of initialisation (IEC 60870-5-101, 7.4.3): each station says it once, when its devices have been asked after the start
 * of all, or after a changed configuration that brings it.
 */
#include "snmp/agent.h"

#include <stdlib.h>

#define PATIENCE_NS (30 * NS_PER_S) /* a line whose port cannot be opened asks nobody */

/* IEC 60870-5-101, 7.2.6.21: the octet COI. */
#define COI_POWER_ON     0
#define COI_LOCAL_RESET  1
#define COI_REMOTE_RESET 2
#define COI_CHANGED      0x80

static bool is_told(const struct snmp_agent *agent, uint16_t ca)
{
	return (agent->shared->initialised[ca / 8] & 1u << ca % 8) != 0;
}

static uint32_t point_of(const struct snmp_agent *agent, uint32_t place)
{
	return agent->lists[SNMP_ALL].points[place];
}

bool snmp_stations_begin(struct snmp_agent *agent)
{
	const uint32_t count = agent->lists[SNMP_ALL].count;
	struct snmp_station *station = NULL;

	agent->stations = malloc((count + 1) * sizeof(*agent->stations));
	if (agent->stations == NULL)
		return false;
	for (uint32_t i = 0; i < count; i++) {
		const uint16_t ca = snmp_ca(agent, point_of(agent, i));

		if (station == NULL || station->ca != ca) {
			station = &agent->stations[agent->station_count++];
			*station = (struct snmp_station){.ca = ca, .first = i};
		}
		station->count++;
	}
	return true;
}

static bool is_asked(const struct snmp_agent *agent, uint32_t point)
{
	struct map_module owner;
	struct map_sample sample;

	if (agent->config->points[point].flags & MAP_POINT_NEVER_READ)
		return true;
	map_module(agent->map, map_owner(agent->map, point), &owner);
	return map_read(agent->map, point, &sample) && sample.time_ns != 0 &&
	       sample.time_ns >= owner.started_ns;
}

static bool all_asked(const struct snmp_agent *agent, struct snmp_station *station)
{
	while (station->asked < station->count &&
	       is_asked(agent, point_of(agent, station->first + station->asked)))
		station->asked++;
	return station->asked == station->count;
}

static void tell(struct snmp_agent *agent, uint16_t ca)
{
	const int32_t cause = agent->shared->changed       ? COI_CHANGED | COI_LOCAL_RESET
			      : map_starts(agent->map) > 1 ? COI_REMOTE_RESET
							   : COI_POWER_ON;

	agent->shared->initialised[ca / 8] |= (uint8_t)(1u << ca % 8);
	snmp_event_add_now(agent,
			   (struct snmp_event){.kind = SNMP_EVENT_INITIALISED, .ca = ca, .value.i = cause});
}

void snmp_stations_tick(struct snmp_agent *agent)
{
	if (agent->initialised_count == agent->station_count)
		return;
	agent->initialised_count = 0;
	for (uint32_t i = 0; i < agent->station_count; i++) {
		struct snmp_station *station = &agent->stations[i];

		if (!is_told(agent, station->ca) &&
		    (all_asked(agent, station) || agent->now_ns - agent->started_ns >= PATIENCE_NS))
			tell(agent, station->ca);
		agent->initialised_count += is_told(agent, station->ca);
	}
}

/* ---- rtuInitialisedTable ----------------------------------------------------------------- */

static uint32_t count_stations(const struct snmp_agent *agent)
{
	return agent->station_count;
}

static void index_station(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	out[0] = agent->stations[row].ca;
}

static bool read_station(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)column;
	snmp_put_truth(out, is_told(agent, agent->stations[row].ca));
	return true;
}

const struct snmp_table snmp_initialised_table = {.prefix = {1, 1, 8},
						  .prefix_length = 3,
						  .first = 2,
						  .last = 2,
						  .indexes = 1,
						  .count = count_stations,
						  .index = index_station,
						  .read = read_station};
