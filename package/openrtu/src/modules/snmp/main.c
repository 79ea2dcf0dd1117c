/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * rtu-snmp: the agent of OPENRTU-MIB. One loop: messages, the map's events, commands under way, notifications. libnetsnmp
 * allocates for each message and frees it with the answer; what waits at a time is bounded by the sinks' windows.
 */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include "modules/snmp/answer.h"
#include "modules/snmp/engine.h"
#include "modules/snmp/kernel.h"
#include "modules/snmp/notify.h"
#include "modules/snmp/wire.h"
#include "process/module.h"

#define MESSAGES_A_TURN 32
#define BUSY_MS         20
#define IDLE_MS         500

static struct map *map;
static struct snmp_agent agent;
static struct snmp_keyring keyring;
static struct wire *wire;

static void name_counters(struct snmp_shared *shared)
{
	static const char *const names[SNMP_COUNT_OF_COUNTERS] = {
	    [SNMP_COUNT_MESSAGES] = "messages",
	    [SNMP_COUNT_LIMITED] = "messages_limited",
	    [SNMP_COUNT_DAMAGED] = "messages_damaged",
	    [SNMP_COUNT_DENIED] = "requests_denied",
	    [SNMP_COUNT_SETS] = "sets",
	    [SNMP_COUNT_EVENTS] = "events",
	    [SNMP_COUNT_EVENTS_LOST] = "events_lost",
	    [SNMP_COUNT_NOTIFICATIONS] = "notifications",
	    [SNMP_COUNT_RETRIES] = "notification_retries",
	    [SNMP_COUNT_SILENT] = "sinks_silent",
	    [SNMP_COUNT_UNKNOWN_CONTEXTS] = "contexts_unknown",
	    [SNMP_COUNT_UNKNOWN_HANDLERS] = "contexts_elsewhere",
	};

	for (unsigned i = 0; i < SNMP_COUNT_OF_COUNTERS; i++)
		map_name_counter(map, &shared->counters[i], "%s", names[i]);
}

static bool start(const struct options *options, struct snmp_shared *shared)
{
	const struct snmp_settings *settings = snmp_settings(map_config(map));
	uint32_t boots;

	if (!engine_read_keys(map, settings, &keyring) || !engine_count_boot(map, settings->state, &boots))
		return false;
	if (!snmp_begin(&agent, map, shared)) {
		map_log(map, MAP_LOG_ERROR, "cannot start: %s", strerror(ENOMEM));
		return false;
	}
	agent.boots = boots;
	agent.statistic = wire_statistic;
	agent.engine_id_size = keyring.engine.size;
	memcpy(agent.engine_id, keyring.engine.octets, keyring.engine.size);
	if (!wire_init(&agent, &keyring))
		return false;
	wire = wire_listen(&agent, options->socket_fd, answer_request, &agent);
	if (wire == NULL || !notify_begin(&agent, &keyring)) {
		map_log(map, MAP_LOG_ERROR, "cannot open its sessions: %s", strerror(errno));
		return false;
	}
	name_counters(shared);
	kernel_begin(&agent);
	return true;
}

/* Until periods of cyclic data end. */
static int wait_ms(int most_ms)
{
	const int64_t left_ms = (agent.cyclic.due_ns - agent.now_ns) / NS_PER_MS + 1;

	return left_ms < most_ms ? (int)left_ms : most_ms;
}

/* Returns how long it may sleep. */
static int serve(void)
{
	bool busy, more;

	map_heartbeat(map);
	map_bell_clear(map);
	wire_read(wire, MESSAGES_A_TURN);
	snmp_new_message(&agent);
	kernel_hear(&agent);
	more = snmp_events_take(&agent);
	busy = snmp_tick(&agent);
	busy |= notify_run(&agent);
	return more ? 0 : wait_ms(busy ? BUSY_MS : IDLE_MS);
}

static void run(int stop)
{
	struct pollfd waits[4 + SNMP_SINKS_MAX] = {
	    {.fd = stop, .events = POLLIN},
	    {.fd = map_bell_fd(map), .events = POLLIN},
	    {.fd = wire_fd(wire), .events = POLLIN},
	    {.fd = kernel_fd(), .events = POLLIN},
	};
	const uint32_t sinks = agent.settings->sink_count;

	for (uint32_t i = 0; i < sinks; i++)
		waits[4 + i] = (struct pollfd){.fd = notify_fd(i), .events = POLLIN};
	while (map_may_run(map) && (waits[0].revents & POLLIN) == 0)
		poll(waits, 4 + sinks, serve());
}

int main(int argc, char **argv)
{
	struct snmp_shared *shared;
	struct options options;
	int stop;

	map = module_begin(argc, argv, &options);
	shared = map_section(map, map_self(map), sizeof(*shared));
	if (snmp_settings(map_config(map)) == NULL || shared == NULL)
		return module_is_of_another_build(map);
	stop = module_stop_fd();
	if (stop < 0 || !start(&options, shared) || !module_confine(map, &options, 0))
		return MODULE_FAILED;
	run(stop);
	snmp_end(&agent);
	map_detach(map);
	return MODULE_ENDED;
}
