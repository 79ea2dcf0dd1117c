/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/gps/clock.h"

#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <time.h>

#include "map/map.h"
#include "map/time_ns.h"

#define SAMPLE_MAGIC     0x534f434b /* "SOCK" */
#define SATELLITES_LEAST 3

/* chrony's refclock_sock.c; chronyd and this program have one time_t, as they are built by one toolchain. */
struct sample {
	struct timeval at; /* by the system's clock */
	double offset;     /* seconds by which the true time is ahead of it */
	int pulse;         /* 0: a whole time */
	int leap;          /* 0: nothing is known of a leap second */
	int pad;
	int magic;
};

int clock_socket(void)
{
	return socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
}

/*
 * A typed, simulated or estimated one, and one that has just stepped, is no time to follow; nor is one that a single letter of RMC
 * stands for: another sentence counts the satellites that a place takes.
 */
static bool is_of_satellites(const struct gps_fix *fix)
{
	const uint32_t needed = GPS_TIME | GPS_POSITION | GPS_SATELLITES;

	return (fix->known & needed) == needed && fix->satellites >= SATELLITES_LEAST &&
	       (fix->marks & GPS_CLOCK_STEP) == 0 && fix->method < GPS_ESTIMATED;
}

void clock_tell(int fd, const struct gps_settings *settings, const struct gps_fix *fix)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};
	struct sample sample = {.magic = SAMPLE_MAGIC};
	struct timespec now;
	int64_t arrival_ns;

	if (fd < 0 || settings->clock[0] == '\0' || !is_of_satellites(fix))
		return;
	clock_gettime(CLOCK_REALTIME, &now);
	arrival_ns = now.tv_sec * NS_PER_S + now.tv_nsec - (map_now_ns() - fix->arrival_ns);
	sample.at.tv_sec = (time_t)(arrival_ns / NS_PER_S);
	sample.at.tv_usec = (suseconds_t)(arrival_ns % NS_PER_S / 1000);
	sample.offset = (double)(fix->time_ns - arrival_ns) / NS_PER_S;
	snprintf(address.sun_path, sizeof(address.sun_path), "%s", settings->clock);
	/* Without a chronyd it goes nowhere: the next one comes in a second. */
	(void)sendto(fd, &sample, sizeof(sample), 0, (const struct sockaddr *)&address, sizeof(address));
}
