/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "centre/station.h"

#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "centre/say.h"
#include "map/time_ns.h"

#define LATE_NS                                                                                              \
	(100 * NS_PER_MS) /* we were stopped, or full: what came meanwhile is read before a timer counts */
#define FULL_NS (100 * NS_PER_MS) /* until a poll is tried again that could not be sent */

/* ---- windows ----------------------------------------------------------------------------- */

static void leave_window(struct centre_station *station)
{
	if (station->window != CENTRE_NO_WINDOW)
		centre_window_leave(&station->centre->windows[station->window]);
	station->window = CENTRE_NO_WINDOW;
}

static void take_place(struct centre_station *station, uint8_t window)
{
	station->waits = false;
	station->window = window;
	station->place_until_ns = station->centre->now.monotonic_ns + station->centre->config->slow_ns;
}

/* A place at once; or its turn comes with centre_admit_next. */
static bool enter_window(struct centre_station *station, uint8_t window)
{
	if (!centre_window_enter(&station->centre->windows[window], centre_place_of(station))) {
		station->waits = true;
		return false;
	}
	take_place(station, window);
	return true;
}

static void lose_patience(struct centre_station *station)
{
	if (station->window == CENTRE_NO_WINDOW ||
	    station->centre->now.monotonic_ns < station->place_until_ns)
		return;
	if (station->link == CENTRE_UP)
		station->slow = true;
	leave_window(station);
}

/* ---- the plan ---------------------------------------------------------------------------- */

static struct iec104_poll *next_poll(const struct centre_station *station)
{
	return iec104_polls_next(station->polls, station->plan->poll_count);
}

/* The station has a place in a window. */
static void send_poll(struct centre_station *station)
{
	int64_t now_ns = station->centre->now.monotonic_ns;
	struct iec104_poll *poll = next_poll(station);

	station->poll = iec104_poll_post(poll, &station->controlling, station->centre->now);
	if (station->poll != 0) {
		iec104_poll_put_off(poll, now_ns);
	} else {
		station->due_ns = now_ns + FULL_NS;
		leave_window(station);
	}
}

/* One poll at a time: the next one is due when the last has ended. */
static int64_t poll_due(const struct centre_station *station)
{
	const struct iec104_poll *poll = next_poll(station);

	if (station->poll != 0 || station->waits || poll == NULL)
		return INT64_MAX;
	return later(poll->due_ns, station->due_ns);
}

static void ask_next(struct centre_station *station)
{
	if (station->centre->now.monotonic_ns < poll_due(station))
		return;
	if (enter_window(station, station->slow ? CENTRE_POLL_SLOW : CENTRE_POLL))
		send_poll(station);
}

/* ---- what a station says ----------------------------------------------------------------- */

static void on_information(void *context, const struct iec104_asdu *asdu,
			   const struct iec104_information *information)
{
	struct centre_station *station = context;
	struct centre_record *record = centre_say_asdu(station, CENTRE_INFORMATION, asdu);

	record->ioa = information->ioa;
	record->quality = information->quality;
	record->detail = information->detail;
	record->information.value = information->value;
	record->information.elapsed_ms = information->elapsed_ms;
	record->information.content = (uint8_t)information->content;
	centre_record_time(record, information->tagged, information->time_invalid, information->wall_ns);
	if (information->content == IEC104_INITIALISATION)
		iec104_polls_renew(station->polls, station->plan->poll_count, asdu->ca,
				   station->centre->now.monotonic_ns);
}

static void on_position(void *context, const struct iec104_asdu *asdu, uint32_t ioa,
			const struct iec104_geoposition *position)
{
	struct centre_record *record = centre_say_asdu(context, CENTRE_POSITION, asdu);

	record->ioa = ioa;
	record->quality = position->quality;
	record->detail = (uint8_t)(position->fix | position->satellites << 4);
	record->position.latitude = position->latitude;
	record->position.longitude = position->longitude;
	record->position.altitude_dm = position->altitude_dm;
	centre_record_time(record, true, position->time_invalid, position->wall_ns);
}

static void end_poll(struct centre_station *station, const struct iec104_controlling_request *request)
{
	bool done = request->state == MAP_EXECUTED_COMMAND;

	station->poll = 0;
	if (!done)
		iec104_polls_failed(station->polls, station->plan->poll_count, request,
				    station->centre->now.monotonic_ns);
	/* A refusal that comes at once is no slowness. */
	station->slow = station->window == CENTRE_NO_WINDOW;
	leave_window(station);
	if (!done || request->type != IEC104_C_RD_NA_1) /* the value says that it was read */
		centre_say_progress(station, request, 0);
}

struct centre_order *centre_order_of(struct centre_station *station, uint32_t request)
{
	for (unsigned i = 0; i < IEC104_CONTROLLING_REQUESTS_MAX; i++)
		if (station->orders[i].request == request)
			return &station->orders[i];
	return NULL;
}

static void on_progress(void *context, const struct iec104_controlling_request *request)
{
	struct centre_station *station = context;
	struct centre_order *order;

	if (request->id == station->poll) {
		if (iec104_controlling_has_ended(request->state))
			end_poll(station, request);
		return;
	}
	order = centre_order_of(station, request->id);
	if (order == NULL)
		return;
	centre_say_progress(station, request, order->id);
	if (iec104_controlling_has_ended(request->state))
		order->request = 0;
}

/* Each ASDU ends with a record, by which it is acknowledged. */
static void on_looked_at(void *context, const struct iec104_asdu *asdu)
{
	struct centre_station *station = context;

	if (station->last == NULL)
		centre_say_asdu(station, CENTRE_OTHER, asdu);
	station->last->flags |= CENTRE_LAST;
	station->last = NULL;
}

/* ---- the connection ---------------------------------------------------------------------- */

static bool has_session(const struct centre_station *station)
{
	return station->link == CENTRE_STARTING || station->link == CENTRE_UP ||
	       station->link == CENTRE_STANDBY;
}

static int64_t session_due(const struct centre_station *station)
{
	int64_t due_ns = iec104_controlling_deadline(&station->controlling);

	if (station->controlling.session.closing != IEC104_OPEN || channel_pending(&station->channel))
		return station->centre->now.monotonic_ns;
	if (station->link == CENTRE_UP)
		due_ns = earlier(due_ns, poll_due(station));
	return station->plan->secure ? earlier(due_ns, station->channel.look_ns) : due_ns;
}

void centre_station_schedule(struct centre_station *station)
{
	int64_t due_ns = INT64_MAX;

	switch ((enum centre_link)station->link) {
	case CENTRE_WAITING:
	case CENTRE_DOWN:
		due_ns = station->waits ? INT64_MAX : station->due_ns;
		break;
	case CENTRE_CONNECTING:
	case CENTRE_SECURING:
		due_ns = station->due_ns;
		break;
	case CENTRE_UP:
	case CENTRE_STARTING:
	case CENTRE_STANDBY:
		due_ns = session_due(station);
		break;
	}
	if (station->window != CENTRE_NO_WINDOW)
		due_ns = earlier(due_ns, station->place_until_ns);
	centre_deadlines_set(&station->centre->deadlines, centre_place_of(station), due_ns);
}

static void wait_for(struct centre_station *station, uint32_t events)
{
	struct epoll_event event = {.events = events, .data.u32 = centre_place_of(station)};

	if (events == station->events)
		return;
	epoll_ctl(station->centre->epoll, station->events == 0 ? EPOLL_CTL_ADD : EPOLL_CTL_MOD,
		  station->channel.fd, &event);
	station->events = events;
}

void centre_station_close(struct centre_station *station)
{
	if (station->channel.fd >= 0)
		channel_close(&station->channel);
	station->channel = (struct channel){.fd = -1};
	station->events = 0;
	station->poll = 0;
	station->waits = false; /* whoever is connected waits for a poll: centre_admit_next passes over it */
	leave_window(station);
	memset(station->orders, 0, sizeof(station->orders));
}

/* The connection is over, or there was none: again later, and later each time. */
static void go_down(struct centre_station *station, uint8_t reason, int error)
{
	int64_t now_ns = station->centre->now.monotonic_ns, pause_ns;
	bool waited = station->waits;

	station->failed = (station->link != CENTRE_UP && station->link != CENTRE_STANDBY) ||
			  !retry_has_lasted(&station->retry, now_ns);
	if (!station->failed)
		retry_was_useful(&station->retry);
	pause_ns = retry_failed(&station->retry);
	centre_station_close(station);
	station->waits = waited; /* it is still in the window's queue */
	station->link = CENTRE_WAITING;
	station->due_ns = now_ns + pause_ns;
	centre_say_link(station, CENTRE_DOWN, reason, error, pause_ns);
}

static void start(struct centre_station *station)
{
	station->link = CENTRE_STARTING;
	iec104_session_start(&station->controlling.session, station->centre->now.monotonic_ns);
}

/*
 * Octets as they came or went. What a station may say needs its room; there are then at least as many records as octets of
 * its buffers, but what a trace takes must be beside that.
 */
static void trace(struct centre_station *station, uint8_t direction, const uint8_t *octets, size_t size)
{
	struct centre *centre = station->centre;
	size_t needed = (size_t)centre->config->receive_octets + CENTRE_RECORDS_BESIDE + size;

	if (!station->traced || size == 0)
		return;
	if (centre->consumer < 0 || centre_batches_room(&centre->batches) < needed) {
		station->gap = true;
		return;
	}
	for (size_t at = 0, count; at < size; at += count) {
		struct centre_record *record = centre_record_add(
		    centre, centre_config_place(centre->config, station->number), CENTRE_OCTETS);

		count = size - at < CENTRE_OCTETS_SIZE ? size - at : CENTRE_OCTETS_SIZE;
		record->flags = (uint8_t)(direction | (station->gap ? CENTRE_GAP : 0));
		record->connection = station->connection;
		record->ca = (uint16_t)count;
		record->seen_ns = centre->now.wall_ns;
		memcpy(record->octets, octets + at, count);
		station->gap = false;
	}
}

void centre_station_transmit(struct centre_station *station)
{
	struct iec104_session *session = &station->controlling.session;
	size_t size;
	const uint8_t *octets = iec104_session_output(session, &size);

	trace(station, CENTRE_SENT, octets + station->unwritten, size - station->unwritten);
	iec104_transmit(&station->channel, session);
	iec104_session_output(session, &size);
	station->unwritten = (uint16_t)size;
	wait_for(station, iec104_interest(&station->channel, &station->controlling.session));
}

/* The link that had data transfer is gone: the other has it, at once. */
static void hand_over(struct centre_station *station)
{
	struct centre_station *partner = station->partner;

	if (partner == NULL || partner->link != CENTRE_STANDBY)
		return;
	start(partner);
	centre_station_transmit(partner);
	centre_station_schedule(partner);
}

static bool is_active(const struct centre_station *station)
{
	return station->link == CENTRE_STARTING || station->link == CENTRE_UP;
}

static void open_session(struct centre_station *station)
{
	leave_window(station);
	iec104_controlling_open(&station->controlling, &station->settings, &station->listener,
				&station->memory, station->centre->now);
	iec104_session_hold(&station->controlling.session);
	station->unwritten = 0;
	if (station->partner == NULL || !is_active(station->partner)) {
		start(station);
		return;
	}
	station->link = CENTRE_STANDBY;
	retry_opened(&station->retry, station->centre->now.monotonic_ns);
	centre_say_link(station, CENTRE_STANDBY, 0, 0, 0);
}

static void lose(struct centre_station *station, uint8_t reason, int error)
{
	bool active = is_active(station);

	go_down(station, reason, error);
	if (active)
		hand_over(station);
}

/* What has become of the channel. */
static void settle(struct centre_station *station, enum channel_progress progress)
{
	switch (progress) {
	case CHANNEL_READY:
		open_session(station);
		return;
	case CHANNEL_WAITS:
		station->link = CENTRE_SECURING;
		wait_for(station, station->channel.wants);
		return;
	case CHANNEL_REFUSED:
		go_down(station, IEC104_NOT_SECURE, 0);
	}
}

/* The socket is connected. */
static void open_channel(struct centre_station *station)
{
	settle(station, channel_connect(&station->channel, station->channel.fd, station->plan->name,
					station->plan->secure, &station->security));
}

static int connect_socket(const struct centre_station *station)
{
	const bool second = station->number != centre_place_of(station);
	const struct sockaddr_in6 address = {.sin6_family = AF_INET6,
					     .sin6_port = htons(station->plan->port),
					     .sin6_addr = station->plan->addresses[second]};

	return connect(station->channel.fd, (const struct sockaddr *)&address, sizeof(address));
}

/* The station has a place in a window. */
static void connect_now(struct centre_station *station)
{
	int on = 1, off = 0;

	station->connection = ++station->centre->stations[station->number].connections;
	centre_say_link(station, CENTRE_CONNECTING, 0, 0, 0);
	station->link = CENTRE_CONNECTING;
	station->due_ns = station->centre->now.monotonic_ns + station->centre->config->connect_ns;
	station->channel.fd = socket(AF_INET6, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
	if (station->channel.fd < 0) {
		go_down(station, 0, errno);
		return;
	}
	setsockopt(station->channel.fd, IPPROTO_IPV6, IPV6_V6ONLY, &off, sizeof(off));
	setsockopt(station->channel.fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
	if (connect_socket(station) < 0 && errno != EINPROGRESS)
		go_down(station, 0, errno);
	else /* one that is connected already is writable, too */
		wait_for(station, EPOLLIN | EPOLLOUT);
}

static void finish_connecting(struct centre_station *station)
{
	int error = 0;
	socklen_t size = sizeof(error);

	if (getsockopt(station->channel.fd, SOL_SOCKET, SO_ERROR, &error, &size) < 0)
		error = errno;
	if (error != 0)
		go_down(station, 0, error);
	else
		open_channel(station);
}

static void receive(struct centre_station *station)
{
	struct iec104_session *session = &station->controlling.session;
	uint16_t before = (uint16_t)(session->input_end - session->input_begin);

	iec104_receive(&station->channel, session);
	trace(station, 0, session->memory.input + session->input_begin + before,
	      (size_t)(session->input_end - session->input_begin - before));
}

static void become_up(struct centre_station *station)
{
	station->link = CENTRE_UP;
	retry_opened(&station->retry, station->centre->now.monotonic_ns);
	station->slow = false;
	centre_say_link(station, CENTRE_UP, 0, 0, 0);
	iec104_polls_begin(station->polls, station->plan->poll_count, station->centre->now.monotonic_ns);
	station->due_ns = 0;
}

/* All there is to do on a connection. */
static void run(struct centre_station *station)
{
	struct iec104_session *session = &station->controlling.session;

	station->last = NULL;
	iec104_controlling_run(&station->controlling, station->centre->now);
	if (station->link == CENTRE_STARTING && session->started)
		become_up(station);
	if (station->link == CENTRE_UP && session->closing == IEC104_OPEN)
		ask_next(station);
	if (!channel_keep(&station->channel, station->centre->now.monotonic_ns))
		iec104_session_close(session, IEC104_NOT_SECURE);
	centre_station_transmit(station);
	if (session->closing != IEC104_OPEN) {
		iec104_controlling_run(&station->controlling, station->centre->now); /* ends the requests */
		lose(station, (uint8_t)session->closing, 0);
	}
}

static void advance(struct centre_station *station)
{
	int64_t now_ns = station->centre->now.monotonic_ns;

	switch ((enum centre_link)station->link) {
	case CENTRE_WAITING:
	case CENTRE_DOWN:
		if (!station->waits && now_ns >= station->due_ns &&
		    enter_window(station, station->failed ? CENTRE_CONNECT_AGAIN : CENTRE_CONNECT))
			connect_now(station);
		break;
	case CENTRE_CONNECTING:
	case CENTRE_SECURING:
		if (now_ns >= station->due_ns)
			go_down(station, 0, ETIMEDOUT);
		break;
	case CENTRE_STARTING:
	case CENTRE_UP:
	case CENTRE_STANDBY:
		run(station);
		break;
	}
}

/* What TLS has and the socket has not any more, epoll does not tell of. */
static void run_with_pending(struct centre_station *station)
{
	run(station);
	while (has_session(station) && channel_pending(&station->channel) &&
	       centre_has_room(station->centre)) {
		receive(station);
		run(station);
	}
}

void centre_station_ready(struct centre_station *station, uint32_t events)
{
	if (station->link == CENTRE_CONNECTING)
		finish_connecting(station);
	else if (station->link == CENTRE_SECURING)
		settle(station, channel_handshake(&station->channel));
	else if (has_session(station) && (events & ~(uint32_t)EPOLLOUT) != 0)
		receive(station);
	else if (has_session(station) && station->channel.wants != 0)
		receive(station); /* it waits for the socket to be writable */
	if (has_session(station))
		run_with_pending(station);
	centre_station_schedule(station);
}

void centre_station_due(struct centre_station *station)
{
	int64_t due_ns = station->centre->deadlines.due_ns[centre_place_of(station)];

	if (has_session(station) &&
	    (station->centre->now.monotonic_ns - due_ns > LATE_NS || channel_pending(&station->channel)))
		receive(station);
	lose_patience(station);
	advance(station);
	centre_station_schedule(station);
}

/* Its turn in the window has come; a station may have lost its connection, or its wish, while it waited. */
static void take_turn(struct centre_station *station, uint8_t window)
{
	bool connects = window == CENTRE_CONNECT || window == CENTRE_CONNECT_AGAIN;

	take_place(station, window);
	if (connects && station->link == CENTRE_WAITING) {
		connect_now(station);
	} else if (!connects && station->link == CENTRE_UP) {
		send_poll(station);
		run(station);
	} else {
		leave_window(station);
	}
	centre_station_schedule(station);
}

bool centre_admit_next(struct centre *centre)
{
	for (uint8_t window = 0; window < CENTRE_WINDOWS; window++) {
		uint32_t station = centre_window_admit(&centre->windows[window]);

		if (station == CENTRE_NOBODY)
			continue;
		take_turn(&centre->stations[station], window);
		return true;
	}
	return false;
}

/* ---- for the consumer -------------------------------------------------------------------- */

void centre_station_release(struct centre *centre, const struct centre_record *record)
{
	struct centre_station *station;
	struct iec104_session *session;
	uint32_t number;

	if (!centre_config_station(centre->config, record->station, &number))
		return; /* never: this process wrote the record */
	station = &centre->stations[number];
	if (record->connection != station->connection && station->partner != NULL)
		station = station->partner;
	session = &station->controlling.session;
	if (record->connection != station->connection || station->link != CENTRE_UP)
		return; /* the connection has ended: the station will send it again */
	iec104_session_release(session, 1, centre->now.monotonic_ns);
	iec104_session_run(session, centre->now.monotonic_ns);
	if (session->closing == IEC104_OPEN)
		centre_station_transmit(station);
	centre_station_schedule(station);
}

void centre_station_init(struct centre *centre, uint32_t i, uint32_t number)
{
	const struct centre_config *config = centre->config;
	struct centre_station *station = &centre->stations[i];
	size_t octets = (size_t)config->receive_octets + config->send_octets;

	station->centre = centre;
	station->number = number;
	station->plan = &config->stations[number];
	station->security.certificate = station->plan->certificate;
	station->polls = &config->polls[station->plan->first_poll];
	station->channel.fd = -1;
	station->window = CENTRE_NO_WINDOW;
	station->settings = config->common;
	station->settings.originator = station->plan->originator;
	station->settings.position_type = station->plan->position_type;
	station->listener = (struct iec104_controlling_listener){.context = station,
								 .information = on_information,
								 .position = on_position,
								 .progress = on_progress,
								 .looked_at = on_looked_at};
	if (!station->plan->terminates)
		station->settings.termination_ns = 0;
	station->memory =
	    (struct iec104_memory){.sent_ns = centre->sent_ns + (size_t)i * config->common.times.k,
				   .input = centre->octets + i * octets,
				   .output = centre->octets + i * octets + config->receive_octets,
				   .input_size = config->receive_octets,
				   .output_size = config->send_octets};
}
