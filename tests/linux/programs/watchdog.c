/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * watchdog SECONDS feed|leave|stop: starts the watchdog, asks for a time-out and writes which it has. Then feeds it
 * twice a second for ever, leaves it running as a program does that dies, or stops it.
 */
#include <fcntl.h>
#include <linux/watchdog.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

static void feed(int fd)
{
	for (;;) {
		ioctl(fd, WDIOC_KEEPALIVE, 0);
		usleep(500000);
	}
}

int main(int argc, char **argv)
{
	int fd = open("/dev/watchdog0", O_WRONLY);
	int seconds = argc == 3 ? atoi(argv[1]) : 0;

	if (fd < 0 || ioctl(fd, WDIOC_SETTIMEOUT, &seconds) < 0) {
		perror("/dev/watchdog0");
		return 1;
	}
	printf("%d\n", seconds);
	fflush(stdout);
	if (strcmp(argv[2], "feed") == 0)
		feed(fd);
	return strcmp(argv[2], "stop") == 0 && write(fd, "V", 1) != 1;
}
