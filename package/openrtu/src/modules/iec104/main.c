/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * rtu-iec104 and rtu-iec104-tls: the controlled station on TCP, or on TLS. One thread, one epoll loop; all of
 * IEC 60870-5-104 is in iec104/, what carries its octets in a channel.
 */
#include <arpa/inet.h>
#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "channel/handshakes.h"
#include "iec104/octets.h"
#include "iec104/station.h"
#include "map/map.h"
#include "map/time_ns.h"
#include "modules/iec104/peer.h"
#include "process/module.h"

#define IDLE_MS 250 /* well below the second in which rtud expects a heartbeat */
#define BACKLOG 16
#define EVENTS  (SOURCE_HANDSHAKES + HANDSHAKES_MAX)

/* A wake-up costs an ARM926 its caches. Rings that follow each other so soon are heard together, after a rest. */
#define BELL_SOON_NS (4 * NS_PER_MS)
#define BELL_REST_NS (2 * NS_PER_MS)

/* What an epoll event is about: a connection's index, one of these, or from the last on a handshake's place. */
enum source { SOURCE_LISTENER = IEC104_CONNECTIONS_MAX, SOURCE_BELL, SOURCE_SIGNAL, SOURCE_HANDSHAKES };

static struct iec104_station station;
static struct socket {
	struct channel channel;
	uint32_t interest; /* what epoll watches it for */
} sockets[IEC104_CONNECTIONS_MAX];

static struct map *map;
static int64_t *sent_ns;               /* k times a connection */
static struct map_queue_place *places; /* the same */
static int poll_fd, listen_fd, signal_fd;
static int64_t rest_until_ns;                     /* the listener's; 0: it is watched */
static int64_t bell_rest_until_ns, bell_heard_ns; /* the same of the bell; when it rang last */

static void say(enum map_log_level level, const char *peer, const char *text)
{
	if (peer != NULL)
		iec104_log(&station, level, peer, "%s", text);
	else
		map_log(map, level, "%s", text);
}

static struct channel_owner channels = {.peers = "masters", .message = iec104_apdu_size, .say = say};

/* ---- connections ------------------------------------------------------------------------- */

static void watch(int operation, int fd, uint32_t interest, uint32_t source)
{
	struct epoll_event event = {.events = interest, .data.u32 = source};

	epoll_ctl(poll_fd, operation, fd, &event);
}

/* A connection that waits and cannot be taken would wake the loop again and again. */
static void rest_listener(void)
{
	watch(EPOLL_CTL_MOD, listen_fd, 0, SOURCE_LISTENER);
	rest_until_ns = map_now_ns() + IDLE_MS * NS_PER_MS;
}

static void wake_listener(void)
{
	if (rest_until_ns == 0 || map_now_ns() < rest_until_ns)
		return;
	rest_until_ns = 0;
	watch(EPOLL_CTL_MOD, listen_fd, EPOLLIN, SOURCE_LISTENER);
}

static bool accept_failed(void)
{
	switch (errno) {
	case EMFILE:
	case ENFILE:
	case ENOBUFS:
	case ENOMEM:
		rest_listener();
		return false;
	default: /* EAGAIN, or what happened to one connection */
		return errno == ECONNABORTED;
	}
}

static uint32_t index_of(const struct iec104_connection *connection)
{
	return (uint32_t)(connection - station.connections);
}

static void end_connection(uint32_t index)
{
	iec104_station_disconnect(&station, &station.connections[index]);
	channel_close(&sockets[index].channel);
}

/* Its peer is who it should be: it becomes a connection of the station, if there is a place for it. */
static void admit(struct handshake *handshake)
{
	int64_t now_ns = map_now_ns();
	struct iec104_connection *leaving, *connection;
	struct iec104_peer peer;
	uint32_t index;

	memcpy(peer.address, handshake->address, sizeof(peer.address));
	memcpy(peer.name, handshake->channel.peer, sizeof(peer.name));
	peer_look_again(map_config(map), &peer);
	leaving = iec104_station_make_room(&station, &peer, now_ns);
	if (leaving != NULL)
		end_connection(index_of(leaving));
	connection = iec104_station_connect(&station, &peer, now_ns);
	handshake->here = false;
	if (connection == NULL) {
		channel_close(&handshake->channel);
		return;
	}
	index = index_of(connection);
	sockets[index] = (struct socket){.channel = handshake->channel, .interest = EPOLLIN};
	watch(EPOLL_CTL_MOD, handshake->channel.fd, EPOLLIN, index);
}

static void settle(struct handshake *handshake, enum channel_progress progress)
{
	switch (progress) {
	case CHANNEL_READY:
		admit(handshake);
		return;
	case CHANNEL_WAITS:
		watch(EPOLL_CTL_MOD, handshake->channel.fd, handshake->channel.wants,
		      SOURCE_HANDSHAKES + handshakes_place_of(handshake));
		return;
	case CHANNEL_REFUSED:
		handshake->here = false;
		channel_close(&handshake->channel);
	}
}

/* False: none is waiting, or none can be taken now. */
static bool accept_one(void)
{
	struct sockaddr_storage from;
	socklen_t size = sizeof(from);
	struct handshake *handshake;
	const int on = 1;
	int fd = accept4(listen_fd, (struct sockaddr *)&from, &size, SOCK_NONBLOCK | SOCK_CLOEXEC);
	struct iec104_peer peer;

	if (fd < 0)
		return accept_failed();
	if (!peer_identify(&from, map_config(map), &peer)) {
		iec104_station_refuse(&station, peer.name, map_now_ns());
		close(fd);
		return true;
	}
	setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
	handshake = handshakes_place(&channels, peer.address, map_now_ns());
	watch(EPOLL_CTL_ADD, fd, 0, SOURCE_HANDSHAKES + handshakes_place_of(handshake));
	settle(handshake, channel_open(&handshake->channel, fd, peer.name));
	return true;
}

/* Watches for input while there is space for it, and for output while some is left. */
static void watch_connection(uint32_t index)
{
	uint32_t interest = iec104_interest(&sockets[index].channel, &station.connections[index].session);

	if (interest == sockets[index].interest)
		return;
	sockets[index].interest = interest;
	watch(EPOLL_CTL_MOD, sockets[index].channel.fd, interest, index);
}

/* ---- the bell ---------------------------------------------------------------------------- */

/* When it rang, or its rest is over. A ring after silence is heard at once, and so is what a master sends. */
static void hear_bell(void)
{
	int64_t now_ns = map_now_ns();
	bool rang = map_bell_clear(map), rests = rang && now_ns - bell_heard_ns < BELL_SOON_NS;

	if (rang)
		bell_heard_ns = now_ns;
	if (rests != (bell_rest_until_ns != 0))
		watch(EPOLL_CTL_MOD, map_bell_fd(map), rests ? 0 : EPOLLIN, SOURCE_BELL);
	bell_rest_until_ns = rests ? now_ns + BELL_REST_NS : 0;
}

static void end_bell_rest(void)
{
	if (bell_rest_until_ns != 0 && map_now_ns() >= bell_rest_until_ns)
		hear_bell();
}

/* ---- the loop ---------------------------------------------------------------------------- */

static void serve(void)
{
	int64_t now_ns;
	bool moved;

	do {
		moved = false;
		iec104_station_run(&station, map_begin_cycle(map));
		for (uint32_t i = 0; i < IEC104_CONNECTIONS_MAX; i++) {
			struct channel *channel = &sockets[i].channel;
			struct iec104_session *session = &station.connections[i].session;

			if (!station.connections[i].open)
				continue;
			moved |= iec104_transmit(channel, session);
			moved |= channel_pending(channel) && iec104_receive(channel, session);
		}
	} while (moved);
	now_ns = map_now_ns();
	for (uint32_t i = 0; i < IEC104_CONNECTIONS_MAX; i++) {
		struct iec104_session *session = &station.connections[i].session;

		if (!station.connections[i].open)
			continue;
		if (session->closing == IEC104_OPEN && !channel_keep(&sockets[i].channel, now_ns))
			iec104_session_close(session, IEC104_NOT_SECURE);
		if (session->closing != IEC104_OPEN)
			end_connection(i);
		else
			watch_connection(i);
	}
}

static int wait_ms(void)
{
	int64_t now_ns = map_now_ns(), deadline_ns = iec104_station_deadline(&station);

	if (bell_rest_until_ns != 0 && bell_rest_until_ns < deadline_ns)
		deadline_ns = bell_rest_until_ns;
	if (deadline_ns <= now_ns)
		return 0;
	if (deadline_ns >= now_ns + IDLE_MS * NS_PER_MS)
		return IDLE_MS;
	return (int)((deadline_ns - now_ns + NS_PER_MS - 1) / NS_PER_MS);
}

/* True: it may have cost a signature, a good part of the second in which rtud expects a heartbeat. */
static bool continue_handshake(uint32_t place)
{
	struct handshake *handshake = handshakes_at(place);

	if (handshake == NULL) /* sent away just now */
		return false;
	settle(handshake, channel_handshake(&handshake->channel));
	return true;
}

static void handle_connection(uint32_t index, uint32_t events)
{
	if (events & (EPOLLIN | sockets[index].channel.wants))
		iec104_receive(&sockets[index].channel, &station.connections[index].session);
	else if (events & (EPOLLHUP | EPOLLERR))
		iec104_session_close(&station.connections[index].session, IEC104_CLOSED_BY_PEER);
}

/* False: the process shall end. */
static bool handle(const struct epoll_event *event, bool *continued)
{
	switch (event->data.u32) {
	case SOURCE_LISTENER:
		for (int i = 0; i < BACKLOG && accept_one(); i++)
			; /* more are for the next turn: who is connected comes first */
		return true;
	case SOURCE_BELL:
		hear_bell();
		return true;
	case SOURCE_SIGNAL:
		return false;
	default:
		if (!*continued) /* others are for the next turn: who is connected comes first */
			*continued = continue_handshake(event->data.u32 - SOURCE_HANDSHAKES);
		return true;
	}
}

static void end_closed(void)
{
	for (uint32_t i = 0; i < IEC104_CONNECTIONS_MAX; i++)
		if (station.connections[i].open && station.connections[i].session.closing != IEC104_OPEN)
			end_connection(i);
}

/* Connections first: a handshake that ends may take the place of a connection whose event is still in the list. */
static bool handle_all(const struct epoll_event *events, int count)
{
	bool wanted = true, continued = false;

	for (int i = 0; i < count; i++)
		if (events[i].data.u32 < IEC104_CONNECTIONS_MAX)
			handle_connection(events[i].data.u32, events[i].events);
	end_closed();
	for (int i = 0; i < count; i++)
		if (events[i].data.u32 >= IEC104_CONNECTIONS_MAX)
			wanted &= handle(&events[i], &continued);
	return wanted;
}

/* A master of another group has another queue: it connects anew. */
static void look_again(struct iec104_connection *connection)
{
	struct iec104_peer peer;

	memcpy(peer.address, connection->address, sizeof(peer.address));
	if (peer_look_again(map_config(map), &peer) &&
	    iec104_group_of(&station, peer.party) == connection->group) {
		connection->party = peer.party;
		connection->clock_master = peer.clock_master;
	} else {
		iec104_session_close(&connection->session, IEC104_NOT_AS_BEFORE);
	}
}

static bool is_listed(const char *address)
{
	struct iec104_peer peer;

	snprintf(peer.address, sizeof(peer.address), "%s", address);
	return peer_look_again(map_config(map), &peer);
}

static void look_at_peers(void)
{
	for (uint32_t i = 0; i < IEC104_CONNECTIONS_MAX; i++)
		if (station.connections[i].open)
			look_again(&station.connections[i]);
	end_closed();
	handshakes_renew(&channels, is_listed);
}

/* Nothing is half done here: what has come is in the station, what it says in its octets. */
static void follow_configuration(void)
{
	static int64_t again_ns;
	struct map_config before;
	char error[MAP_ERROR_SIZE];

	if (!map_is_changed(map) || map_now_ns() < again_ns)
		return;
	if (map_renew(map, &before, error) < 0) {
		map_log(map, MAP_LOG_ERROR, "cannot take the changed configuration: %s", error);
		again_ns = map_now_ns() + NS_PER_S;
		return;
	}
	iec104_station_renew(&station, &before);
	channels.tls = &station.settings->tls;
	channel_renew();
	look_at_peers();
	map_forget(map);
}

static void run(void)
{
	bool wanted = true;

	while (wanted && map_may_run(map)) {
		struct epoll_event events[EVENTS];
		int count = epoll_wait(poll_fd, events, EVENTS, wait_ms());

		wanted = handle_all(events, count);
		end_bell_rest();
		follow_configuration();
		channel_watch(map_now_ns());
		serve();
		handshakes_watch(&channels, map_now_ns());
		wake_listener();
		map_heartbeat(map);
	}
	for (uint32_t i = 0; i < IEC104_CONNECTIONS_MAX; i++)
		if (station.connections[i].open)
			end_connection(i);
}

/* ---- start ------------------------------------------------------------------------------- */

static int fail(const char *what, const char *why)
{
	fprintf(stderr, "rtu-iec104: %s: %s\n", what, why);
	return -1;
}

static int open_listener(const struct iec104_settings *settings)
{
	const struct addrinfo hints = {.ai_flags = AI_PASSIVE | AI_NUMERICHOST | AI_NUMERICSERV,
				       .ai_socktype = SOCK_STREAM};
	struct addrinfo *address;
	char port[8];
	const int on = 1;
	int error, status = -1;

	snprintf(port, sizeof(port), "%u", (unsigned)settings->port);
	error = getaddrinfo(settings->address, port, &hints, &address);
	if (error != 0)
		return fail(settings->address, gai_strerror(error));
	listen_fd = socket(address->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
	if (listen_fd < 0)
		goto out;
	setsockopt(listen_fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
	status = bind(listen_fd, address->ai_addr, address->ai_addrlen);
	if (status == 0)
		status = listen(listen_fd, BACKLOG);
out:
	if (status < 0) {
		map_log(map, MAP_LOG_ERROR, "cannot listen on %s port %s: %s", settings->address, port,
			strerror(errno));
		fail(settings->address, strerror(errno));
	}
	freeaddrinfo(address);
	return status;
}

static int start(void)
{
	const struct iec104_settings *settings = iec104_settings(map_config(map));

	sent_ns = calloc((size_t)settings->max_connections * settings->k, sizeof(*sent_ns));
	places = calloc((size_t)settings->max_connections * settings->k, sizeof(*places));
	poll_fd = epoll_create1(EPOLL_CLOEXEC);
	if (sent_ns == NULL || places == NULL || poll_fd < 0 || (signal_fd = module_stop_fd()) < 0)
		return fail("cannot start", strerror(errno));
	iec104_station_init(&station, map, sent_ns, places);
	channels.tls = &settings->tls;
	if (!channel_start(&channels) || open_listener(settings) < 0)
		return -1;
	watch(EPOLL_CTL_ADD, listen_fd, EPOLLIN, SOURCE_LISTENER);
	watch(EPOLL_CTL_ADD, map_bell_fd(map), EPOLLIN, SOURCE_BELL);
	watch(EPOLL_CTL_ADD, signal_fd, EPOLLIN, SOURCE_SIGNAL);
	return 0;
}

static void name_counters(void)
{
	const struct iec104_stats *stats = iec104_stats_of(map);

	for (unsigned i = 0; i < IEC104_COUNT_OF_COUNTERS; i++)
		map_name_counter(map, &stats->counters[i], "%s", iec104_counter_name((enum iec104_counter)i));
}

int main(int argc, char **argv)
{
	const struct iec104_settings *settings;
	struct options options;

	map = module_begin(argc, argv, &options);
	settings = iec104_settings(map_config(map));
	if (!iec104_is_known(map))
		return module_is_of_another_build(map);
	name_counters();
	if (start() < 0 || !module_confine(map, &options, 0))
		return MODULE_FAILED;
	map_log(map, MAP_LOG_INFO, "listening on %s port %u", settings->address, (unsigned)settings->port);
	run();
	map_detach(map);
	return MODULE_ENDED;
}
