/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/iec104m/link.h"

#include <poll.h>
#include <stdlib.h>
#include <sys/epoll.h>

#include "map/time_ns.h"

#define CONNECT_NS (10 * NS_PER_S)

_Static_assert((int)EPOLLIN == POLLIN && (int)EPOLLOUT == POLLOUT, "iec104_interest speaks of epoll");

bool link_init(struct link *link, const struct iec104_outstation *outstation, unsigned number,
	       const struct iec104_controlling_settings *settings,
	       const struct iec104_controlling_listener *listener)
{
	*link = (struct link){
	    .outstation = outstation,
	    .settings = settings,
	    .listener = listener,
	    .address = outstation->addresses[number],
	    .channel = {.fd = -1},
	    .security = {.certificate = outstation->certificate[0] != '\0' ? outstation->certificate : NULL},
	    .attempts =
		attempts_begin(outstation->retry_ms * NS_PER_MS, outstation->retry_max_ms * NS_PER_MS)};
	link->memory = (struct iec104_memory){.sent_ns = calloc(outstation->k, sizeof(int64_t)),
					      .input = link->input,
					      .output = link->output,
					      .input_size = LINK_INPUT_SIZE,
					      .output_size = LINK_OUTPUT_SIZE};
	return link->memory.sent_ns != NULL;
}

static bool has_session(const struct link *link)
{
	return link->state >= LINK_OPEN;
}

static void go_down(struct link *link, const char *reason, int64_t now_ns)
{
	link->to_be_said = attempts_failed(&link->attempts, reason, now_ns);
	if (link->channel.fd >= 0)
		channel_close(&link->channel);
	link->channel.fd = -1;
	link->state = LINK_DOWN;
	link->failures++;
	link->reason = reason;
	link->due_ns = now_ns + link->attempts.pause_ns;
}

static void open_session(struct link *link, struct iec104_moment now)
{
	link->state = LINK_OPEN;
	retry_opened(&link->attempts.retry, now.monotonic_ns);
	iec104_controlling_open(&link->controlling, link->settings, link->listener, &link->memory, now);
}

/* What has become of the channel. */
static void settle(struct link *link, enum channel_progress progress, struct iec104_moment now)
{
	switch (progress) {
	case CHANNEL_READY:
		open_session(link, now);
		return;
	case CHANNEL_WAITS:
		link->state = LINK_SECURING;
		return;
	case CHANNEL_REFUSED:
		go_down(link, "made no secure connection", now.monotonic_ns);
	}
}

static void begin_connecting(struct link *link, int64_t now_ns)
{
	link->channel.fd = tcp_connect(link->address, link->outstation->port, link->error);
	link->state = LINK_CONNECTING;
	link->due_ns = now_ns + CONNECT_NS;
	if (link->channel.fd < 0)
		go_down(link, link->error, now_ns);
}

static void finish_connecting(struct link *link, struct iec104_moment now)
{
	switch (tcp_look(link->channel.fd, link->error)) {
	case TCP_PENDING:
		if (now.monotonic_ns >= link->due_ns)
			go_down(link, "does not answer", now.monotonic_ns);
		return;
	case TCP_CONNECTED:
		settle(link,
		       channel_connect(&link->channel, link->channel.fd, link->address,
				       link->outstation->secure, &link->security),
		       now);
		return;
	case TCP_FAILED:
		go_down(link, link->error, now.monotonic_ns);
	}
}

void link_start(struct link *link, struct iec104_moment now)
{
	link->state = LINK_STARTING;
	iec104_session_start(&link->controlling.session, now.monotonic_ns);
}

static void go_on_securing(struct link *link, struct iec104_moment now)
{
	if (now.monotonic_ns >= link->due_ns)
		go_down(link, "does not answer", now.monotonic_ns);
	else
		settle(link, channel_handshake(&link->channel), now);
}

void link_receive(struct link *link)
{
	if (has_session(link))
		iec104_receive(&link->channel, &link->controlling.session);
}

static void run_session(struct link *link, struct iec104_moment now)
{
	struct iec104_session *session = &link->controlling.session;

	iec104_controlling_run(&link->controlling, now);
	if (link->state == LINK_STARTING && session->started)
		link->state = LINK_STARTED;
	/* Data transfer, or standing by, for longer than the pause before it: it is of use. */
	if (link->state != LINK_STARTING && retry_has_lasted(&link->attempts.retry, now.monotonic_ns))
		retry_was_useful(&link->attempts.retry);
	if (!channel_keep(&link->channel, now.monotonic_ns))
		iec104_session_close(session, IEC104_NOT_SECURE);
	iec104_transmit(&link->channel, session);
	if (session->closing == IEC104_OPEN)
		return;
	iec104_controlling_run(&link->controlling, now); /* ends the requests */
	go_down(link, iec104_closing_text(session->closing), now.monotonic_ns);
}

void link_run(struct link *link, struct iec104_moment now)
{
	if (link->state == LINK_DOWN && now.monotonic_ns >= link->due_ns)
		begin_connecting(link, now.monotonic_ns);
	if (link->state == LINK_CONNECTING)
		finish_connecting(link, now);
	else if (link->state == LINK_SECURING)
		go_on_securing(link, now);
	/* TLS has octets that the socket has not any more, or waits for it to be writable. */
	if (has_session(link) && (link->pending || link->channel.wants != 0))
		link_receive(link);
	if (has_session(link))
		run_session(link, now);
	link->pending = has_session(link) && channel_pending(&link->channel) &&
			(iec104_interest(&link->channel, &link->controlling.session) & EPOLLIN) != 0;
}

int64_t link_deadline(const struct link *link)
{
	if (!has_session(link))
		return link->due_ns;
	return link->pending ? 0 : iec104_controlling_deadline(&link->controlling);
}

short link_events(struct link *link)
{
	if (link->state == LINK_CONNECTING)
		return POLLOUT;
	if (link->state == LINK_SECURING)
		return (short)link->channel.wants;
	return has_session(link) ? (short)iec104_interest(&link->channel, &link->controlling.session) : 0;
}

void link_close(struct link *link)
{
	if (link->channel.fd >= 0)
		channel_close(&link->channel);
	link->channel.fd = -1;
	link->state = LINK_DOWN;
	channel_forget(&link->security);
	free(link->memory.sent_ns);
	link->memory.sent_ns = NULL;
}
