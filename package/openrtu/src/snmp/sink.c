/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "snmp/sink.h"

#include "snmp/agent.h"

#define PROBE_NS (60 * NS_PER_S)

static uint32_t confirmed(const struct snmp_agent *agent, uint32_t sink)
{
	return agent->shared->confirmed[sink];
}

void snmp_sinks_begin(struct snmp_agent *agent)
{
	for (uint32_t i = 0; i < agent->settings->sink_count; i++)
		agent->sinks[i].next = confirmed(agent, i) + 1;
}

/* What left the table before the sink had it. */
static void skip_lost(struct snmp_agent *agent, uint32_t sink)
{
	struct snmp_sink_run *run = &agent->sinks[sink];
	const uint32_t first = snmp_event_first(agent);

	if (run->next >= first)
		return;
	map_count(&agent->shared->sink_lost[sink], first - run->next);
	run->next = first;
}

static struct snmp_flight *flight_to_repeat(struct snmp_agent *agent, uint32_t sink)
{
	struct snmp_sink_run *run = &agent->sinks[sink];

	for (unsigned i = 0; i < agent->settings->sinks[sink].window; i++)
		if (run->flights[i].used && run->flights[i].due_ns != 0 &&
		    agent->now_ns >= run->flights[i].due_ns)
			return &run->flights[i];
	return NULL;
}

static struct snmp_flight *free_flight(struct snmp_agent *agent, uint32_t sink)
{
	struct snmp_sink_run *run = &agent->sinks[sink];

	for (unsigned i = 0; i < agent->settings->sinks[sink].window; i++)
		if (!run->flights[i].used)
			return &run->flights[i];
	return NULL;
}

enum snmp_sending snmp_sink_next(struct snmp_agent *agent, uint32_t sink, struct snmp_flight **flight)
{
	struct snmp_sink_run *run = &agent->sinks[sink];

	if (run->silent)
		return !run->probing && agent->now_ns >= run->probe_ns ? SNMP_SEND_PROBE : SNMP_SEND_NOTHING;
	*flight = flight_to_repeat(agent, sink);
	if (*flight != NULL)
		return SNMP_SEND_EVENTS;
	*flight = free_flight(agent, sink);
	skip_lost(agent, sink);
	if (*flight == NULL || run->next > agent->position.last)
		return SNMP_SEND_NOTHING;
	**flight = (struct snmp_flight){.first = run->next, .last = agent->position.last};
	return SNMP_SEND_EVENTS;
}

/* Everything before the first flight that waits is with the sink. */
static void confirm(struct snmp_agent *agent, uint32_t sink)
{
	struct snmp_sink_run *run = &agent->sinks[sink];
	uint32_t first = run->next;

	for (unsigned i = 0; i < SNMP_WINDOW_MAX; i++)
		if (run->flights[i].used && !run->flights[i].answered && run->flights[i].first < first)
			first = run->flights[i].first;
	for (unsigned i = 0; i < SNMP_WINDOW_MAX; i++)
		if (run->flights[i].answered && run->flights[i].last < first)
			run->flights[i] = (struct snmp_flight){0};
	agent->shared->confirmed[sink] = first - 1;
}

void snmp_sink_sent(struct snmp_agent *agent, uint32_t sink, struct snmp_flight *flight, uint32_t last)
{
	const bool inform = agent->settings->sinks[sink].inform;

	map_count(&agent->shared->counters[SNMP_COUNT_NOTIFICATIONS], 1);
	if (flight->tries++ > 0)
		map_count(&agent->shared->counters[SNMP_COUNT_RETRIES], 1);
	else
		agent->sinks[sink].next = last + 1;
	flight->last = last;
	flight->due_ns = 0;
	flight->used = inform;
	if (!inform)
		confirm(agent, sink);
}

void snmp_sink_probed(struct snmp_agent *agent, uint32_t sink)
{
	map_count(&agent->shared->counters[SNMP_COUNT_NOTIFICATIONS], 1);
	agent->sinks[sink].probing = true;
	agent->sinks[sink].probe_ns = agent->now_ns + PROBE_NS;
}

void snmp_sink_answered(struct snmp_agent *agent, uint32_t sink, struct snmp_flight *flight)
{
	struct snmp_sink_run *run = &agent->sinks[sink];

	if (flight == NULL)
		run->probing = run->silent = false;
	if (flight == NULL || !flight->used)
		return;
	flight->answered = true;
	flight->due_ns = 0;
	confirm(agent, sink);
}

/* All that was under way is sent anew once the sink answers again. */
static void fall_silent(struct snmp_agent *agent, uint32_t sink, const char *reason)
{
	struct snmp_sink_run *run = &agent->sinks[sink];

	for (unsigned i = 0; i < SNMP_WINDOW_MAX; i++)
		run->flights[i] = (struct snmp_flight){0};
	run->next = confirmed(agent, sink) + 1;
	run->silent = true;
	run->probe_ns = agent->now_ns + PROBE_NS;
	map_count(&agent->shared->counters[SNMP_COUNT_SILENT], 1);
	map_log(agent->map, MAP_LOG_WARNING, "the sink %s answers no inform%s%s",
		agent->settings->sinks[sink].name,
		reason == NULL ? "" : ", but a report: ", reason == NULL ? "" : reason);
}

void snmp_sink_unanswered(struct snmp_agent *agent, uint32_t sink, struct snmp_flight *flight, int64_t due_ns,
			  const char *reason)
{
	if (flight == NULL) {
		agent->sinks[sink].probing = false;
		return;
	}
	if (!flight->used || flight->answered)
		return;
	if (flight->tries > agent->settings->sinks[sink].retries)
		fall_silent(agent, sink, reason);
	else
		flight->due_ns = due_ns;
}

bool snmp_sink_is_busy(const struct snmp_agent *agent, uint32_t sink)
{
	return agent->shared->confirmed[sink] != agent->position.last;
}
