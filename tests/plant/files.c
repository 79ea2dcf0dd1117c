/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Reading and writing what others see, closing it. Files of a disk are read and written as ever. */
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <termios.h>
#include <unistd.h>

#include "client.h"

#define TERMINALS_FROM 136 /* majors of the kernel's pseudo-terminals */
#define TERMINALS_TO   143

static enum fd_kind kind_of_character(dev_t device)
{
	const bool is_terminal = (major(device) >= TERMINALS_FROM && major(device) <= TERMINALS_TO) ||
				 device == makedev(5, 2); /* /dev/ptmx */

	return is_terminal ? FD_TERMINAL : FD_FILE;
}

/* Of sockets and terminals, which nothing closes but close(): the kernel is asked once. FD_FILE: it is asked. */
static enum fd_kind known_kinds[CLIENT_FDS];

static enum fd_kind look_at_kind(int fd)
{
	const int error = errno;
	struct stat status;
	const int result = fstat(fd, &status);

	errno = error;
	if (result < 0 || S_ISREG(status.st_mode) || S_ISDIR(status.st_mode) || S_ISBLK(status.st_mode))
		return FD_FILE;
	if (S_ISSOCK(status.st_mode))
		return FD_SOCKET;
	return S_ISCHR(status.st_mode) ? kind_of_character(status.st_rdev) : FD_OTHER;
}

enum fd_kind files_kind(int fd)
{
	enum fd_kind kind;

	if (fd < 0 || fd >= CLIENT_FDS)
		return look_at_kind(fd);
	if (timer_is(fd))
		return FD_OTHER;
	if (known_kinds[fd] != FD_FILE)
		return known_kinds[fd];
	kind = look_at_kind(fd);
	if (kind == FD_SOCKET || kind == FD_TERMINAL)
		known_kinds[fd] = kind;
	return kind;
}

/* FNV-1a: a trace that is the same tells that the octets are. Those of a pipe are none of others': rtud's filters name its pid. */
static uint32_t hash_of(const void *octets, size_t size)
{
	const uint8_t *octet = octets;
	uint32_t hash = 2166136261u;

	while (size--)
		hash = (hash ^ *octet++) * 16777619u;
	return hash;
}

static void tell_octets(const char *name, int fd, enum fd_kind kind, const void *octets, ssize_t size,
			int error)
{
	if (size < 0)
		client_tell("%s %d -%d", name, fd, error);
	else if (kind == FD_SOCKET || kind == FD_TERMINAL)
		client_tell("%s %d %zd %08x", name, fd, size, hash_of(octets, (size_t)size));
	else
		client_tell("%s %d %zd", name, fd, size);
}

static bool somebody_wants_room(void)
{
	for (uint32_t i = 0; i < plant->process_count; i++)
		if (plant->processes[i].alive && plant->processes[i].wants_room)
			return true;
	return false;
}

/* Before something comes in: false with errno. */
static bool may_take(int fd)
{
	if (wait_blocking(fd, POLLIN) < 0)
		return false;
	if (!network_is_cut(fd))
		return true;
	errno = EAGAIN;
	return false;
}

static ssize_t took(const char *name, int fd, enum fd_kind kind, const void *octets, ssize_t size)
{
	const int error = errno;

	if (size > 0 && somebody_wants_room())
		client_changes();
	tell_octets(name, fd, kind, octets, size, error);
	errno = error;
	return size;
}

static ssize_t gave(const char *name, int fd, enum fd_kind kind, const void *octets, ssize_t size)
{
	const int error = errno;

	if (size > 0)
		client_changes();
	tell_octets(name, fd, kind, octets, size, error);
	errno = error;
	return size;
}

static bool has_more(int fd)
{
	struct pollfd asked = {.fd = fd, .events = POLLIN};

	return real.poll(&asked, 1, 0) == 1 && asked.revents & POLLIN;
}

/*
 * What was written to a terminal comes to its other end in pieces, by a worker of the kernel. Who asks while nothing is there
 * gets all of it: so all that was written is read at once, and never a part that depends on the host's load.
 */
static ssize_t read_terminal(int fd, uint8_t *out, size_t size)
{
	ssize_t got = real.read(fd, out, size);

	while (got > 0 && (size_t)got < size && has_more(fd)) {
		const ssize_t more = real.read(fd, out + got, size - (size_t)got);

		if (more <= 0)
			break;
		got += more;
	}
	return got;
}

/* False with errno: nothing is there yet. */
static bool limit_to_arrived(int fd, size_t *size)
{
	const size_t arrived = network_arrived(fd, *size);

	errno = EAGAIN;
	if (!arrived && *size)
		return false;
	*size = arrived;
	return true;
}

static ssize_t take_arrived(int fd, void *out, size_t size)
{
	ssize_t got;

	if (!limit_to_arrived(fd, &size))
		return -1;
	got = real.read(fd, out, size);
	network_took(fd, got);
	return got;
}

static ssize_t take(int fd, enum fd_kind kind, void *out, size_t size)
{
	if (timer_is(fd))
		return timer_read(fd, out, size);
	if (!may_take(fd))
		return -1;
	if (kind == FD_TERMINAL)
		return read_terminal(fd, out, size);
	return kind == FD_SOCKET ? take_arrived(fd, out, size) : real.read(fd, out, size);
}

ssize_t read(int fd, void *out, size_t size)
{
	enum fd_kind kind;

	client_begin();
	kind = plant ? files_kind(fd) : FD_FILE;
	if (kind == FD_FILE)
		return disk_gives_nothing(fd) ? -1 : real.read(fd, out, size);
	client_call();
	return took("read", fd, kind, out, take(fd, kind, out, size));
}

ssize_t __read_chk(int fd, void *out, size_t size, size_t room);
ssize_t __read_chk(int fd, void *out, size_t size, size_t room)
{
	if (size > room)
		abort();
	return read(fd, out, size);
}

static ssize_t give(int fd, const void *octets, size_t size)
{
	ssize_t result;

	if (network_is_lost(fd))
		return (ssize_t)size;
	result = real.write(fd, octets, size);
	network_sent(fd, result);
	return result;
}

ssize_t write(int fd, const void *octets, size_t size)
{
	enum fd_kind kind;
	ssize_t written;

	client_begin();
	kind = plant ? files_kind(fd) : FD_FILE;
	if (kind == FD_FILE)
		return disk_writes(fd, octets, size, &written) ? written : real.write(fd, octets, size);
	client_call();
	if (wait_blocking(fd, POLLOUT) < 0)
		return -1;
	return gave("write", fd, kind, octets, give(fd, octets, size));
}

/* Without waiting: false with errno. */
static bool may_take_now(int fd)
{
	if (!network_is_cut(fd))
		return true;
	errno = EAGAIN;
	return false;
}

static ssize_t receive_datagram(int fd, void *out, size_t size, int flags, struct sockaddr *address,
				socklen_t *address_size)
{
	struct iovec octets = {.iov_base = out, .iov_len = size};
	struct msghdr message = {.msg_iov = &octets, .msg_iovlen = 1};
	ssize_t got;

	message.msg_name = address_size ? address : NULL;
	message.msg_namelen = address_size ? *address_size : 0;
	got = datagrams_receive(fd, &message, flags);
	if (got >= 0 && address_size)
		*address_size = message.msg_namelen;
	return got;
}

static ssize_t receive(int fd, void *out, size_t size, int flags, struct sockaddr *address,
		       socklen_t *address_size)
{
	ssize_t got;

	if (!(flags & MSG_DONTWAIT ? may_take_now(fd) : may_take(fd)) || !limit_to_arrived(fd, &size))
		return -1;
	if (datagrams_is(fd))
		return receive_datagram(fd, out, size, flags, address, address_size);
	got = real.recvfrom(fd, out, size, flags, address, address_size);
	network_took(fd, got);
	return got;
}

ssize_t recvfrom(int fd, void *restrict out, size_t size, int flags, struct sockaddr *restrict address,
		 socklen_t *restrict address_size)
{
	if (!plant)
		return real.recvfrom(fd, out, size, flags, address, address_size);
	client_call();
	return took("recv", fd, FD_SOCKET, out, receive(fd, out, size, flags, address, address_size));
}

ssize_t recv(int fd, void *out, size_t size, int flags)
{
	return recvfrom(fd, out, size, flags, NULL, NULL);
}

ssize_t __recv_chk(int fd, void *out, size_t size, size_t room, int flags);
ssize_t __recv_chk(int fd, void *out, size_t size, size_t room, int flags)
{
	if (size > room)
		abort();
	return recv(fd, out, size, flags);
}

static ssize_t send_datagram(int fd, const void *octets, size_t size, int flags,
			     const struct sockaddr *address, socklen_t address_size)
{
	struct iovec part = {.iov_base = (void *)(uintptr_t)octets, .iov_len = size};
	const struct msghdr message = {.msg_name = (void *)(uintptr_t)address,
				       .msg_namelen = address_size,
				       .msg_iov = &part,
				       .msg_iovlen = 1};

	return datagrams_send(fd, &message, flags);
}

static ssize_t send_on(int fd, const void *octets, size_t size, int flags, const struct sockaddr *address,
		       socklen_t address_size)
{
	ssize_t result;

	if (packets_tap(fd))
		return packets_send(fd, octets, size);
	if (datagrams_is(fd))
		return send_datagram(fd, octets, size, flags, address, address_size);
	if (network_is_lost(fd))
		return (ssize_t)size;
	result = real.sendto(fd, octets, size, flags, address, address_size);
	network_sent(fd, result);
	return result;
}

ssize_t sendto(int fd, const void *octets, size_t size, int flags, const struct sockaddr *address,
	       socklen_t address_size)
{
	if (!plant)
		return real.sendto(fd, octets, size, flags, address, address_size);
	client_call();
	if (!(flags & MSG_DONTWAIT) && wait_blocking(fd, POLLOUT) < 0)
		return -1;
	return gave("send", fd, FD_SOCKET, octets, send_on(fd, octets, size, flags, address, address_size));
}

ssize_t send(int fd, const void *octets, size_t size, int flags)
{
	return sendto(fd, octets, size, flags, NULL, 0);
}

/* In the trace a datagram has its first part. */
static const void *first_part(const struct msghdr *message, ssize_t size)
{
	return size >= 0 && message->msg_iovlen > 0 && message->msg_iov->iov_len >= (size_t)size
		   ? message->msg_iov->iov_base
		   : NULL;
}

ssize_t recvmsg(int fd, struct msghdr *message, int flags)
{
	ssize_t got;

	if (!plant)
		return real.recvmsg(fd, message, flags);
	client_call();
	if (!datagrams_is(fd))
		return took("recvmsg", fd, FD_OTHER, NULL,
			    may_take(fd) ? real.recvmsg(fd, message, flags) : -1);
	got = may_take(fd) ? datagrams_receive(fd, message, flags) : -1;
	return took("recvmsg", fd, first_part(message, got) ? FD_SOCKET : FD_OTHER, first_part(message, got),
		    got);
}

ssize_t sendmsg(int fd, const struct msghdr *message, int flags)
{
	ssize_t sent;

	if (!plant)
		return real.sendmsg(fd, message, flags);
	client_call();
	if (wait_blocking(fd, POLLOUT) < 0)
		return -1;
	if (!datagrams_is(fd))
		return gave("sendmsg", fd, FD_OTHER, NULL, real.sendmsg(fd, message, flags));
	sent = datagrams_send(fd, message, flags);
	return gave("sendmsg", fd, first_part(message, sent) ? FD_SOCKET : FD_OTHER,
		    first_part(message, sent), sent);
}

/* ---- closing ----------------------------------------------------------------------------- */

static void forget(int fd)
{
	epoll_forget(fd);
	timer_forget(fd);
	network_forget(fd);
	disk_forget(fd);
	datagrams_forget(fd);
	packets_forget(fd);
	if (fd >= 0 && fd < CLIENT_FDS)
		known_kinds[fd] = FD_FILE;
}

void files_forget(unsigned first, unsigned last)
{
	for (unsigned fd = first; fd <= last && fd < CLIENT_FDS; fd++)
		forget((int)fd);
	client_changes();
}

int close(int fd)
{
	enum fd_kind kind;

	client_begin();
	if (!plant)
		return real.close(fd);
	kind = files_kind(fd);
	network_close(fd);
	forget(fd);
	if (kind != FD_FILE) {
		client_call();
		client_tell("close %d", fd);
		client_changes();
	}
	return real.close(fd);
}

int dup2(int from, int to)
{
	client_begin();
	if (plant && from != to)
		files_forget((unsigned)to, (unsigned)to);
	return real.dup2(from, to);
}

/* ---- terminals --------------------------------------------------------------------------- */

/* Also what was written at its other end and is still on its way here. */
static void drop_input(int fd)
{
	uint8_t dropped[256];

	while (has_more(fd) && real.read(fd, dropped, sizeof(dropped)) > 0)
		continue;
}

/*
 * What was written has left. The kernel would drop of it what its worker has not yet brought to the other end: that depends on the
 * host's load.
 */
static int flush_terminal(int fd, intptr_t queue)
{
	if (queue != TCOFLUSH)
		drop_input(fd);
	return 0;
}

int ioctl(int fd, unsigned long request, ...)
{
	va_list arguments;
	void *argument;

	va_start(arguments, request);
	argument = va_arg(arguments, void *);
	va_end(arguments);
	client_begin();
	if (plant && packets_control(request, argument))
		return 0;
	if (plant && files_kind(fd) == FD_TERMINAL) {
		client_call();
		client_changes();
		client_tell("ioctl %d %lx", fd, request);
		if (request == TCFLSH)
			return flush_terminal(fd, (intptr_t)argument);
	}
	return real.ioctl(fd, request, argument);
}

int tcflush(int fd, int queue)
{
	client_begin();
	if (!plant)
		return real.tcflush(fd, queue);
	return ioctl(fd, TCFLSH, (long)queue);
}
