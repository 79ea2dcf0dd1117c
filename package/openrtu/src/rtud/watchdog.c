/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/watchdog.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/watchdog.h>
#include <sys/ioctl.h>
#include <unistd.h>

/* A close without it leaves the watchdog running: that of a killed rtud. */
#define MAGIC_CLOSE "V"

/* A request is a number of 32 bits, whichever integer a C library takes for it. */
static int ask(int fd, unsigned int request, int *value)
{
	return ioctl(fd, request, value);
}

static int set_timeout(int fd, int *timeout_s)
{
	*timeout_s = WATCHDOG_ASKED_S;
	if (ask(fd, WDIOC_SETTIMEOUT, timeout_s) == 0)
		return 0;
	return ask(fd, WDIOC_GETTIMEOUT, timeout_s);
}

/* What has no time-out is no watchdog: nothing is written to it. */
int watchdog_open(const char *device, int *timeout_s)
{
	int fd = open(device, O_WRONLY | O_CLOEXEC);
	int reason;

	if (fd < 0 || set_timeout(fd, timeout_s) == 0)
		return fd;
	reason = errno;
	close(fd);
	errno = reason;
	return -1;
}

void watchdog_feed(int fd)
{
	ask(fd, WDIOC_KEEPALIVE, NULL);
}

void watchdog_stop(int fd)
{
	while (write(fd, MAGIC_CLOSE, 1) < 0 && errno == EINTR)
		;
	close(fd);
}
