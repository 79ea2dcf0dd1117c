/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * UDP between the plant's processes, over Unix sockets as TCP is: a datagram is there at once and whole. One that nobody waits
 * for, or that finds no room, is lost; so is one to or from a port that is cut.
 */
#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/un.h>

#include "client.h"

static bool is_datagram(int fd)
{
	int type = 0;
	socklen_t size = sizeof(type);

	return real.getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) == 0 && type == SOCK_DGRAM;
}

enum kind { KIND_UNKNOWN, KIND_OTHER, KIND_UDP };
static enum kind kinds[CLIENT_FDS];

void datagrams_made(int fd)
{
	if (fd >= 0 && fd < CLIENT_FDS)
		kinds[fd] = KIND_UDP;
}

void datagrams_forget(int fd)
{
	if (fd >= 0 && fd < CLIENT_FDS)
		kinds[fd] = KIND_UNKNOWN;
}

/* One that another process has opened has its name. */
bool datagrams_is(int fd)
{
	if (fd < 0 || fd >= CLIENT_FDS)
		return false;
	if (kinds[fd] == KIND_UNKNOWN)
		kinds[fd] = is_datagram(fd) && network_port(fd) ? KIND_UDP : KIND_OTHER;
	return kinds[fd] == KIND_UDP;
}

static ssize_t whole_size(const struct msghdr *message)
{
	size_t size = 0;

	for (size_t i = 0; i < message->msg_iovlen; i++)
		size += message->msg_iov[i].iov_len;
	return (ssize_t)size;
}

ssize_t datagrams_send(int fd, const struct msghdr *message, int flags)
{
	struct msghdr sent = *message;
	struct sockaddr_un name;
	ssize_t size;

	if (!network_port(fd) && !network_take_port(fd))
		return -1;
	sent.msg_control = NULL; /* which of the addresses it leaves from: there is one */
	sent.msg_controllen = 0;
	if (message->msg_name) {
		sent.msg_namelen = network_name(message->msg_name, &name);
		sent.msg_name = &name;
	}
	if (network_is_cut_off(fd, message->msg_name))
		return whole_size(message);
	size = real.sendmsg(fd, &sent, flags | MSG_DONTWAIT);
	return size < 0 && (errno == ECONNREFUSED || errno == EAGAIN) ? whole_size(message) : size;
}

ssize_t datagrams_receive(int fd, struct msghdr *message, int flags)
{
	struct msghdr taken = *message;
	struct sockaddr_un name;
	ssize_t size;

	taken.msg_name = &name;
	taken.msg_namelen = sizeof(name);
	taken.msg_control = NULL;
	taken.msg_controllen = 0;
	size = real.recvmsg(fd, &taken, flags);
	if (size < 0)
		return size;
	network_put_sender(&name, taken.msg_namelen, message->msg_name, &message->msg_namelen);
	message->msg_controllen = 0;
	message->msg_flags = taken.msg_flags;
	return size;
}
