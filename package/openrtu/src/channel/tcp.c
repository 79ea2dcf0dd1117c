/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "channel/tcp.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

/*
 * How long a peer may leave unacknowledged what it was sent, or probes of an idle connection, before the kernel gives it
 * up: else a peer without power would be noticed after a quarter of an hour.
 */
#define DEAD_PEER_MS   5000
#define KEEP_IDLE_S    5
#define KEEP_BETWEEN_S 2

struct address {
	union {
		struct sockaddr any;
		struct sockaddr_in v4;
		struct sockaddr_in6 v6;
	} as;
	socklen_t size;
};

/* The configuration has been checked: what is no IPv4 address is one of IPv6. */
static struct address address_of(const char *text, uint16_t port)
{
	struct address address = {.size = sizeof(address.as.v4)};

	address.as.v4.sin_family = AF_INET;
	address.as.v4.sin_port = htons(port);
	if (inet_pton(AF_INET, text, &address.as.v4.sin_addr) == 1)
		return address;
	address = (struct address){.size = sizeof(address.as.v6)};
	address.as.v6.sin6_family = AF_INET6;
	address.as.v6.sin6_port = htons(port);
	inet_pton(AF_INET6, text, &address.as.v6.sin6_addr);
	return address;
}

static void set(int fd, int level, int option, int value)
{
	setsockopt(fd, level, option, &value, sizeof(value));
}

/* A request is one small segment, which shall not wait for others. */
static void set_options(int fd)
{
	set(fd, IPPROTO_TCP, TCP_NODELAY, 1);
	set(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, DEAD_PEER_MS);
	set(fd, SOL_SOCKET, SO_KEEPALIVE, 1);
	set(fd, IPPROTO_TCP, TCP_KEEPIDLE, KEEP_IDLE_S);
	set(fd, IPPROTO_TCP, TCP_KEEPINTVL, KEEP_BETWEEN_S);
}

int tcp_connect(const char *text, uint16_t port, char *error)
{
	struct address address = address_of(text, port);
	int fd = socket(address.as.any.sa_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, IPPROTO_TCP);

	if (fd >= 0)
		set_options(fd);
	if (fd >= 0 && (connect(fd, &address.as.any, address.size) == 0 || errno == EINPROGRESS))
		return fd;
	snprintf(error, TCP_ERROR_SIZE, "cannot be connected: %s", strerror(errno));
	if (fd >= 0)
		close(fd);
	return -1;
}

int udp_connect(const char *text, uint16_t port, char *error)
{
	struct address address = address_of(text, port);
	int fd = socket(address.as.any.sa_family, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, IPPROTO_UDP);

	if (fd >= 0 && connect(fd, &address.as.any, address.size) == 0)
		return fd;
	snprintf(error, TCP_ERROR_SIZE, "cannot be reached: %s", strerror(errno));
	if (fd >= 0)
		close(fd);
	return -1;
}

enum tcp_state tcp_look(int fd, char *error)
{
	struct pollfd decided = {.fd = fd, .events = POLLOUT};
	int cause = 0;
	socklen_t size = sizeof(cause);

	if (poll(&decided, 1, 0) == 0)
		return TCP_PENDING;
	if (getsockopt(fd, SOL_SOCKET, SO_ERROR, &cause, &size) == 0 && cause == 0)
		return TCP_CONNECTED;
	snprintf(error, TCP_ERROR_SIZE, "cannot be connected: %s", strerror(cause != 0 ? cause : errno));
	return TCP_FAILED;
}
