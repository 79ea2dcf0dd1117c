/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * rtu-goose: points of the map as GOOSE messages, and messages of others as points. One loop on one socket, which rtud has bound
 * to the interface. Nothing is allocated once it runs.
 */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include "goose/pace.h"
#include "modules/goose/flood.h"
#include "modules/goose/publish.h"
#include "modules/goose/subscribe.h"
#include "modules/goose/wire.h"
#include "process/module.h"

#define HEARTBEAT_NS  (250 * NS_PER_MS) /* a quarter of what kind.c allows */
#define AWAY_NS       NS_PER_S          /* no turn is so long that was not stopped */
#define FRAMES_A_TURN 32

enum { STOP, BELL, WIRE, WAITS };

static struct map *map;
static struct goose_stats *stats;
static struct wire wire;
static struct goose_pace rings;

static bool was_away(int64_t read_ns, int64_t now_ns)
{
	return read_ns != 0 && now_ns - read_ns > AWAY_NS;
}

/*
 * The clock is read behind each: who was stopped before it would take what came later as of then. What waited for who was stopped
 * may have come right behind what was read before.
 */
static void receive(void)
{
	static int64_t read_ns; /* then all was read that had come */
	uint8_t frame[GOOSE_FRAME_MAX];
	size_t size = 1;
	int64_t now_ns = map_now_ns();

	for (unsigned i = 0; i < FRAMES_A_TURN && (size = wire_receive(&wire, frame)) != 0; i++) {
		now_ns = map_now_ns();
		map_count(&stats->frames, 1);
		if (flood_admits(frame, size, now_ns))
			subscribe_take(frame, size, now_ns, was_away(read_ns, now_ns) ? read_ns : now_ns);
	}
	if (size == 0 || !was_away(read_ns, now_ns))
		read_ns = now_ns;
}

/* Returns when there is more to do. */
static int64_t serve(void)
{
	static int64_t heartbeat_ns;
	const int64_t now_ns = map_now_ns();

	if (map_bell_clear(map))
		goose_pace_take(&rings, now_ns);
	flood_run(now_ns);
	receive();
	subscribe_run(now_ns);
	publish_run(&wire, now_ns);
	if (now_ns >= heartbeat_ns) { /* what became old meanwhile is told so before */
		heartbeat_ns = now_ns + HEARTBEAT_NS;
		map_heartbeat(map);
		wire_count_overrun(&wire);
	}
	return earlier(earlier(heartbeat_ns, flood_deadline()),
		       earlier(publish_deadline(), subscribe_deadline()));
}

static struct timespec pause_until(int64_t deadline_ns, int64_t now_ns)
{
	const int64_t left_ns = deadline_ns > now_ns ? deadline_ns - now_ns : 0;

	return (struct timespec){.tv_sec = left_ns / NS_PER_S, .tv_nsec = (long)(left_ns % NS_PER_S)};
}

/* Whoever rings without end is heard once a millisecond: what was left in between is there in one go. */
static void wait_for_work(struct pollfd waits[WAITS], int64_t deadline_ns)
{
	const int64_t now_ns = map_now_ns();
	const bool hears = goose_pace_may(&rings, now_ns);
	const struct timespec pause =
	    pause_until(hears ? deadline_ns : earlier(deadline_ns, goose_pace_free(&rings)), now_ns);

	waits[BELL].fd = hears ? map_bell_fd(map) : -1;
	ppoll(waits, WAITS, &pause, NULL);
}

static void run(int stop)
{
	struct pollfd waits[WAITS] = {
	    [STOP] = {.fd = stop, .events = POLLIN},
	    [BELL] = {.events = POLLIN},
	    [WIRE] = {.fd = wire.fd, .events = POLLIN},
	};

	while (map_may_run(map) && (waits[STOP].revents & POLLIN) == 0 && !wire.gone)
		wait_for_work(waits, serve());
}

static void name_own_counters(void)
{
	map_name_counter(map, &stats->frames, "frames");
	map_name_counter(map, &stats->damaged, "damaged");
	map_name_counter(map, &stats->unknown, "unknown");
	map_name_counter(map, &stats->failures, "failures");
	map_name_counter(map, &stats->overrun, "overrun");
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
	flood_begin(&wire);
	if (!module_confine(map, &options, 0))
		return MODULE_FAILED;
	run(stop);
	publish_end();
	map_detach(map);
	return wire.gone ? MODULE_FAILED : MODULE_ENDED;
}
