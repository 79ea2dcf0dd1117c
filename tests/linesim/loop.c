/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "loop.h"

#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <sys/epoll.h>
#include <sys/signalfd.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#define EVENTS_AT_ONCE 32

static int epoll_fd = -1;
static bool stopped;
static struct loop_source timer, signals;

int64_t loop_now_ns(void)
{
	struct timespec now;

	clock_gettime(CLOCK_MONOTONIC, &now);
	return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

int loop_add(struct loop_source *source, uint32_t events)
{
	struct epoll_event event = {.events = events, .data.ptr = source};

	return epoll_ctl(epoll_fd, EPOLL_CTL_ADD, source->fd, &event);
}

void loop_change(struct loop_source *source, uint32_t events)
{
	struct epoll_event event = {.events = events, .data.ptr = source};

	epoll_ctl(epoll_fd, EPOLL_CTL_MOD, source->fd, &event);
}

/* The deadline itself is looked at after every round: only the descriptor must become quiet. */
static void timer_ready(void *owner, uint32_t events)
{
	uint64_t expirations;

	(void)owner;
	(void)events;
	(void)!read(timer.fd, &expirations, sizeof expirations);
}

static void signal_ready(void *owner, uint32_t events)
{
	(void)owner;
	(void)events;
	stopped = true;
}

int loop_open(void)
{
	sigset_t ending;

	sigemptyset(&ending);
	sigaddset(&ending, SIGTERM);
	sigaddset(&ending, SIGINT);
	sigprocmask(SIG_BLOCK, &ending, NULL);
	signal(SIGPIPE, SIG_IGN);

	epoll_fd = epoll_create1(EPOLL_CLOEXEC);
	timer = (struct loop_source){
	    .fd = timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC | TFD_NONBLOCK),
	    .ready = timer_ready,
	};
	signals = (struct loop_source){.fd = signalfd(-1, &ending, SFD_CLOEXEC), .ready = signal_ready};
	return loop_add(&timer, EPOLLIN) || loop_add(&signals, EPOLLIN) ? -1 : 0;
}

static void set_timer(int64_t deadline_ns)
{
	struct itimerspec when = {0};

	if (deadline_ns != LOOP_NEVER) {
		when.it_value.tv_sec = (time_t)(deadline_ns / 1000000000);
		when.it_value.tv_nsec = (long)(deadline_ns % 1000000000);
	}
	timerfd_settime(timer.fd, TFD_TIMER_ABSTIME, &when, NULL);
}

void loop_run(int64_t (*advance)(void *context, int64_t now_ns), void *context)
{
	struct epoll_event events[EVENTS_AT_ONCE];

	while (!stopped) {
		set_timer(advance(context, loop_now_ns()));

		const int count = epoll_wait(epoll_fd, events, EVENTS_AT_ONCE, -1);

		for (int i = 0; i < count; i++) {
			const struct loop_source *source = events[i].data.ptr;

			source->ready(source->owner, events[i].events);
		}
	}
}

void loop_stop(void)
{
	stopped = true;
}
