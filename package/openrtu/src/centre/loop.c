/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The loop. The stations' connections have an epoll of their own, which is looked at only while there is room for what they
 * say: a consumer that is slow stops the reading, TCP stops the stations, and their event queues are the buffer.
 */
#include "centre/loop.h"

#include <errno.h>
#include <signal.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/signalfd.h>
#include <time.h>
#include <unistd.h>

#include "centre/consumer.h"
#include "centre/say.h"
#include "centre/stations.h"
#include "map/time_ns.h"

#define READY_MAX 128 /* stations a turn, so that no flood delays the consumer */
#define DUE_MAX   128
#define SOURCES   4

enum source { SOURCE_SIGNAL, SOURCE_LISTENER, SOURCE_CONSUMER, SOURCE_STATIONS };

struct loop {
	struct centre *centre;
	int epoll, signals, listener;
	bool stations_watched, consumer_full;
	bool stop;
};

static int64_t clock_ns(clockid_t id)
{
	struct timespec time;

	clock_gettime(id, &time);
	return time.tv_sec * NS_PER_S + time.tv_nsec;
}

static void look_at_clock(struct centre *centre)
{
	centre->now = (struct iec104_moment){clock_ns(CLOCK_MONOTONIC), clock_ns(CLOCK_REALTIME)};
}

static bool watch(const struct loop *loop, int operation, int fd, enum source source, uint32_t events)
{
	struct epoll_event event = {.events = events, .data.u32 = source};

	return epoll_ctl(loop->epoll, operation, fd, &event) == 0;
}

/* All stations are told, and there is room for what they say. */
static bool stations_may_speak(const struct centre *centre)
{
	return centre->consumer >= 0 && centre->told == centre->config->station_count &&
	       centre_has_room(centre);
}

static void watch_stations(struct loop *loop)
{
	bool may = stations_may_speak(loop->centre);

	if (may != loop->stations_watched)
		watch(loop, EPOLL_CTL_MOD, loop->centre->epoll, SOURCE_STATIONS, may ? EPOLLIN : 0);
	loop->stations_watched = may;
}

static void serve_ready(struct centre *centre)
{
	struct epoll_event events[READY_MAX];
	int count = epoll_wait(centre->epoll, events, READY_MAX, 0);

	/* Who is not served now is ready in the next turn, too. */
	for (int i = 0; i < count && centre_has_room(centre); i++)
		centre_station_ready(&centre->stations[events[i].data.u32], events[i].events);
}

static void serve_due(struct centre *centre)
{
	for (unsigned i = 0; i < DUE_MAX && centre_has_room(centre); i++) {
		uint32_t station = centre_deadlines_first(&centre->deadlines);

		if (centre->deadlines.due_ns[station] > centre->now.monotonic_ns)
			return;
		centre_station_due(&centre->stations[station]);
	}
}

static void serve_stations(struct centre *centre)
{
	while (centre->consumer >= 0 && centre_has_room(centre) && centre_tell_next(centre))
		;
	if (!stations_may_speak(centre))
		return;
	serve_ready(centre);
	serve_due(centre);
	while (centre_has_room(centre) && centre_admit_next(centre))
		;
}

static void accept_consumer(struct loop *loop)
{
	if (centre_consumer_accept(loop->centre, loop->listener))
		watch(loop, EPOLL_CTL_ADD, loop->centre->consumer, SOURCE_CONSUMER, EPOLLIN);
	loop->consumer_full = false;
}

static void flush(struct loop *loop)
{
	bool full = centre_consumer_flush(loop->centre);

	if (loop->centre->consumer >= 0 && full != loop->consumer_full)
		watch(loop, EPOLL_CTL_MOD, loop->centre->consumer, SOURCE_CONSUMER,
		      EPOLLIN | (full ? EPOLLOUT : 0u));
	loop->consumer_full = full;
}

static int wait_ms(const struct centre *centre)
{
	int64_t due_ns = centre->deadlines.due_ns[centre_deadlines_first(&centre->deadlines)];
	int64_t left_ns = due_ns - centre->now.monotonic_ns;

	if (!stations_may_speak(centre) || due_ns == INT64_MAX)
		return CENTRE_TURN_MAX_MS;
	if (left_ns <= 0)
		return 0;
	return (int)earlier(left_ns / NS_PER_MS + 1, CENTRE_TURN_MAX_MS);
}

static void serve(struct loop *loop, enum source source)
{
	switch (source) {
	case SOURCE_SIGNAL:
		loop->stop = true;
		break;
	case SOURCE_LISTENER:
		accept_consumer(loop);
		break;
	case SOURCE_CONSUMER:
		if (loop->centre->consumer >= 0)
			centre_consumer_receive(loop->centre);
		break;
	case SOURCE_STATIONS:
		break; /* serve_stations */
	}
}

static void turn(struct loop *loop)
{
	struct epoll_event events[SOURCES];
	int count = epoll_wait(loop->epoll, events, SOURCES, wait_ms(loop->centre));

	look_at_clock(loop->centre);
	channel_watch(loop->centre->now.monotonic_ns);
	for (int i = 0; i < count; i++)
		serve(loop, events[i].data.u32);
	serve_stations(loop->centre);
	flush(loop);
	watch_stations(loop);
}

static bool open_loop(struct loop *loop)
{
	sigset_t signals;

	sigemptyset(&signals);
	sigaddset(&signals, SIGTERM);
	sigaddset(&signals, SIGINT);
	sigprocmask(SIG_BLOCK, &signals, NULL);
	signal(SIGHUP, SIG_IGN);
	loop->epoll = epoll_create1(EPOLL_CLOEXEC);
	loop->signals = signalfd(-1, &signals, SFD_CLOEXEC | SFD_NONBLOCK);
	return loop->epoll >= 0 && loop->signals >= 0 &&
	       watch(loop, EPOLL_CTL_ADD, loop->signals, SOURCE_SIGNAL, EPOLLIN) &&
	       watch(loop, EPOLL_CTL_ADD, loop->listener, SOURCE_LISTENER, EPOLLIN) &&
	       watch(loop, EPOLL_CTL_ADD, loop->centre->epoll, SOURCE_STATIONS, 0);
}

int centre_loop(struct centre *centre, int listener, const char *path, atomic_uint *turns)
{
	struct loop loop = {.centre = centre, .listener = listener};

	if (!open_loop(&loop)) {
		fprintf(stderr, "rtu-centre: cannot wait for events: %s\n", strerror(errno));
		return 1;
	}
	fprintf(stderr, "rtu-centre: waits for a consumer on %s\n", path);
	for (look_at_clock(centre); !loop.stop; atomic_fetch_add_explicit(turns, 1, memory_order_relaxed))
		turn(&loop);
	centre_consumer_drop(centre, "rtu-centre ends");
	close(loop.signals);
	close(loop.epoll);
	return 0;
}
