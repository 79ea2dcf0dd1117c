/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * TCP between the plant's processes, over Unix sockets: what one sends the other has at once, at any load of the host, and no
 * port of the host is taken. A port is a name of the plant's own; all addresses are this machine. A cut holds octets back.
 */
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/un.h>
#include <unistd.h>

#include "client.h"

#define FIRST_PORT 49152 /* of those that connect */
#define NAME       "plant-%u:%u"
#define FROM       "@%08x" /* behind the name of one that connects */

enum link_state { LINK_UNKNOWN, LINK_NONE, LINK_KNOWN };

static struct link {
	enum link_state state;
	uint16_t own, peer;
	int64_t since_ns;
	uint16_t waits_for; /* a connection that is begun when the cut is over */
	bool connecting;    /* as what says that it is made is on its way */
	int error;
	bool of_ipv6;
} links[CLIENT_FDS];

static struct link *link_of(int fd)
{
	return &links[fd >= 0 && fd < CLIENT_FDS ? fd : 0];
}

struct place {
	uint16_t port; /* 0: none of the plant's TCP */
	uint32_t address;
};

/* address 0: of one that listens. */
static socklen_t put_name(struct sockaddr_un *name, uint16_t port, uint32_t address)
{
	const size_t room = sizeof(name->sun_path) - 1;
	int size;

	*name = (struct sockaddr_un){.sun_family = AF_UNIX};
	size = address ? snprintf(name->sun_path + 1, room, NAME FROM, plant->id, port, address)
		       : snprintf(name->sun_path + 1, room, NAME, plant->id, port);
	return (socklen_t)(offsetof(struct sockaddr_un, sun_path) + 1 + (size_t)size);
}

static struct place place_of_name(const struct sockaddr_un *name, socklen_t size)
{
	char text[sizeof(name->sun_path)] = "";
	unsigned id = 0, port = 0, address = INADDR_LOOPBACK;
	const size_t before = offsetof(struct sockaddr_un, sun_path) + 1;

	if (name->sun_family != AF_UNIX || size <= before || size - before >= sizeof(text) ||
	    name->sun_path[0])
		return (struct place){0};
	memcpy(text, name->sun_path + 1, size - before);
	if (sscanf(text, NAME FROM, &id, &port, &address) < 2 || id != plant->id)
		return (struct place){0};
	return (struct place){(uint16_t)port, address};
}

typedef int (*ask_name)(int, struct sockaddr *, socklen_t *);

static struct place place_by(ask_name ask, int fd)
{
	struct sockaddr_un name;
	socklen_t size = sizeof(name);
	const int error = errno;
	struct place place = {0};

	if (ask(fd, (struct sockaddr *)&name, &size) == 0)
		place = place_of_name(&name, size);
	errno = error;
	return place;
}

static uint16_t port_by(ask_name ask, int fd)
{
	return place_by(ask, fd).port;
}

static void look(int fd, struct link *link)
{
	link->own = port_by(real.getsockname, fd);
	link->peer = port_by(real.getpeername, fd);
	link->state = link->own || link->peer ? LINK_KNOWN : LINK_NONE;
}

/* NULL: it is none of the plant's TCP. */
static const struct link *known_link(int fd)
{
	struct link *link = link_of(fd);

	if (fd < 0)
		return NULL;
	if (link->state == LINK_UNKNOWN)
		look(fd, link);
	return link->state == LINK_KNOWN ? link : NULL;
}

bool network_is_lost(int fd)
{
	const struct link *link = plant->loss_count > 0 ? known_link(fd) : NULL;

	return link && link->peer &&
	       (plant_is_lost(plant, link->own, link->since_ns) ||
		plant_is_lost(plant, link->peer, link->since_ns));
}

bool network_is_cut(int fd)
{
	const struct link *link = plant->fault_count > 0 ? known_link(fd) : NULL;

	return (link && (plant_is_cut(plant, link->own) || plant_is_cut(plant, link->peer))) ||
	       network_is_lost(fd);
}

/* ---- links with delay -------------------------------------------------------------------- */

static const struct link *delayed_link(int fd)
{
	const struct link *link = plant->delay_count > 0 ? known_link(fd) : NULL;

	return link && link->peer && plant_is_delayed(plant, link->own, link->peer) ? link : NULL;
}

size_t network_arrived(int fd, size_t size)
{
	const struct link *link = delayed_link(fd);
	size_t arrived;

	if (!link)
		return size;
	arrived = plant_arrived(plant, link->peer, link->own);
	if (!arrived && !plant_is_on_its_way(plant, link->peer, link->own))
		return size; /* it has ended */
	return arrived < size ? arrived : size;
}

void network_took(int fd, ssize_t size)
{
	const struct link *link = delayed_link(fd);

	if (link && size >= 0)
		plant_took(plant, link->peer, link->own, (size_t)size);
}

void network_sent(int fd, ssize_t size)
{
	const struct link *link = delayed_link(fd);

	if (link && size >= 0)
		plant_send(plant, link->own, link->peer, (size_t)size, plant->now_ns);
}

void network_close(int fd)
{
	const struct link *link = delayed_link(fd);

	if (!link)
		return;
	plant_forget_flights(plant, link->peer, link->own);
	plant_send(plant, link->own, link->peer, 0, plant->now_ns);
}

void network_forget(int fd)
{
	*link_of(fd) = (struct link){0};
}

/* What is there, and not yet to be seen. */
static short arrived_events(struct link *link, short found)
{
	const bool on_its_way = plant_is_on_its_way(plant, link->peer, link->own);

	if (link->connecting && on_its_way)
		return 0;
	link->connecting = false;
	if (!on_its_way)
		return found;
	return plant_arrived(plant, link->peer, link->own) ? (short)(found & (POLLIN | POLLOUT))
							   : (short)(found & POLLOUT);
}

static uint16_t port_of(const struct sockaddr *address)
{
	if (address->sa_family == AF_INET)
		return ntohs(((const struct sockaddr_in *)(const void *)address)->sin_port);
	return ntohs(((const struct sockaddr_in6 *)(const void *)address)->sin6_port);
}

static bool is_stand_in(int fd, const struct sockaddr *address)
{
	int domain = 0;
	socklen_t size = sizeof(domain);

	if (!address || (address->sa_family != AF_INET && address->sa_family != AF_INET6))
		return false;
	return real.getsockopt(fd, SOL_SOCKET, SO_DOMAIN, &domain, &size) == 0 && domain == AF_UNIX;
}

static void put_address(const struct link *link, struct place place, struct sockaddr *out, socklen_t *size)
{
	const struct sockaddr_in plain = {
	    .sin_family = AF_INET, .sin_port = htons(place.port), .sin_addr.s_addr = htonl(place.address)};
	const struct sockaddr_in6 six = {
	    .sin6_family = AF_INET6, .sin6_port = htons(place.port), .sin6_addr = IN6ADDR_LOOPBACK_INIT};
	const void *from = link->of_ipv6 ? (const void *)&six : (const void *)&plain;
	const socklen_t whole = link->of_ipv6 ? sizeof(six) : sizeof(plain);

	if (!out || !size)
		return;
	memcpy(out, from, *size < whole ? *size : whole);
	*size = whole;
}

/* Where this process connects from, if it is no address of all. */
static uint32_t own_address(void)
{
	for (uint32_t i = 0; i < plant->host_count; i++)
		if (strcmp(plant->hosts[i].name, plant->processes[client_self].name) == 0)
			return plant->hosts[i].address;
	return 0;
}

static int bind_port(int fd, uint16_t port)
{
	struct sockaddr_un name;
	socklen_t size;

	if (port) {
		size = put_name(&name, port, 0);
		return real.bind(fd, (struct sockaddr *)&name, size);
	}
	do {
		if (plant->next_port < FIRST_PORT)
			plant->next_port = FIRST_PORT;
		size = put_name(&name, plant->next_port++, datagrams_is(fd) ? 0 : own_address());
	} while (real.bind(fd, (struct sockaddr *)&name, size) < 0 && errno == EADDRINUSE);
	return 0;
}

static int connect_port(int fd, uint16_t port)
{
	struct sockaddr_un name;
	const socklen_t size = put_name(&name, port, 0);

	link_of(fd)->state = LINK_UNKNOWN;
	link_of(fd)->since_ns = plant->now_ns;
	return real.connect(fd, (struct sockaddr *)&name, size);
}

/* There and back until it is known here. */
static int connect_far(int fd, uint16_t port)
{
	int result = connect_port(fd, port);
	const struct link *link = result == 0 ? delayed_link(fd) : NULL;
	int64_t there_ns;

	if (!link)
		return result;
	link_of(fd)->connecting = true;
	there_ns = plant_send(plant, link->own, link->peer, 0, plant->now_ns);
	plant_send(plant, link->peer, link->own, 0, there_ns);
	errno = EINPROGRESS;
	return -1;
}

/* ---- what datagrams need ----------------------------------------------------------------- */

uint16_t network_port(int fd)
{
	return port_by(real.getsockname, fd);
}

bool network_take_port(int fd)
{
	return bind_port(fd, 0) == 0;
}

socklen_t network_name(const struct sockaddr *address, struct sockaddr_un *out)
{
	return put_name(out, port_of(address), 0);
}

bool network_is_cut_off(int fd, const struct sockaddr *to)
{
	return plant_is_cut(plant, network_port(fd)) || (to && plant_is_cut(plant, port_of(to)));
}

void network_put_sender(const struct sockaddr_un *name, socklen_t name_size, struct sockaddr *out,
			socklen_t *size)
{
	const struct link plain = {.of_ipv6 = false};

	if (out)
		put_address(&plain, place_of_name(name, name_size), out, size);
}

/* ---- what waits asks --------------------------------------------------------------------- */

short network_events(int fd, short wanted, short found)
{
	struct link *link = link_of(fd);
	struct pollfd again = {.fd = fd, .events = wanted};

	if (link->waits_for) {
		if (plant_is_cut(plant, link->waits_for))
			return 0;
		link->error = connect_port(fd, link->waits_for) < 0 ? errno : 0;
		link->waits_for = 0;
		client_changes();
		if (link->error)
			return (short)(POLLERR | POLLHUP | (wanted & POLLOUT));
		real.poll(&again, 1, 0);
		return again.revents;
	}
	if (network_is_cut(fd))
		return found & POLLOUT;
	return delayed_link(fd) ? arrived_events(link, found) : found;
}

/* ---- the calls --------------------------------------------------------------------------- */

/* Of the kernel's links nothing is told: they are the host's. */
static int refuse_netlink(void)
{
	errno = EAFNOSUPPORT;
	return -1;
}

int socket(int domain, int type, int protocol)
{
	const bool is_inet = domain == AF_INET || domain == AF_INET6;
	const int kind = type & 0xf;
	int fd;

	client_begin();
	if (plant && domain == AF_NETLINK)
		return refuse_netlink();
	if (plant && domain == AF_PACKET)
		return packets_socket(type, protocol);
	if (!plant || !is_inet || (kind != SOCK_STREAM && kind != SOCK_DGRAM))
		return real.socket(domain, type, protocol);
	fd = real.socket(AF_UNIX, type, 0);
	if (fd < 0)
		return -1;
	link_of(fd)->of_ipv6 = domain == AF_INET6;
	if (kind == SOCK_DGRAM)
		datagrams_made(fd);
	return fd;
}

int bind(int fd, const struct sockaddr *address, socklen_t size)
{
	int result;

	if (packets_tap(fd))
		return packets_bind(fd);
	if (!plant || !is_stand_in(fd, address))
		return real.bind(fd, address, size);
	client_call();
	result = bind_port(fd, port_of(address));
	client_changes();
	client_tell("bind %d %u %d", fd, port_of(address), result);
	return result;
}

int connect(int fd, const struct sockaddr *address, socklen_t size)
{
	int result, error;

	if (!plant)
		return real.connect(fd, address, size);
	client_call();
	if (!is_stand_in(fd, address)) {
		result = real.connect(fd, address, size);
	} else if (!port_by(real.getsockname, fd) && bind_port(fd, 0) < 0) {
		result = -1;
	} else if (plant_is_cut(plant, port_of(address))) {
		link_of(fd)->waits_for = port_of(address);
		errno = EINPROGRESS;
		result = -1;
	} else {
		result = connect_far(fd, port_of(address));
	}
	error = errno;
	client_changes();
	client_tell("connect %d %d", fd, result < 0 ? -error : 0);
	errno = error;
	return result;
}

int accept4(int fd, struct sockaddr *restrict address, socklen_t *restrict size, int flags)
{
	int result, error;
	uint16_t port;

	if (!plant)
		return real.accept4(fd, address, size, flags);
	client_call();
	if (wait_blocking(fd, POLLIN) < 0)
		return -1;
	port = port_by(real.getsockname, fd);
	if (network_is_cut(fd)) {
		errno = EAGAIN;
		return -1;
	}
	result = port ? real.accept4(fd, NULL, NULL, flags) : real.accept4(fd, address, size, flags);
	error = errno;
	if (result >= 0 && port) {
		link_of(result)->since_ns = plant->now_ns;
		link_of(result)->of_ipv6 = link_of(fd)->of_ipv6;
		put_address(link_of(result), place_by(real.getpeername, result), address, size);
	}
	client_changes();
	client_tell("accept %d %d", fd, result < 0 ? -error : result);
	errno = error;
	return result;
}

int accept(int fd, struct sockaddr *restrict address, socklen_t *restrict size)
{
	return accept4(fd, address, size, 0);
}

static int name_by(ask_name ask, int fd, struct sockaddr *address, socklen_t *size)
{
	const struct place place = plant ? place_by(ask, fd) : (struct place){0};

	if (!place.port)
		return ask(fd, address, size);
	put_address(link_of(fd), place, address, size);
	return 0;
}

int getsockname(int fd, struct sockaddr *restrict address, socklen_t *restrict size)
{
	if (packets_tap(fd))
		return packets_name(fd, address, size);
	return name_by(real.getsockname, fd, address, size);
}

int getpeername(int fd, struct sockaddr *restrict address, socklen_t *restrict size)
{
	return name_by(real.getpeername, fd, address, size);
}

/* What TCP and IP have to be told, the stand-in does not know. */
int setsockopt(int fd, int level, int name, const void *value, socklen_t size)
{
	int domain = 0;
	socklen_t domain_size = sizeof(domain);

	if (plant && level != SOL_SOCKET &&
	    real.getsockopt(fd, SOL_SOCKET, SO_DOMAIN, &domain, &domain_size) == 0 && domain == AF_UNIX)
		return 0;
	return real.setsockopt(fd, level, name, value, size);
}

int getsockopt(int fd, int level, int name, void *restrict value, socklen_t *restrict size)
{
	struct link *link = link_of(fd);

	if (plant && level == SOL_SOCKET && name == SO_ERROR && link->error && *size == sizeof(int)) {
		memcpy(value, &link->error, sizeof(int));
		link->error = 0;
		return 0;
	}
	return real.getsockopt(fd, level, name, value, size);
}

int shutdown(int fd, int how)
{
	int result;

	if (!plant)
		return real.shutdown(fd, how);
	client_call();
	result = real.shutdown(fd, how);
	if (result == 0 && how != SHUT_RD)
		network_sent(fd, 0);
	client_changes();
	client_tell("shutdown %d %d", fd, result);
	return result;
}
