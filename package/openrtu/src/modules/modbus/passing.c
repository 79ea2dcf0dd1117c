/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/modbus/passing.h"

#include <stdio.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "channel/bare.h"
#include "map/address.h"
#include "map/time_ns.h"
#include "modbus/mbap.h"

#define ACCEPTS_A_TURN 4
#define EXCEPTION_BODY 3
#define WRITE_HEAD     4 /* unit, function, address */

/* ---- who is there ---------------------------------------------------------------------------------- */

static uint16_t port_of(const struct passing *passing)
{
	return modbus_ports(map_config(passing->map))[passing->pass->port].port;
}

static void send_away(struct passing_tool *tool)
{
	close(tool->fd);
	*tool = (struct passing_tool){.fd = -1};
}

static struct passing_tool *find_place(struct passing *passing)
{
	for (uint32_t i = 0; i < passing->pass->connections; i++)
		if (passing->tools[i].fd < 0)
			return &passing->tools[i];
	return NULL;
}

static bool listen_to(const struct passing *passing, struct passing_tool *tool, int operation, bool listening)
{
	struct epoll_event event = {.events = listening ? EPOLLIN : 0, .data.ptr = tool};

	return epoll_ctl(passing->epoll_fd, operation, tool->fd, &event) == 0;
}

static void take_in(struct passing *passing, int fd, const struct sockaddr_storage *peer, int64_t now_ns)
{
	struct passing_tool *tool = find_place(passing);
	struct in6_addr address;

	if (tool == NULL) {
		close(fd);
		if (map_repeats_happened(&passing->refused, 1, now_ns) > 0)
			map_log(passing->map, MAP_LOG_WARNING,
				"port %u: one more tool than pass_through.connections", port_of(passing));
		return;
	}
	*tool = (struct passing_tool){.fd = fd, .heard_ns = now_ns};
	address = map_address_of(peer);
	map_address_text(&address, tool->peer);
	if (!listen_to(passing, tool, EPOLL_CTL_ADD, true)) {
		send_away(tool);
		return;
	}
	map_log(passing->map, MAP_LOG_INFO, "port %u: a tool at %s is connected", port_of(passing),
		tool->peer);
}

static void accept_tools(struct passing *passing, int64_t now_ns)
{
	for (int i = 0; i < ACCEPTS_A_TURN; i++) {
		struct sockaddr_storage peer;
		socklen_t size = sizeof(peer);
		const int fd =
		    accept4(passing->listener, (struct sockaddr *)&peer, &size, SOCK_NONBLOCK | SOCK_CLOEXEC);

		if (fd < 0)
			return;
		take_in(passing, fd, &peer, now_ns);
	}
}

/* ---- what is answered ------------------------------------------------------------------------------ */

static const uint8_t *body_of(const struct passing_tool *tool)
{
	return tool->frame + MODBUS_MBAP_PREFIX;
}

static size_t length_of(const struct passing_tool *tool)
{
	return tool->count - MODBUS_MBAP_PREFIX;
}

/* Each write is said, with what became of it. */
static void log_write(const struct passing *passing, const char *peer, const uint8_t *body, size_t length,
		      const char *end)
{
	char at[16] = "";

	if (modbus_reads_only(body, length))
		return;
	if (length >= WRITE_HEAD)
		snprintf(at, sizeof(at), " at %u", modbus_register(body + 2, 0));
	map_log(passing->map, MAP_LOG_INFO, "port %u: %s writes unit %u function %u%s: %s", port_of(passing),
		peer, body[0], body[1], at, end);
}

/* A tool that does not take a whole answer has more on the way than it may. */
static void answer(struct passing *passing, struct passing_tool *tool, const uint8_t *body, size_t length)
{
	uint8_t frame[MODBUS_MBAP_FRAME_MAX];
	size_t size;

	memcpy(frame + MODBUS_MBAP_PREFIX, body, length);
	size = modbus_mbap_seal(frame, modbus_register(tool->frame, 0), length);
	tool->waiting = tool->refused = false;
	tool->tag = 0;
	tool->count = 0;
	if (bare_transmit(tool->fd, frame, size) != (ssize_t)size ||
	    !listen_to(passing, tool, EPOLL_CTL_MOD, true))
		send_away(tool);
}

static void refuse(struct passing *passing, struct passing_tool *tool, uint8_t exception, const char *why)
{
	const uint8_t *body = body_of(tool);
	const uint8_t refusal[EXCEPTION_BODY] = {body[0], body[1] | MODBUS_EXCEPTION_BIT, exception};

	log_write(passing, tool->peer, body, length_of(tool), why);
	answer(passing, tool, refusal, sizeof(refusal));
}

static void deliver(struct passing *passing, struct passing_tool *tool, const uint8_t *body, size_t length)
{
	char end[32] = "done";

	if (body[1] & MODBUS_EXCEPTION_BIT)
		snprintf(end, sizeof(end), "refused, exception %u", body[2]);
	log_write(passing, tool->peer, body_of(tool), length_of(tool), end);
	answer(passing, tool, body, length);
}

static struct passing_tool *tool_of(struct passing *passing, uint32_t tag)
{
	for (uint32_t i = 0; i < MODBUS_PASS_CONNECTIONS_MAX; i++)
		if (passing->tools[i].fd >= 0 && passing->tools[i].tag == tag)
			return &passing->tools[i];
	return NULL;
}

void passing_ended(struct passing *passing, const struct modbus_passed *passed, enum modbus_result result,
		   const uint8_t *body, size_t length, int64_t now_ns)
{
	struct passing_tool *tool = tool_of(passing, passed->tag);

	if (tool == NULL)
		log_write(passing, "a tool that has gone", passed->body, passed->length,
			  result == MODBUS_DONE ? "answered" : "not answered, or not sent");
	else if (result == MODBUS_DONE)
		deliver(passing, tool, body, length);
	else if (result == MODBUS_TIMED_OUT)
		refuse(passing, tool, MODBUS_NO_TARGET, "not answered");
	else
		refuse(passing, tool, MODBUS_NO_PATH, "not sent");
	passing_offer(passing, now_ns);
}

/* ---- what is asked --------------------------------------------------------------------------------- */

static bool has(const uint8_t *bits, uint8_t number)
{
	return bits[number / 8] & 1u << number % 8;
}

static bool is_allowed(const struct modbus_pass *pass, const struct passing_tool *tool)
{
	const uint8_t *body = body_of(tool);
	const bool reads = modbus_reads_only(body, length_of(tool));

	return !(body[1] & MODBUS_EXCEPTION_BIT) && modbus_is_whole(body, length_of(tool)) &&
	       has(pass->units, body[0]) && has(reads ? pass->functions : pass->write_functions, body[1]);
}

static void take_request(struct passing *passing, struct passing_tool *tool, int64_t now_ns)
{
	tool->waiting = true;
	tool->deadline_ns = now_ns + PASSING_WAIT_NS;
	listen_to(passing, tool, EPOLL_CTL_MOD, false);
	if (is_allowed(passing->pass, tool))
		return;
	if (map_repeats_happened(&passing->refused, 1, now_ns) > 0)
		map_log(passing->map, MAP_LOG_WARNING,
			"port %u: %s asks unit %u function %u, which pass_through does not allow",
			port_of(passing), tool->peer, body_of(tool)[0], body_of(tool)[1]);
	tool->refused = true;
}

/* One frame at a time; what follows it stays in the socket. False: it is over, or no Modbus. */
static bool take_octets(struct passing *passing, struct passing_tool *tool, int64_t now_ns)
{
	while (!tool->waiting) {
		const size_t whole = modbus_mbap_length(tool->frame, tool->count);
		ssize_t length;

		if (whole == 0)
			return false;
		if (tool->count == whole && whole > MODBUS_MBAP_PREFIX) {
			take_request(passing, tool, now_ns);
			return true;
		}
		length = bare_receive(tool->fd, tool->frame + tool->count, whole - tool->count);
		if (length <= 0)
			return length == 0;
		tool->heard_ns = now_ns;
		tool->count += (size_t)length;
	}
	return true;
}

static uint32_t device_of(const struct modbus_line *line, uint8_t unit)
{
	uint32_t device = 0;

	while (line->devices[device].unit != unit)
		device++;
	return device;
}

static void give_to_line(struct passing *passing, struct passing_tool *tool)
{
	struct modbus_passed passed = {.device = device_of(passing->line, body_of(tool)[0]),
				       .deadline_ns = tool->deadline_ns,
				       .length = tool->count - MODBUS_MBAP_PREFIX};

	if (++passing->tag == 0)
		passing->tag = 1;
	passed.tag = tool->tag = passing->tag;
	memcpy(passed.body, body_of(tool), passed.length);
	tool->refused = !modbus_line_pass(passing->line, &passed);
}

bool passing_offer(struct passing *passing, int64_t now_ns)
{
	bool given = false;

	for (uint32_t i = 0; passing->pass != NULL && i < MODBUS_PASS_CONNECTIONS_MAX; i++) {
		struct passing_tool *tool = &passing->tools[passing->turn % MODBUS_PASS_CONNECTIONS_MAX];

		if (passing->line->passing)
			return given;
		passing->turn++;
		if (tool->fd < 0 || !tool->waiting || tool->refused)
			continue;
		if (now_ns > tool->deadline_ns)
			refuse(passing, tool, MODBUS_NO_PATH, "not sent");
		else
			give_to_line(passing, tool);
		given = true;
	}
	return given;
}

/* ---------------------------------------------------------------------------------------------------- */

bool passing_begin(struct passing *passing, struct map *map, const struct modbus_pass *pass,
		   struct modbus_line *line, int listener, int epoll_fd)
{
	struct epoll_event event = {.events = EPOLLIN, .data.ptr = passing};

	*passing = (struct passing){
	    .pass = pass, .map = map, .line = line, .listener = listener, .epoll_fd = epoll_fd};
	for (uint32_t i = 0; i < MODBUS_PASS_CONNECTIONS_MAX; i++)
		passing->tools[i].fd = -1;
	line->pass_share = pass->share;
	return epoll_ctl(epoll_fd, EPOLL_CTL_ADD, listener, &event) == 0;
}

bool passing_has(const struct passing *passing, const void *pointer)
{
	return (uintptr_t)pointer >= (uintptr_t)passing && (uintptr_t)pointer < (uintptr_t)(passing + 1);
}

void passing_wake(struct passing *passing, const void *pointer, int64_t now_ns)
{
	if (pointer == passing) {
		accept_tools(passing, now_ns);
		return;
	}
	for (uint32_t i = 0; i < MODBUS_PASS_CONNECTIONS_MAX; i++) {
		struct passing_tool *tool = &passing->tools[i];

		if (tool == pointer && tool->fd >= 0 &&
		    (tool->waiting || !take_octets(passing, tool, now_ns)))
			send_away(tool);
	}
}

void passing_watch(struct passing *passing, int64_t now_ns)
{
	for (uint32_t i = 0; passing->pass != NULL && i < MODBUS_PASS_CONNECTIONS_MAX; i++) {
		struct passing_tool *tool = &passing->tools[i];

		if (tool->fd >= 0 && tool->refused)
			refuse(passing, tool, MODBUS_NO_PATH, "not allowed, or not sent");
		else if (tool->fd >= 0 && !tool->waiting && now_ns - tool->heard_ns > PASSING_IDLE_NS)
			send_away(tool);
	}
}
