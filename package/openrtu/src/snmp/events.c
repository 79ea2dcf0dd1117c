/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The numbered events: rtuEvents. */
#include "snmp/agent.h"

#include <string.h>

#define EVENTS_A_TURN 64

/* ---- numbering --------------------------------------------------------------------------- */

uint32_t snmp_event_first(const struct snmp_agent *agent)
{
	return agent->position.last < SNMP_EVENTS ? 1 : agent->position.last - SNMP_EVENTS + 1;
}

const struct snmp_event *snmp_event_at(const struct snmp_agent *agent, uint32_t number)
{
	return &agent->shared->events[number % SNMP_EVENTS];
}

/* From here on another process of this module goes on behind what is numbered. */
static void keep(struct snmp_agent *agent)
{
	latch_store(&agent->shared->latch, agent->shared->copies, &agent->position, sizeof(agent->position));
}

static void put(struct snmp_agent *agent, const struct snmp_event *event)
{
	agent->position.last++;
	agent->shared->events[agent->position.last % SNMP_EVENTS] = *event;
	map_count(&agent->shared->counters[SNMP_COUNT_EVENTS], 1);
}

void snmp_event_add(struct snmp_agent *agent, const struct snmp_event *event)
{
	put(agent, event);
	keep(agent);
}

void snmp_event_add_now(struct snmp_agent *agent, struct snmp_event event)
{
	event.time_ms = map_wall_ns(agent->clock, agent->now_ns) / NS_PER_MS;
	event.time_valid = agent->clock.set;
	snmp_event_add(agent, &event);
}

/* Of the station, or of other points in it: a manager that keeps them reads them again. */
static void announce_start(struct snmp_agent *agent)
{
	const uint32_t starts = map_starts(agent->map);
	struct snmp_shared *shared = agent->shared;
	const bool started = shared->starts != starts;

	if (started) {
		shared->starts = starts;
		shared->changed = false;
		memset(shared->initialised, 0, sizeof(shared->initialised));
		snmp_event_add_now(agent,
				   (struct snmp_event){.kind = SNMP_EVENT_COLD_START, .ca = SNMP_NO_CA});
	}
	if (!started && shared->configuration == agent->configuration)
		return;
	shared->configuration = agent->configuration;
	snmp_event_add_now(agent, (struct snmp_event){.kind = SNMP_EVENT_STARTED, .ca = SNMP_NO_CA});
}

void snmp_events_begin(struct snmp_agent *agent)
{
	struct snmp_shared *shared = agent->shared;

	if (shared->epoch == 0) {
		map_cursor_to_end(agent->map, &agent->position.cursor);
		agent->position.last = 0;
		keep(agent);
		shared->epoch = (uint32_t)(map_wall_ns(agent->clock, agent->now_ns) / NS_PER_S) | 1;
	}
	memcpy(&agent->position, &shared->copies[latch_whole_copy(&shared->latch)], sizeof(agent->position));
	keep(agent);
	announce_start(agent);
}

/* Of the station's own period; any other event of a counter is a change of its quality. */
static bool is_of_a_freeze(const struct snmp_agent *agent, const struct map_event *event)
{
	return agent->config->points[event->point].type == MAP_COUNTER &&
	       (event->sample.detail & MAP_COUNTER_FROZEN) != 0;
}

static enum snmp_event_kind kind_of(const struct snmp_agent *agent, const struct map_event *event)
{
	switch ((enum map_event_kind)event->kind) {
	case MAP_EVENT_CHANGE:
		break;
	case MAP_EVENT_MODULE_DOWN:
		return SNMP_EVENT_MODULE_DOWN;
	case MAP_EVENT_MODULE_UP:
		return SNMP_EVENT_MODULE_UP;
	case MAP_EVENT_CLOCK:
		return SNMP_EVENT_CLOCK;
	}
	return is_of_a_freeze(agent, event) ? SNMP_EVENT_FROZEN : SNMP_EVENT_CHANGE;
}

static void number(struct snmp_agent *agent, const struct map_event *event)
{
	const enum snmp_event_kind kind = kind_of(agent, event);
	struct snmp_event numbered = {.ca = SNMP_NO_CA, .module = (uint8_t)event->point};

	if (event->kind == MAP_EVENT_CHANGE)
		numbered =
		    (struct snmp_event){SNMP_OF_POINT(agent, event->point), .value = event->sample.value,
					.quality = event->sample.quality, .cause = event->cause};
	if (kind == SNMP_EVENT_FROZEN)
		numbered.counter_detail = event->sample.detail;
	numbered.kind = (uint8_t)kind;
	numbered.time_ms = map_event_wall_ns(event, agent->clock) / NS_PER_MS;
	numbered.time_valid = map_event_time_is_set(event, agent->clock);
	put(agent, &numbered);
}

bool snmp_events_take(struct snmp_agent *agent)
{
	struct map_cursor *cursor = &agent->position.cursor;
	struct map_event event;
	unsigned taken = 0;

	while (taken < EVENTS_A_TURN && map_event_next(agent->map, cursor, &event)) {
		number(agent, &event);
		taken++;
	}
	if (cursor->lost != 0) {
		map_count_lost_events(agent->map, cursor->lost);
		map_count(&agent->shared->counters[SNMP_COUNT_EVENTS_LOST], cursor->lost);
		cursor->lost = 0;
		taken++;
	}
	if (taken != 0)
		keep(agent);
	return taken >= EVENTS_A_TURN;
}

/* ---- scalars ----------------------------------------------------------------------------- */

#define SCALAR(name, number_, value)                                                                         \
	static bool name(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)    \
	{                                                                                                    \
		(void)column, (void)row;                                                                     \
		snmp_put_number(out, number_, value);                                                        \
		return true;                                                                                 \
	}

SCALAR(read_first, SNMP_GAUGE, snmp_event_first(agent))
SCALAR(read_last, SNMP_GAUGE, agent->position.last)
SCALAR(read_epoch, SNMP_GAUGE, agent->shared->epoch)
SCALAR(read_lost, SNMP_COUNTER, agent->shared->counters[SNMP_COUNT_EVENTS_LOST])

const struct snmp_table snmp_event_scalars[4] = {
    {.prefix = {1, 8, 1}, .prefix_length = 3, .read = read_first},
    {.prefix = {1, 8, 2}, .prefix_length = 3, .read = read_last},
    {.prefix = {1, 8, 3}, .prefix_length = 3, .read = read_epoch},
    {.prefix = {1, 8, 4}, .prefix_length = 3, .read = read_lost},
};

/* ---- rtuEventTable ----------------------------------------------------------------------- */

static bool has_number(const struct snmp_event *event)
{
	return (event->kind == SNMP_EVENT_CHANGE || event->kind == SNMP_EVENT_FROZEN) &&
	       map_types[event->type].class == MAP_CLASS_MEASURED;
}

static int64_t shown_value(const struct snmp_event *event)
{
	switch ((enum snmp_event_kind)event->kind) {
	case SNMP_EVENT_COMMAND:
		return event->state + 1;
	case SNMP_EVENT_MODULE_DOWN:
	case SNMP_EVENT_MODULE_UP:
		return event->module + 1;
	case SNMP_EVENT_CHANGE:
	case SNMP_EVENT_FROZEN:
		return (int32_t)snmp_shown_value((enum map_type)event->type, event->decimals, event->value);
	case SNMP_EVENT_CYCLIC:
	case SNMP_EVENT_INITIALISED:
	case SNMP_EVENT_LINK_DOWN:
	case SNMP_EVENT_LINK_UP:
		return event->value.i;
	case SNMP_EVENT_CLOCK:
	case SNMP_EVENT_PARAMETER:
	case SNMP_EVENT_STARTED:
	case SNMP_EVENT_COLD_START:
		break;
	}
	return 0;
}

void snmp_event_read(const struct snmp_agent *agent, uint32_t column, uint32_t number_,
		     struct snmp_value *out)
{
	const struct snmp_event *event = snmp_event_at(agent, number_);
	const enum map_type type = (enum map_type)event->type;

	switch ((enum snmp_event_column)column) {
	case SNMP_EVENT_KIND:
		snmp_put_number(out, SNMP_INTEGER, event->kind);
		break;
	case SNMP_EVENT_CA:
		snmp_put_number(out, SNMP_GAUGE, event->ca);
		break;
	case SNMP_EVENT_IOA:
		snmp_put_number(out, SNMP_GAUGE, event->ioa);
		break;
	case SNMP_EVENT_TYPE:
		snmp_put_number(out, SNMP_INTEGER, snmp_type_number(type));
		break;
	case SNMP_EVENT_VALUE:
		snmp_put_number(out, SNMP_INTEGER, shown_value(event));
		break;
	case SNMP_EVENT_FLOAT:
		snmp_put_float(out, has_number(event) ? snmp_float_of(type, event->value) : 0);
		break;
	case SNMP_EVENT_QUALITY:
		snmp_put_quality(out, event->quality, event->counter_detail);
		break;
	case SNMP_EVENT_TIME:
		snmp_put_time(out, event->time_ms);
		break;
	case SNMP_EVENT_TIME_VALID:
		snmp_put_truth(out, event->time_valid);
		break;
	case SNMP_EVENT_CAUSE:
		snmp_put_number(out, SNMP_INTEGER, event->cause + 1);
		break;
	}
}

static uint32_t count_events(const struct snmp_agent *agent)
{
	return agent->position.last - snmp_event_first(agent) + 1;
}

static void index_event(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	out[0] = snmp_event_first(agent) + row;
}

static bool read_event(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	snmp_event_read(agent, column, snmp_event_first(agent) + row, out);
	return true;
}

const struct snmp_table snmp_event_table = {.prefix = {1, 8, 5},
					    .prefix_length = 3,
					    .first = SNMP_EVENT_KIND,
					    .last = SNMP_EVENT_CAUSE,
					    .indexes = 1,
					    .count = count_events,
					    .index = index_event,
					    .read = read_event};

/* ---- rtuSinkTable ------------------------------------------------------------------------ */

enum { SINK_NAME = 2, SINK_STATE, SINK_CONFIRMED, SINK_WAITING, SINK_LOST };
enum { SINK_TRAPS = 1, SINK_INFORMING, SINK_SILENT };

static uint32_t count_sinks(const struct snmp_agent *agent)
{
	return agent->settings->sink_count;
}

static void index_sink(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	(void)agent;
	out[0] = row + 1;
}

static bool read_sink(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	const struct snmp_sink *sink = &agent->settings->sinks[row];

	switch (column) {
	case SINK_NAME:
		snmp_put_text(out, sink->name);
		return true;
	case SINK_STATE:
		snmp_put_number(out, SNMP_INTEGER,
				!sink->inform              ? SINK_TRAPS
				: agent->sinks[row].silent ? SINK_SILENT
							   : SINK_INFORMING);
		return true;
	case SINK_CONFIRMED:
		snmp_put_number(out, SNMP_GAUGE, agent->shared->confirmed[row]);
		return true;
	case SINK_WAITING:
		snmp_put_number(out, SNMP_GAUGE, agent->position.last - agent->shared->confirmed[row]);
		return true;
	default:
		snmp_put_number(out, SNMP_COUNTER, agent->shared->sink_lost[row]);
		return true;
	}
}

const struct snmp_table snmp_sink_table = {.prefix = {1, 8, 6},
					   .prefix_length = 3,
					   .first = SINK_NAME,
					   .last = SINK_LOST,
					   .indexes = 1,
					   .reader = SNMP_OPERATOR,
					   .count = count_sinks,
					   .index = index_sink,
					   .read = read_sink};
