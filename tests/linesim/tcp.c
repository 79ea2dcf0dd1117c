/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <errno.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "line.h"
#include "trace.h"

#define HEADER    7 /* transaction, protocol, length: two octets each; the unit */
#define PREFIX    6 /* what the length does not count */
#define BACKLOG   4
#define MS        1000000
#define READ_SIZE 1024

static void put_out(struct tcp_session *session)
{
	close(session->source.fd);
	session->source.fd = -1;
}

/* ---- requests ---------------------------------------------------------------------------- */

static size_t whole_size(const struct tcp_session *session)
{
	return PREFIX + (size_t)(session->request[4] << 8 | session->request[5]);
}

/* No frame of Modbus: where the next one begins is unknown. */
static bool is_nonsense(const struct tcp_session *session)
{
	return session->request_size >= PREFIX &&
	       (session->request[2] || session->request[3] || whole_size(session) <= HEADER ||
		whole_size(session) > TCP_FRAME_MAX);
}

static void frame_answer(struct tcp_answer *answer, const uint8_t *request, const uint8_t *pdu, size_t size)
{
	memcpy(answer->bytes, request, HEADER);
	answer->bytes[4] = 0;
	answer->bytes[5] = (uint8_t)(size + 1);
	memcpy(answer->bytes + HEADER, pdu, size);
	answer->size = HEADER + size;
}

/* What a device says comes behind what it was asked before. */
static int64_t not_before_ns(const struct tcp_session *session, int64_t at_ns)
{
	const int64_t last_ns =
	    session->waiting_count ? session->waiting[session->waiting_count - 1].at_ns : 0;

	return last_ns > at_ns ? last_ns : at_ns;
}

static void serve(struct tcp_session *session, struct slave *slave, int64_t now_ns)
{
	struct line *line = session->line;
	const uint8_t *request = session->request;
	const struct slave_fault fault = slave_take_fault(slave, request[HEADER]);
	const bool slow = fault.kind == SLAVE_DELAY || fault.kind == SLAVE_LATE;
	const int64_t ready_ns = now_ns + line->latency_ns + (slow ? (int64_t)fault.argument * MS : 0);
	struct tcp_answer *answer;
	uint8_t pdu[SLAVE_PDU_MAX];
	size_t size;

	slave->stats.requests++;
	if (!slave_hears(slave, &fault, now_ns))
		return;
	size = line_execute(line, slave, &fault, request + HEADER, session->request_size - HEADER, pdu);
	if (session->waiting_count == TCP_WAITING_MAX) {
		line->stats.dropped++;
		return;
	}
	slave->stats.exceptions += pdu[0] >> 7;
	answer = &session->waiting[session->waiting_count];
	answer->slave = slave;
	answer->at_ns = not_before_ns(session, ready_ns);
	slave_answered(slave, &fault, answer->at_ns);
	frame_answer(answer, request, pdu, size);
	session->waiting_count++;
}

static void take_request(struct tcp_session *session, int64_t now_ns)
{
	struct line *line = session->line;
	const uint8_t unit = session->request[PREFIX];
	struct slave *slave = unit <= SLAVE_UNIT_MAX ? line->slaves[unit] : NULL;

	trace_frame(line->port, unit, TRACE_RECEIVED, session->request, session->request_size, SLAVE_HEALTHY);
	session->heard_ns = now_ns;
	if (!slave) {
		line->stats.foreign++;
		return;
	}
	line->stats.requests++;
	serve(session, slave, now_ns);
}

/* False: what it says is no Modbus. */
static bool take_octet(struct tcp_session *session, uint8_t octet, int64_t now_ns)
{
	session->request[session->request_size++] = octet;
	if (is_nonsense(session))
		return false;
	if (session->request_size >= PREFIX && session->request_size == whole_size(session)) {
		take_request(session, now_ns);
		session->request_size = 0;
	}
	return true;
}

static void session_ready(void *owner, uint32_t events)
{
	struct tcp_session *session = owner;
	uint8_t octets[READ_SIZE];
	ssize_t size;

	(void)events;
	if (session->source.fd < 0) /* put out earlier in this round of events */
		return;
	size = recv(session->source.fd, octets, sizeof octets, 0);
	if (size == 0 || (size < 0 && errno != EAGAIN && errno != EINTR)) {
		put_out(session);
		return;
	}
	if (session->hung || session->line->unplugged)
		return;
	for (ssize_t i = 0; i < size; i++) {
		if (!take_octet(session, octets[i], loop_now_ns())) {
			put_out(session);
			return;
		}
	}
}

static void listener_ready(void *owner, uint32_t events)
{
	struct line *line = owner;
	const int fd = accept4(line->tcp.listener.fd, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);

	(void)events;
	if (fd < 0)
		return;
	for (int i = 0; i < TCP_SESSIONS_MAX; i++) {
		struct tcp_session *session = &line->tcp.sessions[i];

		if (session->source.fd >= 0)
			continue;
		*session = (struct tcp_session){
		    .source = {.fd = fd, .ready = session_ready, .owner = session},
		    .line = line,
		    .heard_ns = loop_now_ns(),
		};
		if (loop_add(&session->source, EPOLLIN))
			put_out(session);
		return;
	}
	close(fd);
}

/* ---- answers, and what a session does of itself ------------------------------------------- */

static bool is_torn(struct tcp *tcp)
{
	return tcp->tears && ++tcp->answers % tcp->tears == 0;
}

static void send_first(struct tcp_session *session)
{
	struct line *line = session->line;
	const struct tcp_answer *answer = &session->waiting[0];

	if (is_torn(&line->tcp)) {
		put_out(session);
		return;
	}
	trace_frame(line->port, answer->slave->unit, TRACE_SENT, answer->bytes, answer->size, SLAVE_HEALTHY);
	if (send(session->source.fd, answer->bytes, answer->size, MSG_NOSIGNAL) == (ssize_t)answer->size) {
		answer->slave->stats.answers++;
		line->stats.answers++;
	}
	session->waiting_count--;
	memmove(session->waiting, session->waiting + 1, session->waiting_count * sizeof *session->waiting);
	if (line->tcp.closes)
		put_out(session);
}

/* When it has something to do next. */
static int64_t session_advance(struct tcp_session *session, int64_t now_ns)
{
	const int64_t idle_ns = session->line->tcp.idle_ns;

	while (session->source.fd >= 0 && session->waiting_count && session->waiting[0].at_ns <= now_ns)
		send_first(session);
	if (session->source.fd < 0)
		return LOOP_NEVER;
	if (session->waiting_count)
		return session->waiting[0].at_ns;
	if (!idle_ns || session->hung)
		return LOOP_NEVER;
	if (session->heard_ns + idle_ns > now_ns)
		return session->heard_ns + idle_ns;
	put_out(session);
	return LOOP_NEVER;
}

int64_t tcp_advance(struct line *line, int64_t now_ns)
{
	int64_t next_ns = LOOP_NEVER;

	for (int i = 0; i < TCP_SESSIONS_MAX; i++) {
		struct tcp_session *session = &line->tcp.sessions[i];
		const int64_t session_ns =
		    session->source.fd >= 0 ? session_advance(session, now_ns) : LOOP_NEVER;

		next_ns = session_ns < next_ns ? session_ns : next_ns;
	}
	return next_ns;
}

void tcp_hang(struct line *line)
{
	for (int i = 0; i < TCP_SESSIONS_MAX; i++) {
		line->tcp.sessions[i].hung = true;
		line->tcp.sessions[i].waiting_count = 0;
	}
}

/* ---- the socket -------------------------------------------------------------------------- */

int tcp_open(struct line *line)
{
	struct tcp *tcp = &line->tcp;
	const int on = 1;
	const int fd = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);

	for (int i = 0; i < TCP_SESSIONS_MAX; i++)
		tcp->sessions[i].source.fd = -1;
	tcp->listener = (struct loop_source){.fd = fd, .ready = listener_ready, .owner = line};
	if (fd < 0 || setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) ||
	    bind(fd, (const struct sockaddr *)&tcp->address, sizeof tcp->address) || listen(fd, BACKLOG))
		return -1;
	return loop_add(&tcp->listener, EPOLLIN);
}

void tcp_close(struct line *line)
{
	for (int i = 0; i < TCP_SESSIONS_MAX; i++)
		if (line->tcp.sessions[i].source.fd >= 0)
			put_out(&line->tcp.sessions[i]);
	close(line->tcp.listener.fd);
}
