/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What time it is, and random numbers: the plant's. */
#include <errno.h>
#include <string.h>
#include <sys/random.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/timex.h>

#include "client.h"

#define LEAP_TOLD_NS (3600 * PLANT_NS)
#define LEAP_OVER_NS (60 * PLANT_NS)

static struct timespec read_clock(clockid_t clock)
{
	const bool wall = clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE || clock == CLOCK_TAI;

	client_begin();
	if (!plant) {
		struct timespec now;

		real_find();
		real_syscall(SYS_clock_gettime, clock, (long)&now, 0, 0, 0, 0);
		return now;
	}
	client_spin();
	return client_timespec(plant->now_ns + (wall ? plant_ahead_ns(plant) : 0));
}

int clock_gettime(clockid_t clock, struct timespec *out)
{
	*out = read_clock(clock);
	return 0;
}

time_t time(time_t *out)
{
	const time_t now = read_clock(CLOCK_REALTIME).tv_sec;

	if (out)
		*out = now;
	return now;
}

int gettimeofday(struct timeval *restrict out, void *restrict zone)
{
	const struct timespec now = read_clock(CLOCK_REALTIME);

	(void)zone;
	*out = (struct timeval){.tv_sec = now.tv_sec, .tv_usec = now.tv_nsec / 1000};
	return 0;
}

int clock_settime(clockid_t clock, const struct timespec *now)
{
	client_begin();
	if (!plant || clock != CLOCK_REALTIME) {
		errno = EPERM;
		return -1;
	}
	client_call();
	plant->wall_ns += client_ns(now) - plant->now_ns - plant_ahead_ns(plant);
	client_changes();
	client_tell("clock_settime");
	return 0;
}

/* As the kernel tells of the leap second next to now: from an hour before until it clears what was asked of it. */
static int leap_state(void)
{
	for (uint32_t i = 0; plant && i < plant->step_count; i++) {
		const struct plant_step *step = &plant->steps[i];
		const int64_t since_ns = plant->now_ns - step->at_ns;

		if (!step->leap || since_ns < -LEAP_TOLD_NS || since_ns >= LEAP_OVER_NS)
			continue;
		if (since_ns < 0)
			return step->by_ns < 0 ? TIME_INS : TIME_DEL;
		return step->by_ns < 0 && since_ns < PLANT_NS ? TIME_OOP : TIME_WAIT;
	}
	return TIME_OK;
}

/* A clock that somebody keeps right, on each host. */
int adjtimex(struct timex *out)
{
	const struct timespec now = read_clock(CLOCK_REALTIME);

	memset(out, 0, sizeof(*out));
	out->status = STA_NANO;
	out->tick = 10000;
	out->time = (struct timeval){.tv_sec = now.tv_sec, .tv_usec = now.tv_nsec};
	return leap_state();
}

ssize_t getrandom(void *out, size_t size, unsigned flags)
{
	uint8_t *octets = out;

	client_begin();
	if (!plant)
		return real_syscall(SYS_getrandom, (long)out, (long)size, flags, 0, 0, 0);
	for (size_t i = 0; i < size; i++)
		octets[i] = (uint8_t)plant_random(plant);
	return (ssize_t)size;
}
