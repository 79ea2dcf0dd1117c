/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * rtu-iec61850 and rtu-iec61850-tls: the server of IEC 61850 on TCP, or on TLS. One loop; all of the protocol is in iec61850/, what
 * carries its octets in a channel. All memory is taken at the start, but OpenSSL's.
 */
#include <errno.h>
#include <inttypes.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "channel/channel.h"
#include "channel/handshakes.h"
#include "channel/lines.h"
#include "iec61850/association.h"
#include "iec61850/block.h"
#include "iec61850/block_kept.h"
#include "iec61850/control.h"
#include "iec61850/note.h"
#include "iec61850/report.h"
#include "map/address.h"
#include "map/heap.h"
#include "modules/iec61850/file.h"
#include "process/module.h"

#define IDLE_MS            250
#define PIECE_SIZE         (32 * 1024)
#define CONNECTIONS_A_TURN 16
#define EVENTS_A_TURN      256
#define STUCK_MS           10 /* a report that is due waits for its client to read */
/* Of silence, then three questions 10 s apart: a client that is gone frees its place. */
#define KEEP_ALIVE_S 30

static struct map *map;
static struct iec61850_server server;
static uint8_t *scratch;
static struct map_cursor cursor;
static uint32_t sessions;
static struct connection {
	struct iec61850_association association;
	struct channel channel; /* its fd is -1: it is free */
	char peer[MAP_ADDRESS_SIZE];
	char certificate[CHANNEL_NAME_SIZE];
} connections[IEC61850_ASSOCIATIONS_MAX];

static void say(enum map_log_level level, const char *peer, const char *text)
{
	static struct map_lines lines;

	if (peer == NULL) {
		map_log(map, level, "%s", text);
		return;
	}
	if (!channel_may_say(&lines, map_now_ns()))
		return;
	if (lines.withheld > 0)
		map_log(map, MAP_LOG_WARNING, "%" PRIu32 " lines about connections are left out",
			lines.withheld);
	lines.withheld = 0;
	map_log(map, level, "%s: %s", peer, text);
}

static struct channel_owner channels = {.peers = "clients", .say = say};

/* ---- connections ------------------------------------------------------------------------- */

static void end(struct connection *connection, enum iec61850_end why)
{
	static const char *const texts[] = {[IEC61850_STAYS] = "gave its place to another",
					    [IEC61850_RELEASED] = "released",
					    [IEC61850_DAMAGED] = "sent what is no message of MMS",
					    [IEC61850_SILENT_START] = "has not associated",
					    [IEC61850_STUCK] = "does not take what it asked for",
					    [IEC61850_NOT_SECURE] =
						"its keys or its certificate are no longer good"};

	if (why == IEC61850_DAMAGED)
		iec61850_count(&server, IEC61850_COUNT_DAMAGED);
	else if (why != IEC61850_RELEASED)
		iec61850_count(&server, IEC61850_COUNT_DROPPED);
	if (connection->association.associated || why != IEC61850_RELEASED)
		say(why == IEC61850_RELEASED ? MAP_LOG_INFO : MAP_LOG_WARNING, connection->peer, texts[why]);
	iec61850_association_end(&connection->association, &server);
	channel_close(&connection->channel);
	connection->channel.fd = -1;
}

/* A free place, if need be of who has asked nothing for the longest time. NULL: all are in use. */
static struct connection *find_place(int64_t now_ns)
{
	struct connection *idlest = NULL;
	int64_t longest_ns = 0;

	for (uint32_t i = 0; i < server.model.settings->associations; i++) {
		const int64_t idle_ns = iec61850_association_idle_ns(&connections[i].association, now_ns);

		if (connections[i].channel.fd < 0)
			return &connections[i];
		if (idle_ns > longest_ns && !iec61850_blocks_owned(&server, &connections[i].association)) {
			longest_ns = idle_ns;
			idlest = &connections[i];
		}
	}
	if (idlest != NULL)
		end(idlest, IEC61850_STAYS);
	return idlest;
}

static bool is_client(const struct in6_addr *from)
{
	const struct iec61850_settings *settings = server.model.settings;
	const uint32_t count = settings->client_count;

	return count == 0 || map_address_place(settings->clients, count, from) < count;
}

static bool is_controller(const struct in6_addr *from)
{
	const struct iec61850_settings *settings = server.model.settings;
	const uint32_t count = settings->controller_count;

	return map_address_place(settings->controllers, count, from) < count;
}

static void set_options(int fd)
{
	const int on = 1, idle = KEEP_ALIVE_S, interval = 10, count = 3;

	setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
	setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof(on));
	setsockopt(fd, IPPROTO_TCP, TCP_KEEPIDLE, &idle, sizeof(idle));
	setsockopt(fd, IPPROTO_TCP, TCP_KEEPINTVL, &interval, sizeof(interval));
	setsockopt(fd, IPPROTO_TCP, TCP_KEEPCNT, &count, sizeof(count));
}

/* Its peer is who it should be: it becomes a connection, if there is a place for it. */
static void admit(struct handshake *handshake, int64_t now_ns)
{
	struct connection *place = find_place(now_ns);
	struct in6_addr peer;

	handshake->here = false;
	if (place == NULL) {
		iec61850_count(&server, IEC61850_COUNT_REFUSED);
		channel_close(&handshake->channel);
		return;
	}
	place->channel = handshake->channel;
	memcpy(place->peer, handshake->address, sizeof(place->peer));
	channel_name(&place->channel, place->certificate);
	map_address_parse(place->peer, &peer);
	iec61850_association_open(&place->association, server.model.settings->max_pdu, now_ns);
	place->association.session = ++sessions;
	place->association.may_control = is_controller(&peer);
	memcpy(&place->association.peer, &peer, sizeof(place->association.peer));
}

static void settle(struct handshake *handshake, enum channel_progress progress, int64_t now_ns)
{
	switch (progress) {
	case CHANNEL_READY:
		admit(handshake, now_ns);
		return;
	case CHANNEL_WAITS:
		return;
	case CHANNEL_REFUSED:
		handshake->here = false;
		channel_close(&handshake->channel);
	}
}

/* False: none is waiting. */
static bool accept_one(int listener, int64_t now_ns)
{
	struct sockaddr_storage from;
	socklen_t size = sizeof(from);
	const int fd = accept4(listener, (struct sockaddr *)&from, &size, SOCK_NONBLOCK | SOCK_CLOEXEC);
	char address[MAP_ADDRESS_SIZE], name[CHANNEL_PEER_SIZE];
	struct handshake *handshake;
	struct in6_addr peer;

	if (fd < 0)
		return errno == ECONNABORTED;
	peer = map_address_of(&from);
	iec61850_count(&server, IEC61850_COUNT_CONNECTIONS);
	if (!is_client(&peer)) {
		iec61850_count(&server, IEC61850_COUNT_REFUSED);
		close(fd);
		return true;
	}
	set_options(fd);
	map_address_text(&peer, address);
	/* the port has the same place in both families */
	snprintf(name, sizeof(name), "%s port %u", address, ntohs(((struct sockaddr_in *)&from)->sin_port));
	handshake = handshakes_place(&channels, address, now_ns);
	settle(handshake, channel_open(&handshake->channel, fd, name), now_ns);
	return true;
}

/* ---- octets ------------------------------------------------------------------------------ */

/* How many came; -1: the peer is gone. */
static ssize_t receive(struct connection *connection)
{
	size_t size;
	uint8_t *space = iec61850_transport_space(&connection->association.transport, &size);
	ssize_t count;

	if (size == 0)
		return 0;
	count = channel_receive(&connection->channel, space, size);
	if (count > 0)
		iec61850_transport_received(&connection->association.transport, (size_t)count);
	return count;
}

/* How many went; -1: the peer is gone. */
static ssize_t transmit(struct connection *connection, int64_t now_ns)
{
	size_t size;
	const uint8_t *octets = iec61850_transport_output(&connection->association.transport, &size);
	ssize_t count;

	if (size == 0)
		return 0;
	count = channel_transmit(&connection->channel, octets, size);
	if (count > 0)
		iec61850_association_written(&connection->association, (size_t)count, now_ns);
	return count;
}

/* What is ready now: octets that go, else those that the socket has not any more. -1: the peer is gone. */
static ssize_t move(struct connection *connection, int64_t now_ns)
{
	const ssize_t went = transmit(connection, now_ns);

	return went == 0 && channel_pending(&connection->channel) ? receive(connection) : went;
}

static void serve(struct connection *connection, short events, int64_t now_ns)
{
	const struct channel *channel = &connection->channel;
	const short wanted = (short)(POLLIN | POLLHUP | POLLERR | channel->wants);
	ssize_t moved = (events & wanted) || channel_pending(channel) ? receive(connection) : 0;
	enum iec61850_end why;

	do {
		why = moved < 0
			  ? IEC61850_RELEASED
			  : iec61850_association_run(&connection->association, &server, scratch, now_ns);
		moved = moved < 0 ? 0 : move(connection, now_ns);
	} while (why == IEC61850_STAYS && moved != 0);
	if (why != IEC61850_STAYS)
		end(connection, why);
}

static short interest_of(struct connection *connection)
{
	const struct iec61850_transport *transport = &connection->association.transport;

	if (connection->channel.wants != 0)
		return (short)connection->channel.wants;
	return iec61850_transport_is_free(transport) ? POLLIN : POLLOUT;
}

/* ---- events ------------------------------------------------------------------------------ */

/* Each event is told before the next is taken, so that a client sees every change that it has time for. */
static void take_events(int64_t now_ns)
{
	const uint32_t count = server.model.settings->associations;
	struct map_event event;

	for (int i = 0; i < EVENTS_A_TURN && map_event_next(map, &cursor, &event); i++) {
		iec61850_note_event(&server, &event, now_ns);
		iec61850_note_settle(&server, &cursor);
		for (uint32_t j = 0; j < count && iec61850_report_due_ns(&server) <= now_ns; j++)
			if (connections[j].channel.fd >= 0)
				serve(&connections[j], 0, now_ns);
	}
	if (map_events_behind(map, &cursor) == 0)
		server.catching_up = false;
	if (cursor.lost == 0)
		return;
	map_count(&server.stats->counters[IEC61850_COUNT_EVENTS_LOST], cursor.lost);
	map_count_lost_events(map, cursor.lost);
	cursor.lost = 0;
	iec61850_note_all(&server, now_ns);
	iec61850_note_settle(&server, &cursor);
}

/* Before the events: what a command has read back is there when its end is. */
static void take_answers(int64_t now_ns)
{
	struct map_answer answer;

	while (map_answer_next(map, &answer)) {
		iec61850_control_answer(&server, &answer);
		iec61850_note_selection(&server, answer.point, now_ns);
	}
}

static int wait_ms(int64_t now_ns)
{
	const int64_t left_ns = iec61850_report_due_ns(&server) - now_ns;

	if (map_events_behind(map, &cursor) > 0)
		return 0;
	if (left_ns <= 0)
		return STUCK_MS;
	return left_ns >= IDLE_MS * NS_PER_MS ? IDLE_MS : (int)((left_ns + NS_PER_MS - 1) / NS_PER_MS);
}

/* ---- what people see --------------------------------------------------------------------- */

static const char *peer_of(const void *association)
{
	for (uint32_t i = 0; i < server.model.settings->associations; i++)
		if (connections[i].channel.fd >= 0 && association == &connections[i].association)
			return connections[i].peer;
	return "";
}

static void name_block(char out[IEC61850_SHOWN_NAME], const struct iec61850_block *block)
{
	const struct iec61850_object object = iec61850_block_object(block);
	char ld[IEC61850_NAME_SIZE], name[IEC61850_NAME_SIZE];

	iec61850_device_name(&server.model, block->device, ld);
	iec61850_object_name(&server.model, &object, name);
	snprintf(out, IEC61850_SHOWN_NAME, "%.45s/%.45s", ld, name);
}

static void show_block(struct iec61850_shown *shown, const struct iec61850_block *block)
{
	struct iec61850_shown_block *out = &shown->blocks[shown->block_count++];

	name_block(out->name, block);
	snprintf(out->peer, sizeof(out->peer), "%s", peer_of(block->owner));
	out->enabled = block->enabled;
	out->reports = block->number;
}

static void show_blocks(struct iec61850_shown *shown)
{
	shown->block_count = 0;
	for (uint32_t i = 0; i < server.model.block_count && shown->block_count < IEC61850_SHOWN_BLOCKS; i++)
		if (server.model.blocks[i].owner != NULL)
			show_block(shown, &server.model.blocks[i]);
}

/* An entry that the journal has kept has wall time. */
static int64_t happened_ns(const struct map_history_entry *entry)
{
	const int64_t now_ns = map_now_ns();

	return entry->time == MAP_TIME_MONOTONIC
		   ? entry->noted_ns
		   : now_ns - (map_wall_ns(map_clock_read(map), now_ns) - entry->noted_ns);
}

static void show_queue(struct iec61850_shown *shown, const struct iec61850_block *block)
{
	const struct iec61850_buffer *buffer = &server.model.buffer;
	struct iec61850_shown_queue *out = &shown->queues[shown->queue_count++];
	const uint32_t first = iec61850_buffer_first(buffer, block->kept, &out->overflow);
	const struct map_history_entry *oldest = iec61850_buffer_entry(buffer, first);

	name_block(out->name, block);
	snprintf(out->peer, sizeof(out->peer), "%s", peer_of(block->owner));
	out->enabled = block->enabled;
	out->waiting = buffer->next - first;
	out->dated = oldest != NULL && oldest->time != MAP_TIME_WALL_UNSET;
	out->oldest_ns = out->dated ? happened_ns(oldest) : 0;
}

static void show_queues(struct iec61850_shown *shown)
{
	const struct iec61850_model *model = &server.model;

	shown->kept = model->buffer.next - iec61850_buffer_oldest(&model->buffer);
	shown->queue_count = 0;
	for (uint32_t i = 0; i < model->block_count && shown->queue_count < IEC61850_SHOWN_QUEUES; i++)
		if (model->blocks[i].buffered && model->blocks[i].reader->used)
			show_queue(shown, &model->blocks[i]);
}

static void show_associations(struct iec61850_shown *shown)
{
	shown->association_count = 0;
	for (uint32_t i = 0; i < server.model.settings->associations; i++) {
		const struct iec61850_association *association = &connections[i].association;
		struct iec61850_shown_association *out = &shown->associations[shown->association_count];

		if (connections[i].channel.fd < 0)
			continue;
		shown->association_count++;
		*out = (struct iec61850_shown_association){.associated = association->associated,
							   .pdu = association->max_pdu,
							   .since_ns = association->opened_ns};
		snprintf(out->peer, sizeof(out->peer), "%s", connections[i].peer);
		memcpy(out->certificate, connections[i].certificate, sizeof(out->certificate));
	}
}

static void show(void)
{
	const uint32_t next = 1 - (atomic_load(&server.stats->which) & 1u);

	show_associations(&server.stats->shown[next]);
	show_blocks(&server.stats->shown[next]);
	show_queues(&server.stats->shown[next]);
	atomic_store(&server.stats->which, next);
}

/* Not for each message: reservations last seconds, and people look now and then. */
static void do_what_has_time(int64_t now_ns)
{
	static int64_t done_ns;

	if (now_ns - done_ns < IDLE_MS * NS_PER_MS)
		return;
	done_ns = now_ns;
	iec61850_blocks_tick(&server);
	iec61850_note_selections(&server, now_ns);
	iec61850_note_settle(&server, &cursor);
	show();
}

/* ---- the loop ---------------------------------------------------------------------------- */

enum {
	STOP,
	LISTENER,
	BELL,
	CONNECTIONS,
	WAITS_MAX = CONNECTIONS + IEC61850_ASSOCIATIONS_MAX + HANDSHAKES_MAX
};

static void wait(struct pollfd waits[WAITS_MAX], uint32_t count)
{
	struct pollfd *of_handshakes = waits + CONNECTIONS + count;

	for (uint32_t i = 0; i < count; i++)
		waits[CONNECTIONS + i] = (struct pollfd){
		    .fd = connections[i].channel.fd,
		    .events = connections[i].channel.fd < 0 ? (short)0 : interest_of(&connections[i])};
	for (uint32_t i = 0; i < HANDSHAKES_MAX; i++) {
		const struct handshake *handshake = handshakes_at(i);

		of_handshakes[i] =
		    (struct pollfd){.fd = handshake == NULL ? -1 : handshake->channel.fd,
				    .events = handshake == NULL ? (short)0 : (short)handshake->channel.wants};
	}
	poll(waits, CONNECTIONS + count + HANDSHAKES_MAX, wait_ms(map_now_ns()));
}

/* One in a turn: it may cost a signature, a good part of the second in which rtud expects a heartbeat. */
static void continue_handshake(const struct pollfd waits[HANDSHAKES_MAX], int64_t now_ns)
{
	static uint32_t last;

	for (uint32_t i = 1; i <= HANDSHAKES_MAX; i++) {
		const uint32_t place = (last + i) % HANDSHAKES_MAX;
		struct handshake *handshake = handshakes_at(place);

		if (handshake == NULL || waits[place].revents == 0)
			continue;
		last = place;
		settle(handshake, channel_handshake(&handshake->channel), now_ns);
		return;
	}
}

/* Who is connected comes first. */
static void serve_all(const struct pollfd *waits, uint32_t count, int64_t now_ns)
{
	for (uint32_t i = 0; i < count; i++) {
		if (connections[i].channel.fd < 0)
			continue;
		if (channel_keep(&connections[i].channel, now_ns))
			serve(&connections[i], waits[i].revents, now_ns);
		else
			end(&connections[i], IEC61850_NOT_SECURE);
	}
	continue_handshake(waits + count, now_ns);
	handshakes_watch(&channels, now_ns);
}

static void run(int stop, int listener)
{
	struct pollfd waits[WAITS_MAX] = {[STOP] = {.fd = stop, .events = POLLIN},
					  [LISTENER] = {.fd = listener, .events = POLLIN},
					  [BELL] = {.fd = map_bell_fd(map), .events = POLLIN}};
	const uint32_t count = server.model.settings->associations;

	while (map_may_run(map) && (waits[STOP].revents & POLLIN) == 0) {
		int64_t now_ns;

		wait(waits, count);
		now_ns = server.now_ns = map_begin_cycle(map);
		map_heartbeat(map);
		if (waits[BELL].revents & POLLIN)
			map_bell_clear(map);
		else
			map_bell_clear_if_taken(map);
		channel_watch(now_ns);
		take_answers(now_ns);
		iec61850_controls_tick(&server);
		take_events(now_ns);
		serve_all(waits + CONNECTIONS, count, now_ns);
		for (int i = 0; (waits[LISTENER].revents & POLLIN) && i < CONNECTIONS_A_TURN; i++)
			if (!accept_one(listener, now_ns))
				break;
		do_what_has_time(now_ns);
	}
}

/* ---- start ------------------------------------------------------------------------------- */

/* All in one piece: pages that no client has used take no memory, and there are no heads of pieces on them. */
static bool begin_connections(uint32_t count, uint32_t max_pdu)
{
	const size_t message = IEC61850_MESSAGE_SIZE(max_pdu), output = IEC61850_OUTPUT_SIZE(max_pdu);
	uint8_t *octets = malloc(count * (IEC61850_INPUT_SIZE + message + output));

	for (uint32_t i = 0; octets != NULL && i < count; i++) {
		struct iec61850_transport *transport = &connections[i].association.transport;

		connections[i].channel.fd = -1;
		transport->message_size = message;
		transport->output_size = output;
		transport->input = octets;
		transport->message = transport->input + IEC61850_INPUT_SIZE;
		transport->output = transport->message + message;
		octets = transport->output + output;
	}
	return octets != NULL;
}

/* Another one for each start of the gateway: its clock, or what runs since it was switched on. */
static uint32_t start_number(void)
{
	return (uint32_t)(map_wall_ns(map_clock_read(map), map_now_ns()) / NS_PER_MS);
}

static bool start(int file)
{
	const struct iec61850_settings *settings = iec61850_settings(map_config(map));
	bool begun = iec61850_model_begin(&server.model, map);

	server.map = map;
	scratch = malloc(IEC61850_MESSAGE_SIZE(settings->max_pdu));
	server.chosen = calloc(server.model.longest_set, sizeof(*server.chosen));
	begun = begin_connections(settings->associations, settings->max_pdu) && begun;
	if (begun && scratch != NULL && server.chosen != NULL) {
		file_take(&server, map, file);
		map_cursor_to_end(map, &cursor);
		iec61850_blocks_begin(&server, server.stats, &cursor, start_number());
		return true;
	}
	map_log(map, MAP_LOG_ERROR, "cannot start: %s", strerror(ENOMEM));
	return false;
}

static void name_counters(void)
{
	static const char *const names[IEC61850_COUNT_OF_COUNTERS] = {
	    [IEC61850_COUNT_CONNECTIONS] = "connections",
	    [IEC61850_COUNT_REFUSED] = "connections_refused",
	    [IEC61850_COUNT_ASSOCIATIONS] = "associations",
	    [IEC61850_COUNT_DROPPED] = "connections_dropped",
	    [IEC61850_COUNT_DAMAGED] = "messages_damaged",
	    [IEC61850_COUNT_REQUESTS] = "requests",
	    [IEC61850_COUNT_ERRORS] = "requests_refused",
	    [IEC61850_COUNT_READS] = "variables_read",
	    [IEC61850_COUNT_REPORTS] = "reports",
	    [IEC61850_COUNT_EVENTS_LOST] = "events_lost",
	    [IEC61850_COUNT_COMMANDS] = "commands",
	    [IEC61850_COUNT_COMMANDS_REFUSED] = "commands_refused",
	    [IEC61850_COUNT_HANDSHAKES_REFUSED] = "handshakes_refused",
	};

	for (unsigned i = 0; i < IEC61850_COUNT_OF_COUNTERS; i++)
		map_name_counter(map, &server.stats->counters[i], "%s", names[i]);
}

int main(int argc, char **argv)
{
	struct options options;
	int stop;

	/* What is large is pages of its own, which take no memory until they are written to. */
	mallopt(M_MMAP_THRESHOLD, PIECE_SIZE);
	mallopt(M_TOP_PAD, 0);
	map = module_begin(argc, argv, &options);
	if (iec61850_settings(map_config(map)) != NULL)
		server.stats = map_section(map, map_self(map), iec61850_section_size(map_config(map)));
	if (server.stats == NULL)
		return module_is_of_another_build(map);
	name_counters();
	stop = module_stop_fd();
	channels.tls = &iec61850_settings(map_config(map))->tls;
	channels.refused = &server.stats->counters[IEC61850_COUNT_HANDSHAKES_REFUSED];
	if (stop < 0 || !start(options.file_fd) || !channel_start(&channels) ||
	    !module_confine(map, &options, 0))
		return MODULE_FAILED;
	map_log(map, MAP_LOG_INFO, "listening on %s port %u", server.model.settings->address,
		(unsigned)server.model.settings->port);
	run(stop, options.socket_fd);
	map_detach(map);
	return MODULE_ENDED;
}
