/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * rtu-104m and rtu-104m-tls: the controlling station of the gateway, on TCP, or also on TLS. Other stations of IEC 60870-5-104,
 * each with one connection or two, in one loop; their objects are points of the map. Nothing is allocated once it runs, but by
 * OpenSSL.
 */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include "map/time_ns.h"
#include "modules/iec104m/outstation.h"
#include "process/module.h"

#define HEARTBEAT_NS (250 * NS_PER_MS) /* a quarter of what kind.c allows */
#define LINKS_MAX    (IEC104_OUTSTATIONS_MAX * IEC104_OUTSTATION_LINKS_MAX)

enum { WAIT_STOP, WAIT_BELL, WAIT_LINKS, WAITS_MAX = WAIT_LINKS + LINKS_MAX };

static struct map *map;
static struct outstation *outstations;
static uint32_t count;

/* ---- requests ---------------------------------------------------------------------------- */

static void execute(const struct map_request *request, int64_t now_ns)
{
	const uint16_t set = map_config(map)->points[request->point].set;

	for (uint32_t i = 0; i < count; i++)
		if (outstation_has(&outstations[i], set))
			outstation_execute(&outstations[i], request, now_ns);
}

static void take_requests(int64_t now_ns)
{
	struct map_request request;

	while (map_request_next(map, &request))
		if (map_command_request(map, &request))
			execute(&request, now_ns);
}

/* ---- the loop ---------------------------------------------------------------------------- */

static struct link *link_at(uint32_t number)
{
	return &outstations[number / IEC104_OUTSTATION_LINKS_MAX].links[number % IEC104_OUTSTATION_LINKS_MAX];
}

/* One that has no second link has a place for it that is never ready. */
static void prepare(struct pollfd waits[WAITS_MAX])
{
	waits[WAIT_BELL] = (struct pollfd){.fd = map_bell_fd(map), .events = POLLIN};
	for (uint32_t i = 0; i < count * IEC104_OUTSTATION_LINKS_MAX; i++) {
		struct link *link = link_at(i);

		waits[WAIT_LINKS + i] = (struct pollfd){
		    .fd = link->outstation == NULL ? -1 : link->channel.fd, .events = link_events(link)};
	}
}

static void receive(const struct pollfd waits[WAITS_MAX])
{
	for (uint32_t i = 0; i < count * IEC104_OUTSTATION_LINKS_MAX; i++)
		if (waits[WAIT_LINKS + i].revents & ~POLLOUT)
			link_receive(link_at(i));
}

static void say(enum map_log_level level, const char *peer, const char *text)
{
	map_log(map, level, peer != NULL ? "%s: %s" : "%s%s", peer != NULL ? peer : "", text);
}

static struct channel_owner channels = {.controlling = true, .message = iec104_apdu_size, .say = say};

static int64_t serve(void)
{
	const int64_t now_ns = map_now_ns();
	int64_t deadline_ns = now_ns + HEARTBEAT_NS;

	map_bell_clear(map);
	channel_watch(now_ns);
	take_requests(now_ns);
	for (uint32_t i = 0; i < count; i++) {
		outstation_run(&outstations[i], now_ns);
		if (map_alive(map, map_self(map)))
			map_heartbeat(map); /* handshakes take their time */
		deadline_ns = earlier(deadline_ns, outstation_deadline(&outstations[i]));
	}
	map_heartbeat(map); /* what was lost meanwhile is told so before */
	return deadline_ns;
}

static int pause_ms(int64_t deadline_ns)
{
	const int64_t left_ns = deadline_ns - map_now_ns();

	return left_ns <= 0 ? 0 : (int)((left_ns + NS_PER_MS - 1) / NS_PER_MS);
}

static void run(int stop)
{
	static struct pollfd waits[WAITS_MAX];

	waits[WAIT_STOP] = (struct pollfd){.fd = stop, .events = POLLIN};
	while (map_may_run(map) && (waits[WAIT_STOP].revents & POLLIN) == 0) {
		const int64_t deadline_ns = serve();

		prepare(waits);
		if (poll(waits, WAIT_LINKS + count * IEC104_OUTSTATION_LINKS_MAX, pause_ms(deadline_ns)) > 0)
			receive(waits);
	}
}

/* ---- start ------------------------------------------------------------------------------- */

static void name_counters(const struct iec104_outstation *config, const struct iec104_outstation_stats *stats)
{
	map_name_counter(map, &stats->started, "%s.started", config->name);
	map_name_counter(map, &stats->starts, "%s.starts", config->name);
	map_name_counter(map, &stats->failures, "%s.failures", config->name);
	map_name_counter(map, &stats->objects, "%s.objects", config->name);
	map_name_counter(map, &stats->unmapped, "%s.unmapped", config->name);
	map_name_counter(map, &stats->mistyped, "%s.mistyped", config->name);
	map_name_counter(map, &stats->untimely, "%s.untimely", config->name);
	map_name_counter(map, &stats->past, "%s.past", config->name);
	map_name_counter(map, &stats->unknown, "%s.unknown", config->name);
	map_name_counter(map, &stats->refused, "%s.refused", config->name);
}

/* False: there is no memory. */
static bool set_up(const struct iec104_outstation *configs, struct iec104_outstation_stats *stats)
{
	outstations = calloc(count, sizeof(*outstations));
	for (uint32_t i = 0; outstations != NULL && i < count; i++) {
		if (!outstation_init(&outstations[i], map, &configs[i], &stats[i], map_now_ns()))
			return false;
		name_counters(&configs[i], &stats[i]);
	}
	return outstations != NULL;
}

int main(int argc, char **argv)
{
	const struct iec104_outstation *configs;
	struct iec104_outstation_stats *stats;
	struct options options;
	int stop;

	map = module_begin(argc, argv, &options);
	configs = iec104_outstations(map_config(map));
	count = map_record_count(map_config(map), IEC104_OUTSTATIONS);
	stats = map_section(map, map_self(map), count * sizeof(*stats));
	if (configs == NULL || stats == NULL)
		return module_is_of_another_build(map);
	stop = module_stop_fd();
	if (stop < 0 || !set_up(configs, stats)) {
		map_log(map, MAP_LOG_ERROR, "cannot start: %s", strerror(errno));
		return MODULE_FAILED;
	}
	channels.tls = iec104_outstation_tls(map_config(map));
	if (channels.tls != NULL && !channel_start(&channels))
		return MODULE_FAILED;
	if (!module_confine(map, &options, 0))
		return MODULE_FAILED;
	run(stop);
	for (uint32_t i = 0; i < count; i++)
		outstation_free(&outstations[i]);
	free(outstations);
	map_detach(map);
	return MODULE_ENDED;
}
