/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * An Ethernet between the plant's processes: one interface, whose frames each packet socket has that is bound, but for its own. A
 * Unix socket stands in for each; the kernel applies its filter. Frames find no way while the port of the cable is cut.
 */
#include <arpa/inet.h>
#include <errno.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/uio.h>
#include <sys/un.h>

#include "client.h"

#define INTERFACE "plant0"
#define INDEX     1
#define NAME      "plant-%u|%u"
#define ADDRESSES 12 /* octets before the type, or before the tag */
#define TAG       4
#define HARDWARE(n)                                                                                          \
	{                                                                                                    \
		0x02, 0, 0, 0, 0, (unsigned char)(n)                                                         \
	}

static socklen_t put_name(struct sockaddr_un *name, uint32_t tap)
{
	*name = (struct sockaddr_un){.sun_family = AF_UNIX};
	return (socklen_t)(offsetof(struct sockaddr_un, sun_path) + 1 +
			   (size_t)snprintf(name->sun_path + 1, sizeof(name->sun_path) - 1, NAME, plant->id,
					    tap));
}

/* 0: it is none. */
static uint32_t tap_of(int fd)
{
	struct sockaddr_un name = {.sun_family = AF_UNSPEC};
	socklen_t size = sizeof(name);
	char text[sizeof(name.sun_path)] = "";
	const size_t before = offsetof(struct sockaddr_un, sun_path) + 1;
	unsigned id = 0, tap = 0;

	if (real.getsockname(fd, (struct sockaddr *)&name, &size) < 0 || name.sun_family != AF_UNIX ||
	    size <= before || size - before >= sizeof(text) || name.sun_path[0])
		return 0;
	memcpy(text, name.sun_path + 1, size - before);
	return sscanf(text, NAME, &id, &tap) == 2 && id == plant->id ? tap : 0;
}

static uint32_t taps[CLIENT_FDS]; /* 0: not known; PLANT_NO_TAP: none */

uint32_t packets_tap(int fd)
{
	const int error = errno;

	if (!plant || fd < 0 || fd >= CLIENT_FDS || plant->tap_next == 0)
		return 0;
	if (taps[fd] == 0) {
		taps[fd] = tap_of(fd);
		if (taps[fd] == 0)
			taps[fd] = PLANT_NO_TAP;
	}
	errno = error;
	return taps[fd] == PLANT_NO_TAP ? 0 : taps[fd];
}

void packets_forget(int fd)
{
	if (fd >= 0 && fd < CLIENT_FDS)
		taps[fd] = 0;
}

/* Frames come to it from now on. */
static void listen_on(uint32_t tap)
{
	for (uint32_t i = 0; i < plant->tap_count; i++)
		if (plant->taps[i] == tap)
			return;
	if (plant->tap_count < PLANT_TAPS)
		plant->taps[plant->tap_count++] = tap;
}

int packets_socket(int type, int protocol)
{
	struct sockaddr_un name;
	const int fd = real.socket(AF_UNIX, (type & ~0xf) | SOCK_DGRAM, 0);
	socklen_t size;

	if (fd < 0)
		return -1;
	size = put_name(&name, ++plant->tap_next);
	real.bind(fd, (struct sockaddr *)&name, size);
	packets_forget(fd);
	if (protocol)
		listen_on(plant->tap_next);
	return fd;
}

int packets_bind(int fd)
{
	listen_on(packets_tap(fd));
	return 0;
}

int packets_name(int fd, struct sockaddr *out, socklen_t *size)
{
	const struct sockaddr_ll address = {.sll_family = AF_PACKET,
					    .sll_ifindex = INDEX,
					    .sll_hatype = ARPHRD_ETHER,
					    .sll_halen = 6,
					    .sll_addr = HARDWARE(packets_tap(fd))};

	memcpy(out, &address, *size < sizeof(address) ? *size : sizeof(address));
	*size = sizeof(address);
	return 0;
}

/* One whose socket is closed has no tap any more. */
static void drop_tap(uint32_t place)
{
	memmove(&plant->taps[place], &plant->taps[place + 1],
		(plant->tap_count - place - 1) * sizeof(plant->taps[0]));
	plant->tap_count--;
}

/* A tag of a VLAN is no part of what a packet socket reads. */
static size_t put_parts(const uint8_t *frame, size_t size, struct iovec parts[2])
{
	const bool tagged = size > ADDRESSES + TAG && frame[ADDRESSES] == 0x81 && frame[ADDRESSES + 1] == 0;
	const size_t first = tagged ? ADDRESSES : size, left_out = tagged ? TAG : 0;

	parts[0] = (struct iovec){.iov_base = (void *)(uintptr_t)frame, .iov_len = first};
	parts[1] = (struct iovec){.iov_base = (void *)(uintptr_t)(frame + first + left_out),
				  .iov_len = size - first - left_out};
	return tagged ? 2 : 1;
}

ssize_t packets_send(int fd, const void *frame, size_t size)
{
	const uint32_t own = packets_tap(fd);
	struct sockaddr_un name;
	struct iovec parts[2];
	struct msghdr message = {
	    .msg_name = &name, .msg_iov = parts, .msg_iovlen = put_parts(frame, size, parts)};

	for (uint32_t i = plant->tap_count; i-- > 0 && !plant_is_cut(plant, PLANT_CABLE);) {
		if (plant->taps[i] == own)
			continue;
		message.msg_namelen = put_name(&name, plant->taps[i]);
		if (real.sendmsg(fd, &message, MSG_DONTWAIT) < 0 && errno == ECONNREFUSED)
			drop_tap(i);
	}
	return (ssize_t)size;
}

/* What is asked of an interface by its name. False: it is not this one. */
bool packets_control(unsigned long request, void *argument)
{
	struct ifreq *asked = argument;

	if ((request != SIOCGIFINDEX && request != SIOCGIFHWADDR && request != SIOCGIFFLAGS) ||
	    strcmp(asked->ifr_name, INTERFACE) != 0)
		return false;
	if (request == SIOCGIFINDEX)
		asked->ifr_ifindex = INDEX;
	if (request == SIOCGIFFLAGS)
		asked->ifr_flags = IFF_UP | IFF_RUNNING | IFF_MULTICAST;
	if (request == SIOCGIFHWADDR)
		asked->ifr_hwaddr =
		    (struct sockaddr){.sa_family = ARPHRD_ETHER, .sa_data = HARDWARE(client_self)};
	return true;
}

unsigned if_nametoindex(const char *name)
{
	struct ifreq asked = {.ifr_ifindex = 0};
	int fd;

	client_begin();
	if (plant)
		return strcmp(name, INTERFACE) == 0 ? INDEX : 0;
	fd = real.socket(AF_INET, SOCK_DGRAM, 0);
	snprintf(asked.ifr_name, sizeof(asked.ifr_name), "%s", name);
	if (fd < 0 || real.ioctl(fd, SIOCGIFINDEX, &asked) < 0)
		asked.ifr_ifindex = 0;
	if (fd >= 0)
		real.close(fd);
	return (unsigned)asked.ifr_ifindex;
}
