/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "channel/bare.h"

#include <errno.h>
#include <stdbool.h>
#include <sys/socket.h>
#include <unistd.h>

static bool is_later(void)
{
	return errno == EAGAIN || errno == EINTR;
}

ssize_t bare_receive(int fd, uint8_t *place, size_t size)
{
	ssize_t count = read(fd, place, size);

	if (count > 0)
		return count;
	return count < 0 && is_later() ? 0 : -1;
}

ssize_t bare_transmit(int fd, const uint8_t *bytes, size_t size)
{
	ssize_t count = send(fd, bytes, size, MSG_NOSIGNAL);

	return count < 0 && is_later() ? 0 : count;
}
