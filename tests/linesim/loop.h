/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The event loop: descriptors (epoll), one deadline (timerfd), the signals that end the program. */
#ifndef LINESIM_LOOP_H
#define LINESIM_LOOP_H

#include <stdint.h>

#define LOOP_NEVER INT64_MAX

/* A descriptor to watch; lives as long as the program, fd changes. */
struct loop_source {
	int fd;
	void (*ready)(void *owner, uint32_t events);
	void *owner;
};

int64_t loop_now_ns(void); /* CLOCK_MONOTONIC */

/* -1 with errno. */
int loop_open(void);
/* events: EPOLLIN, EPOLLOUT. -1 with errno. */
int loop_add(struct loop_source *source, uint32_t events);
void loop_change(struct loop_source *source, uint32_t events);

/* Handles events until loop_stop, SIGTERM or SIGINT. advance does what is due, returns the next deadline. */
void loop_run(int64_t (*advance)(void *context, int64_t now_ns), void *context);
void loop_stop(void);

#endif
