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

#include "centre/request.h"
#include "map/time_ns.h"

#define LATE_NS                                                                                              \
	(100 * NS_PER_MS) /* we were stopped, or full: what came meanwhile is read before a timer counts */
#define FULL_NS (100 * NS_PER_MS) /* until a poll is tried again that could not be sent */

static uint32_t place_of(const struct centre_station *station)
{
	return (uint32_t)(station - station->centre->stations);
}

/* ---- records ----------------------------------------------------------------------------- */

bool centre_has_room(const struct centre *centre)
{
	return centre_batches_room(&centre->batches) >=
	       (size_t)centre->config->receive_octets + CENTRE_RECORDS_BESIDE;
}

/* Of a place in the file. */
static struct centre_record *add(struct centre *centre, uint32_t place, enum centre_kind kind)
{
	struct centre_record *record = &centre->nowhere;

	if (centre->consumer >= 0) {
		if (centre_batches_room(&centre->batches) == 0)
			abort(); /* CENTRE_RECORDS_BESIDE is wrong: nothing may be lost unnoticed */
		record = centre_batches_add(&centre->batches);
	}
	record->kind = (uint8_t)kind;
	record->station = place;
	return record;
}

static struct centre_record *say(struct centre_station *station, enum centre_kind kind)
{
	struct centre_record *record =
	    add(station->centre, centre_config_place(station->centre->config, station->number), kind);

	record->connection = station->connection;
	record->received_ns = station->centre->now.wall_ns;
	station->last = record;
	return record;
}

static struct centre_record *say_asdu(struct centre_station *station, enum centre_kind kind,
				      const struct iec104_asdu *asdu)
{
	struct centre_record *record = say(station, kind);

	record->flags = (uint8_t)((asdu->test ? CENTRE_TEST : 0) | (asdu->negative ? CENTRE_NEGATIVE : 0));
	record->ca = asdu->ca;
	record->type = asdu->type;
	record->cause = asdu->cause;
	return record;
}

static void say_link(struct centre_station *station, enum centre_link link, uint8_t reason, int error,
		     int64_t retry_ns)
{
	struct centre_record *record = say(station, CENTRE_LINK);

	record->detail = station->number != place_of(station);
	record->link.state = (uint8_t)link;
	record->link.reason = reason;
	record->link.error = (uint32_t)error;
	record->link.retry_ms = (uint32_t)(retry_ns / NS_PER_MS);
}

static void say_progress(struct centre_station *station, const struct iec104_controlling_request *request,
			 uint64_t id)
{
	struct centre_record *record = say(station, CENTRE_PROGRESS);

	record->ca = request->ca;
	record->ioa = request->ioa;
	record->type = request->type;
	record->cause = request->cause;
	record->progress.state = request->state;
	record->progress.result = request->result;
	record->progress.id_low = (uint32_t)id;
	record->progress.id_high = (uint32_t)(id >> 32);
}

static void set_time(struct centre_record *record, bool tagged, bool invalid, int64_t wall_ns)
{
	record->flags |= (uint8_t)((tagged ? CENTRE_TAGGED : 0) | (invalid ? CENTRE_TIME_INVALID : 0));
	record->wall_ns = wall_ns;
}

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
	if (!centre_window_enter(&station->centre->windows[window], place_of(station))) {
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
	struct centre_record *record = say_asdu(station, CENTRE_INFORMATION, asdu);

	record->ioa = information->ioa;
	record->quality = information->quality;
	record->detail = information->detail;
	record->information.value = information->value;
	record->information.elapsed_ms = information->elapsed_ms;
	record->information.content = (uint8_t)information->content;
	set_time(record, information->tagged, information->time_invalid, information->wall_ns);
	if (information->content == IEC104_INITIALISATION)
		iec104_polls_renew(station->polls, station->plan->poll_count, asdu->ca,
				   station->centre->now.monotonic_ns);
}

static void on_position(void *context, const struct iec104_asdu *asdu, uint32_t ioa,
			const struct iec104_geoposition *position)
{
	struct centre_record *record = say_asdu(context, CENTRE_POSITION, asdu);

	record->ioa = ioa;
	record->quality = position->quality;
	record->detail = (uint8_t)(position->fix | position->satellites << 4);
	record->position.latitude = position->latitude;
	record->position.longitude = position->longitude;
	record->position.altitude_dm = position->altitude_dm;
	set_time(record, true, position->time_invalid, position->wall_ns);
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
		say_progress(station, request, 0);
}

static struct centre_order *order_of(struct centre_station *station, uint32_t request)
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
	order = order_of(station, request->id);
	if (order == NULL)
		return;
	say_progress(station, request, order->id);
	if (iec104_controlling_has_ended(request->state))
		order->request = 0;
}

/* Each ASDU ends with a record, by which it is acknowledged. */
static void on_looked_at(void *context, const struct iec104_asdu *asdu)
{
	struct centre_station *station = context;

	if (station->last == NULL)
		say_asdu(station, CENTRE_OTHER, asdu);
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

static void schedule(struct centre_station *station)
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
	centre_deadlines_set(&station->centre->deadlines, place_of(station), due_ns);
}

static void wait_for(struct centre_station *station, uint32_t events)
{
	struct epoll_event event = {.events = events, .data.u32 = place_of(station)};

	if (events == station->events)
		return;
	epoll_ctl(station->centre->epoll, station->events == 0 ? EPOLL_CTL_ADD : EPOLL_CTL_MOD,
		  station->channel.fd, &event);
	station->events = events;
}

static void close_connection(struct centre_station *station)
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
	close_connection(station);
	station->waits = waited; /* it is still in the window's queue */
	station->link = CENTRE_WAITING;
	station->due_ns = now_ns + pause_ns;
	say_link(station, CENTRE_DOWN, reason, error, pause_ns);
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
		struct centre_record *record =
		    add(centre, centre_config_place(centre->config, station->number), CENTRE_OCTETS);

		count = size - at < CENTRE_OCTETS_SIZE ? size - at : CENTRE_OCTETS_SIZE;
		record->flags = (uint8_t)(direction | (station->gap ? CENTRE_GAP : 0));
		record->connection = station->connection;
		record->ca = (uint16_t)count;
		record->seen_ns = centre->now.wall_ns;
		memcpy(record->octets, octets + at, count);
		station->gap = false;
	}
}

static void transmit(struct centre_station *station)
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
	transmit(partner);
	schedule(partner);
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
	say_link(station, CENTRE_STANDBY, 0, 0, 0);
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
	const bool second = station->number != place_of(station);
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
	say_link(station, CENTRE_CONNECTING, 0, 0, 0);
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
	say_link(station, CENTRE_UP, 0, 0, 0);
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
	transmit(station);
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
	schedule(station);
}

void centre_station_due(struct centre_station *station)
{
	int64_t due_ns = station->centre->deadlines.due_ns[place_of(station)];

	if (has_session(station) &&
	    (station->centre->now.monotonic_ns - due_ns > LATE_NS || channel_pending(&station->channel)))
		receive(station);
	lose_patience(station);
	advance(station);
	schedule(station);
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
	schedule(station);
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
		transmit(station);
	schedule(station);
}

static void say_not_sent(struct centre *centre, const struct centre_request *request, uint8_t result)
{
	struct centre_record *record = add(centre, request->station, CENTRE_PROGRESS);
	bool selects = request->kind == CENTRE_COMMAND && (request->flags & CENTRE_SELECT) != 0;

	record->received_ns = centre->now.wall_ns;
	record->ca = request->ca;
	record->ioa = request->ioa;
	record->progress.state = selects ? MAP_REFUSED_SELECTION : MAP_REFUSED_COMMAND;
	record->progress.result = result;
	record->progress.id_low = (uint32_t)request->id;
	record->progress.id_high = (uint32_t)(request->id >> 32);
}

static const struct iec104_controlling_request *request_of(const struct centre_station *station, uint32_t id)
{
	for (unsigned i = 0; i < IEC104_CONTROLLING_REQUESTS_MAX; i++)
		if (station->controlling.requests[i].id == id)
			return &station->controlling.requests[i];
	return NULL;
}

static struct centre_order *order_of_id(struct centre_station *station, uint64_t id)
{
	for (unsigned i = 0; i < IEC104_CONTROLLING_REQUESTS_MAX; i++)
		if (station->orders[i].request != 0 && station->orders[i].id == id)
			return &station->orders[i];
	return NULL;
}

/* Executes or cancels what was selected. */
static bool go_on(struct centre_station *station, const struct centre_request *request)
{
	struct centre_order *order = order_of_id(station, request->id);
	struct iec104_moment now = station->centre->now;

	if (order == NULL)
		return false;
	return request->kind == CENTRE_EXECUTE
		   ? iec104_controlling_execute(&station->controlling, order->request, now)
		   : iec104_controlling_cancel(&station->controlling, order->request, now);
}

static uint32_t post_order(struct centre_station *station, const struct centre_request *request,
			   const struct iec104_command *command)
{
	struct iec104_controlling *controlling = &station->controlling;
	struct iec104_moment now = station->centre->now;

	switch (request->kind) {
	case CENTRE_COMMAND:
		return iec104_controlling_command(controlling, request->ca, command, now);
	case CENTRE_INTERROGATE:
		return iec104_controlling_interrogate(controlling, request->ca, request->qualifier, now);
	case CENTRE_COUNTERS:
		return iec104_controlling_interrogate_counters(controlling, request->ca, request->qualifier,
							       now);
	case CENTRE_READ:
		return iec104_controlling_read(controlling, request->ca, request->ioa, now);
	case CENTRE_TEST_COMMAND:
		return iec104_controlling_test(controlling, request->ca, (uint16_t)request->value.u, now);
	case CENTRE_RESET:
		return iec104_controlling_reset(controlling, request->ca, request->qualifier, now);
	default:
		return iec104_controlling_set_clock(controlling, request->ca, now);
	}
}

/* MAP_RESULT_NONE: it was sent. */
static uint8_t try_order(struct centre_station *station, const struct centre_request *request)
{
	struct centre_order *order = order_of(station, 0);
	struct iec104_command command = {0};
	bool goes_on = request->kind == CENTRE_EXECUTE || request->kind == CENTRE_CANCEL;

	if (station->link != CENTRE_UP)
		return CENTRE_NOT_UP;
	if (!centre_has_room(station->centre))
		return CENTRE_BUSY; /* nor would the answer be read now */
	if (goes_on && !go_on(station, request))
		return CENTRE_NOT_KNOWN;
	if (goes_on)
		return MAP_RESULT_NONE;
	if (order_of_id(station, request->id) != NULL)
		return MAP_RESULT_INTERLOCK;
	if (request->kind == CENTRE_COMMAND && !centre_request_command(request, &command))
		return MAP_RESULT_OUT_OF_RANGE;
	if (order == NULL)
		return CENTRE_BUSY;
	order->request = post_order(station, request, &command);
	order->id = request->id;
	if (order->request == 0)
		return CENTRE_BUSY;
	return MAP_RESULT_NONE;
}

void centre_station_order(struct centre *centre, const struct centre_request *request)
{
	struct centre_station *station;
	uint32_t number;
	uint8_t result;

	if (!centre_config_station(centre->config, request->station, &number)) {
		say_not_sent(centre, request, CENTRE_NOT_KNOWN);
		return;
	}
	station = &centre->stations[number];
	if (request->kind == CENTRE_TRACE) {
		station->traced = request->value.u == 1;
		if (station->partner != NULL)
			station->partner->traced = station->traced;
		return;
	}
	if (station->partner != NULL && station->partner->link == CENTRE_UP)
		station = station->partner;
	result = try_order(station, request);
	if (result != MAP_RESULT_NONE) {
		say_not_sent(centre, request, result);
		return;
	}
	say_progress(station, request_of(station, order_of_id(station, request->id)->request), request->id);
	transmit(station);
	schedule(station);
}

/* ---- all of them ------------------------------------------------------------------------- */

bool centre_tell_next(struct centre *centre)
{
	struct centre_record *record;

	if (centre->told == centre->config->station_count)
		return false;
	record = add(centre, centre_config_place(centre->config, centre->told), CENTRE_STATION);
	memcpy(record->name, centre->config->stations[centre->told].name, CENTRE_NAME_SIZE);
	centre->told++;
	return true;
}

void centre_stations_begin(struct centre *centre)
{
	centre_batches_reset(&centre->batches);
	centre->told = 0;
	for (uint32_t i = 0; i < centre->config->link_count; i++) {
		struct centre_station *station = &centre->stations[i];

		station->due_ns = centre->now.monotonic_ns;
		station->retry = retry_begin(centre->config->retry_ns, centre->config->retry_max_ns);
		station->failed = station->slow = station->waits = false;
		station->traced = station->gap = false;
		schedule(station);
	}
}

void centre_stations_end(struct centre *centre)
{
	for (unsigned i = 0; i < CENTRE_WINDOWS; i++)
		centre_window_clear(&centre->windows[i]);
	for (uint32_t i = 0; i < centre->config->link_count; i++) {
		struct centre_station *station = &centre->stations[i];

		station->window = CENTRE_NO_WINDOW;
		close_connection(station);
		station->link = CENTRE_WAITING;
		centre_deadlines_set(&centre->deadlines, i, INT64_MAX);
	}
}

size_t centre_octets_of_station(const struct centre_config *config)
{
	return sizeof(struct centre_station) + config->receive_octets + config->send_octets +
	       config->common.times.k * sizeof(int64_t) + sizeof(int64_t) + 3 * sizeof(uint32_t) +
	       sizeof(struct centre_plan);
}

/* i: of a link; it is the first one of station i, or a second one. */
static void init_station(struct centre *centre, uint32_t i, uint32_t number)
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

bool centre_stations_init(struct centre *centre, const struct centre_config *config)
{
	const uint32_t count = config->link_count;

	*centre = (struct centre){.config = config, .consumer = -1};
	centre->epoll = epoll_create1(EPOLL_CLOEXEC);
	centre->next = calloc(count, sizeof(*centre->next));
	centre->stations = calloc(count, sizeof(*centre->stations));
	centre->octets = calloc(count, (size_t)config->receive_octets + config->send_octets);
	centre->sent_ns = calloc((size_t)count * config->common.times.k, sizeof(*centre->sent_ns));
	if (centre->epoll < 0 || centre->next == NULL || centre->stations == NULL || centre->octets == NULL ||
	    centre->sent_ns == NULL || !centre_deadlines_init(&centre->deadlines, count) ||
	    !centre_batches_init(&centre->batches, config->batches, config->batch_records,
				 config->batches_in_flight))
		return false;
	for (unsigned i = 0; i < CENTRE_WINDOWS; i++)
		centre_window_init(&centre->windows[i],
				   i < CENTRE_POLL ? config->connections_at_once : config->polls_at_once,
				   centre->next);
	for (uint32_t i = 0; i < config->station_count; i++) {
		struct centre_station *first = &centre->stations[i];

		init_station(centre, i, i);
		if (config->stations[i].address_count == 1)
			continue;
		first->partner = &centre->stations[config->stations[i].second];
		init_station(centre, config->stations[i].second, i);
		first->partner->partner = first;
	}
	return true;
}

void centre_stations_free(struct centre *centre)
{
	if (centre->epoll >= 0)
		close(centre->epoll);
	centre_batches_free(&centre->batches);
	centre_deadlines_free(&centre->deadlines);
	for (uint32_t i = 0; centre->stations != NULL && i < centre->config->link_count; i++)
		channel_forget(&centre->stations[i].security);
	free(centre->next);
	free(centre->stations);
	free(centre->octets);
	free(centre->sent_ns);
}
