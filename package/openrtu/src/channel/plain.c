/* SPDX-License-Identifier: GPL-3.0-or-later */
/* TCP as it is: nobody is asked who he is. */
#include "channel/channel.h"

#include <stdio.h>
#include <unistd.h>

#include "channel/bare.h"

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

enum channel_progress channel_connect(struct channel *channel, int fd, const char *peer, bool secure,
				      struct channel_station *station)
{
	(void)station;
	channel_open(channel, fd, peer);
	return secure ? CHANNEL_REFUSED : CHANNEL_READY;
}

void channel_forget(struct channel_station *station)
{
	(void)station;
}

enum channel_progress channel_handshake(struct channel *channel)
{
	(void)channel;
	return CHANNEL_READY;
}

ssize_t channel_receive(struct channel *channel, uint8_t *place, size_t size)
{
	return bare_receive(channel->fd, place, size);
}

bool channel_pending(const struct channel *channel)
{
	(void)channel;
	return false;
}

ssize_t channel_transmit(struct channel *channel, const uint8_t *bytes, size_t size)
{
	return bare_transmit(channel->fd, bytes, size);
}

void channel_name(const struct channel *channel, char name[CHANNEL_NAME_SIZE])
{
	(void)channel;
	name[0] = '\0';
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
