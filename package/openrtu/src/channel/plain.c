/* SPDX-License-Identifier: GPL-3.0-or-later */
/* TCP as IEC 60870-5-104 has it: nobody is asked who he is. */
#include "channel/channel.h"

#include <errno.h>
#include <stdio.h>
#include <sys/socket.h>
#include <unistd.h>

bool channel_start(const struct channel_owner *owner)
{
	(void)owner;
	return true;
}

void channel_renew(void)
{
}

void channel_watch(int64_t now_ns)
{
	(void)now_ns;
}

enum channel_progress channel_open(struct channel *channel, int fd, const char *peer)
{
	*channel = (struct channel){.fd = fd};
	snprintf(channel->peer, sizeof(channel->peer), "%s", peer);
	return CHANNEL_READY;
}

enum channel_progress channel_handshake(struct channel *channel)
{
	(void)channel;
	return CHANNEL_READY;
}

static bool is_later(void)
{
	return errno == EAGAIN || errno == EINTR;
}

ssize_t channel_receive(struct channel *channel, uint8_t *place, size_t size)
{
	ssize_t count = read(channel->fd, place, size);

	if (count > 0)
		return count;
	return count < 0 && is_later() ? 0 : -1;
}

bool channel_pending(const struct channel *channel)
{
	(void)channel;
	return false;
}

ssize_t channel_transmit(struct channel *channel, const uint8_t *bytes, size_t size)
{
	ssize_t count = send(channel->fd, bytes, size, MSG_NOSIGNAL);

	return count < 0 && is_later() ? 0 : count;
}

bool channel_keep(struct channel *channel, int64_t now_ns)
{
	(void)channel, (void)now_ns;
	return true;
}

void channel_close(struct channel *channel)
{
	close(channel->fd);
}
