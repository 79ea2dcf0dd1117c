/* SPDX-License-Identifier: GPL-3.0-or-later */
/* timerfd: the kernel's descriptor, which nobody arms, and a time beside it. */
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/timerfd.h>

#include "client.h"

static struct timer {
	bool is_one;
	bool by_wall;
	int64_t next_ns; /* by the clock of the plant; 0: not armed */
	int64_t period_ns;
	uint32_t armings;
} timers[CLIENT_FDS];

static struct timer *timer_of(int fd)
{
	return fd >= 0 && fd < CLIENT_FDS && timers[fd].is_one ? &timers[fd] : NULL;
}

bool timer_is(int fd)
{
	return timer_of(fd) != NULL;
}

bool timer_is_due(int fd)
{
	const struct timer *timer = timer_of(fd);

	return timer && timer->next_ns && timer->next_ns <= plant->now_ns;
}

int64_t timer_next_ns(int fd)
{
	const struct timer *timer = timer_of(fd);

	return timer && timer->next_ns ? timer->next_ns : PLANT_NEVER;
}

uint32_t timer_armings(int fd)
{
	const struct timer *timer = timer_of(fd);

	return timer ? timer->armings : 0;
}

void timer_forget(int fd)
{
	if (timer_of(fd))
		timers[fd] = (struct timer){0};
}

static bool due(void *fd)
{
	return timer_is_due(*(int *)fd);
}

ssize_t timer_read(int fd, void *out, size_t size)
{
	struct timer *timer = timer_of(fd);
	uint64_t times = 1;

	if (size < sizeof(times)) {
		errno = EINVAL;
		return -1;
	}
	if (!timer_is_due(fd) && (fcntl(fd, F_GETFL) & O_NONBLOCK)) {
		errno = EAGAIN;
		return -1;
	}
	if (wait_until(due, &fd, timer_next_ns(fd)) < 0)
		return -1;
	if (timer->period_ns)
		times += (uint64_t)((plant->now_ns - timer->next_ns) / timer->period_ns);
	timer->next_ns = timer->period_ns ? timer->next_ns + (int64_t)times * timer->period_ns : 0;
	memcpy(out, &times, sizeof(times));
	return sizeof(times);
}

int timerfd_create(int clock, int flags)
{
	int fd;

	client_begin();
	fd = real.timerfd_create(clock, flags);
	if (plant && fd >= 0 && fd < CLIENT_FDS)
		timers[fd] = (struct timer){.is_one = true, .by_wall = clock == CLOCK_REALTIME};
	return fd;
}

int timerfd_gettime(int fd, struct itimerspec *out)
{
	const struct timer *timer = timer_of(fd);

	if (!timer) {
		errno = EINVAL;
		return -1;
	}
	out->it_interval = client_timespec(timer->period_ns);
	out->it_value = client_timespec(timer->next_ns > plant->now_ns ? timer->next_ns - plant->now_ns : 0);
	return 0;
}

int timerfd_settime(int fd, int flags, const struct itimerspec *new, struct itimerspec *old)
{
	struct timer *timer = timer_of(fd);
	const int64_t time_ns = client_ns(&new->it_value);
	int64_t from_ns;

	if (!timer || (old && timerfd_gettime(fd, old) < 0)) {
		errno = EINVAL;
		return -1;
	}
	from_ns = flags & TFD_TIMER_ABSTIME ? timer->by_wall ? -plant_ahead_ns(plant) : 0 : plant->now_ns;
	timer->period_ns = client_ns(&new->it_interval);
	timer->next_ns = time_ns ? from_ns + time_ns : 0;
	timer->armings++;
	return 0;
}
