/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * rtu-gps: receivers of positions, each on a serial port or behind gpsd, in one loop. A receiver's burst is published as one
 * set: nobody reads the latitude of one fix with the longitude of another.
 */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include "built.h"
#include "map/time_ns.h"
#include "modules/gps/clock.h"
#include "modules/gps/publish.h"
#include "modules/gps/source.h"
#include "process/module.h"

#define HEARTBEAT_NS (250 * NS_PER_MS) /* a quarter of what kind.c allows */

struct receiver {
	struct source source;
	struct publisher publisher;
};

static struct map *map;
static struct receiver *receivers;
static uint32_t count;
static int clock_fd = -1;

static void take(void *context, struct gps_fix *fix)
{
	const struct publisher *publisher = context;

	publisher_take(context, fix);
	clock_tell(clock_fd, publisher->settings, fix);
}

/* False: there is no memory. */
static bool set_up(const struct gps_settings *settings, struct gps_stats *stats, const char *directory)
{
	count = map_record_count(map_config(map), GPS_RECEIVERS);
	receivers = calloc(count, sizeof(*receivers));
	for (uint32_t i = 0; receivers != NULL && i < count; i++) {
		source_init(&receivers[i].source, map, &settings[i], &stats[i], directory, BUILT_DAYS);
		publisher_init(&receivers[i].publisher, map, &settings[i], &stats[i]);
	}
	return receivers != NULL;
}

static int64_t serve(void)
{
	const int64_t now_ns = map_now_ns();
	int64_t deadline_ns = now_ns + HEARTBEAT_NS;

	for (uint32_t i = 0; i < count; i++) {
		source_run(&receivers[i].source, now_ns, take, &receivers[i].publisher);
		publisher_run(&receivers[i].publisher, now_ns);
		deadline_ns = earlier(deadline_ns, source_deadline(&receivers[i].source));
		deadline_ns = earlier(deadline_ns, publisher_deadline(&receivers[i].publisher));
	}
	map_heartbeat(map); /* what became old meanwhile is told as lost before */
	return deadline_ns;
}

static int pause_ms(int64_t deadline_ns)
{
	const int64_t left_ms = (deadline_ns - map_now_ns()) / NS_PER_MS + 1;

	return left_ms < 0 ? 0 : (int)left_ms;
}

static void run(int stop)
{
	struct pollfd waits[1 + GPS_RECEIVERS_MAX] = {{.fd = stop, .events = POLLIN}};

	while (map_may_run(map) && (waits[0].revents & POLLIN) == 0) {
		const int64_t deadline_ns = serve();

		for (uint32_t i = 0; i < count; i++)
			waits[1 + i] = (struct pollfd){.fd = receivers[i].source.fd,
						       .events = source_events(&receivers[i].source)};
		poll(waits, 1 + count, pause_ms(deadline_ns));
	}
}

int main(int argc, char **argv)
{
	const struct gps_settings *settings;
	struct options options;
	struct gps_stats *stats;
	int stop;

	map = module_begin(argc, argv, &options);
	settings = gps_receivers(map_config(map));
	stats = gps_stats_of(map);
	if (settings == NULL || stats == NULL)
		return module_is_of_another_build(map);
	stop = module_stop_fd();
	if (stop < 0 || !set_up(settings, stats, options.devices)) {
		map_log(map, MAP_LOG_ERROR, "cannot start: %s", strerror(errno));
		return MODULE_FAILED;
	}
	clock_fd = clock_socket();
	if (!module_confine(map, &options, 0))
		return MODULE_FAILED;
	run(stop);
	for (uint32_t i = 0; i < count; i++)
		source_close(&receivers[i].source);
	free(receivers);
	map_detach(map);
	return MODULE_ENDED;
}
