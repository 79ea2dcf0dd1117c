/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/octets.h"

#include <sys/epoll.h>

bool iec104_receive(struct channel *channel, struct iec104_session *session)
{
	size_t room;
	uint8_t *place = iec104_session_space(session, &room);
	ssize_t count;

	if (room == 0)
		return false;
	count = channel_receive(channel, place, room);
	if (count > 0)
		iec104_session_received(session, (size_t)count);
	else if (count < 0)
		iec104_session_close(session, IEC104_CLOSED_BY_PEER);
	return count > 0;
}

bool iec104_transmit(struct channel *channel, struct iec104_session *session)
{
	size_t size;
	const uint8_t *bytes = iec104_session_output(session, &size);
	ssize_t count;

	if (size == 0)
		return false;
	count = channel_transmit(channel, bytes, size);
	if (count > 0)
		iec104_session_written(session, (size_t)count);
	else if (count < 0)
		iec104_session_close(session, IEC104_CLOSED_BY_PEER);
	return count > 0;
}

uint32_t iec104_interest(const struct channel *channel, struct iec104_session *session)
{
	uint32_t interest = 0;
	size_t size;

	if (channel->wants != 0) /* first; input waits, and would wake the loop for nothing */
		return channel->wants;
	iec104_session_space(session, &size);
	if (size > 0)
		interest |= EPOLLIN;
	iec104_session_output(session, &size);
	if (size > 0)
		interest |= EPOLLOUT;
	return interest;
}
