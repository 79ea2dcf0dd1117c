/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * rtu-goose: points of the map as GOOSE messages, and messages of others as points. One loop on one socket, which rtud has bound
 * to the interface. Nothing is allocated once it runs.
 */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include "map/time_ns.h"
#include "modules/goose/publish.h"
#include "modules/goose/subscribe.h"
#include "modules/goose/wire.h"
#include "modules/module.h"

#define HEARTBEAT_NS  (250 * NS_PER_MS) /* a quarter of what kind.c allows */
#define FRAMES_A_TURN 32

static struct map *map;
static struct goose_stats *stats;
static struct wire wire;

static void receive(int64_t now_ns)
{
	uint8_t frame[GOOSE_FRAME_MAX];
	size_t size;

	for (unsigned i = 0; i < FRAMES_A_TURN && (size = wire_receive(&wire, frame)) != 0; i++)
		subscribe_take(frame, size, now_ns);
}

/* Returns when there is more to do. */
static int64_t serve(void)
{
	static int64_t heartbeat_ns;
	const int64_t now_ns = map_now_ns();

	if (now_ns >= heartbeat_ns) {
		heartbeat_ns = now_ns + HEARTBEAT_NS;
		map_heartbeat(map);
		map_bell_new_period(map);
	}
	map_bell_clear(map);
	receive(now_ns);
	subscribe_run(now_ns);
	publish_run(&wire, now_ns);
	return earlier(heartbeat_ns, earlier(publish_deadline(), subscribe_deadline()));
}

/* Whoever rings without end is heard again with the next heartbeat: a real-time process would leave no time to others. */
static int bell(void)
{
	return map_bell_is_wild(map) ? -1 : map_bell_fd(map);
}

static struct timespec pause_until(int64_t deadline_ns)
{
	const int64_t now_ns = map_now_ns(), left_ns = deadline_ns > now_ns ? deadline_ns - now_ns : 0;

	return (struct timespec){.tv_sec = left_ns / NS_PER_S, .tv_nsec = (long)(left_ns % NS_PER_S)};
}

static void run(int stop)
{
	struct pollfd waits[] = {
	    {.fd = stop, .events = POLLIN},
	    {.fd = map_bell_fd(map), .events = POLLIN},
	    {.fd = wire.fd, .events = POLLIN},
	};

	while (map_may_run(map) && (waits[0].revents & POLLIN) == 0 && !wire.gone) {
		const struct timespec pause = pause_until(serve());

		waits[1].fd = bell();
		ppoll(waits, sizeof(waits) / sizeof(waits[0]), &pause, NULL);
	}
}

static void name_own_counters(void)
{
	map_name_counter(map, &stats->frames, "frames");
	map_name_counter(map, &stats->damaged, "damaged");
	map_name_counter(map, &stats->unknown, "unknown");
	map_name_counter(map, &stats->failures, "failures");
}

int main(int argc, char **argv)
{
	struct options options;
	int stop;

	map = module_begin(argc, argv, &options);
	stats = map_section(map, map_self(map), sizeof(*stats));
	if (goose_settings(map_config(map)) == NULL || stats == NULL)
		return module_is_of_another_build(map);
	name_own_counters();
	stop = module_stop_fd();
	if (stop < 0 || !wire_init(&wire, map, options.socket_fd, stats) || !publish_begin(map, stats) ||
	    !subscribe_begin(map, stats)) {
		map_log(map, MAP_LOG_ERROR, "cannot start: %s", strerror(errno));
		return MODULE_FAILED;
	}
	if (!module_confine(map, &options, 0))
		return MODULE_FAILED;
	run(stop);
	publish_end();
	map_detach(map);
	return wire.gone ? MODULE_FAILED : MODULE_ENDED;
}
