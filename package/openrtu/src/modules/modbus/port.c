/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/modbus/port.h"

#include <errno.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/epoll.h>
#include <unistd.h>

#include "channel/serial.h"
#include "channel/tcp.h"
#include "map/time_ns.h"
#include "modbus/stats.h"

#define CONNECT_NS (3 * NS_PER_S) /* then a host that has said nothing is not there */
#define APART_NS                                                                                             \
	(100 * NS_PER_MS) /* from one connection to the next, of a peer that hangs up behind each answer */
#define CHECK_NS      NS_PER_S
#define READ_SIZE     512
#define READS_A_CYCLE 16

/* What a serial port and a TCP connection do each in its way. */
struct port_backend {
	void (*set_path)(struct port *port, const char *directory);
	void (*say_open)(const struct port *port, const char *again);
	/* Opens, or goes on opening, and begins the line when that is done. */
	void (*open)(struct port *port, int64_t now_ns);
	void (*close)(int fd);
	/* False: it is not any more as it was opened. */
	bool (*is_as_set)(int fd, const struct modbus_port *line);
	/* Forgets what was written and has not left. */
	void (*discard_output)(int fd);
};

static void count_port_error(struct port *port)
{
	atomic_fetch_add_explicit(&modbus_line_stats(port->map, port->number)->port_errors, 1,
				  memory_order_relaxed);
}

static void close_port(struct port *port)
{
	port->backend->close(port->fd);
	port->fd = -1;
	port->connected_by_ns = 0;
	port->waiting = false;
}

/* The port cannot be opened, or is lost. hint: what to do about it, or nothing. */
static void retry_port(struct port *port, const char *error, const char *hint, int64_t now_ns)
{
	const bool said = attempts_failed(&port->attempts, error, now_ns);
	char text[ATTEMPTS_TEXT_SIZE];

	count_port_error(port);
	port->deadline_ns = now_ns + port->attempts.pause_ns;
	if (!said)
		return;
	map_log(port->map, MAP_LOG_ERROR, "port %u: %s %s%s", port->config->port, port->path, error,
		attempts_failure(&port->attempts, now_ns, text));
	if (port->attempts.trouble.failures == 1 && hint[0] != '\0')
		map_log(port->map, MAP_LOG_ERROR, "port %u: %s", port->config->port, hint);
}

/* The descriptor that was opened; events: what wakes this process. */
static bool wait_for_port(struct port *port, uint32_t events, char error[SERIAL_ERROR_SIZE])
{
	struct epoll_event event = {.events = events, .data.ptr = port};

	if (epoll_ctl(port->epoll_fd, EPOLL_CTL_ADD, port->fd, &event) == 0)
		return true;
	snprintf(error, SERIAL_ERROR_SIZE, "cannot be watched: %s", strerror(errno));
	close_port(port);
	return false;
}

/* A port that failed is said to be there when something came of it: a device that takes no further connection accepts it, and hangs up. */
static void begin_line(struct port *port, int64_t now_ns)
{
	port->answers = port->line.counters.answers;
	port->listening = true;
	retry_opened(&port->attempts.retry, now_ns);
	if (!port->attempts.trouble.is)
		port->backend->say_open(port, "");
	modbus_line_open(&port->line, now_ns);
}

/* A device answered, or the port has lasted. */
static void note_use(struct port *port, int64_t now_ns)
{
	char text[MAP_TROUBLE_SIZE];

	if (port->line.counters.answers == port->answers && !retry_has_lasted(&port->attempts.retry, now_ns))
		return;
	retry_was_useful(&port->attempts.retry);
	if (map_trouble_well(&port->attempts.trouble, now_ns))
		port->backend->say_open(port, map_trouble_ended(&port->attempts.trouble, now_ns, text));
}

/* ---- serial ports ------------------------------------------------------------------------ */

static void set_serial_path(struct port *port, const char *directory)
{
	const char *device = port->config->device;

	if (device[0] == '/')
		snprintf(port->path, sizeof(port->path), "%s", device);
	else
		snprintf(port->path, sizeof(port->path), "%s/%s", directory, device);
}

static void say_serial_open(const struct port *port, const char *again)
{
	map_log(port->map, MAP_LOG_INFO, "port %u: %s is open, %u bit/s%s", port->config->port, port->path,
		(unsigned)port->config->baud, again);
}

static struct serial_settings serial_settings_of(const struct modbus_port *line)
{
	_Static_assert((int)MODBUS_PARITY_EVEN == SERIAL_PARITY_EVEN &&
			   (int)MODBUS_RS485_LOW == SERIAL_RS485_LOW,
		       "the numbers of the file are those of the port");
	return (struct serial_settings){
	    .baud = line->baud,
	    .data_bits = line->data_bits,
	    .parity = line->parity,
	    .stop_bits = line->stop_bits,
	    .rs485 = line->rs485,
	    .before_ms = line->before_ms,
	    .after_ms = line->after_ms,
	};
}

static bool serial_line_is_as_set(int fd, const struct modbus_port *line)
{
	const struct serial_settings settings = serial_settings_of(line);

	return serial_is_as_set(fd, &settings);
}

static void open_serial(struct port *port, int64_t now_ns)
{
	const struct serial_settings settings = serial_settings_of(port->config);
	struct map *map = port->map;
	char error[SERIAL_ERROR_SIZE], hint[SERIAL_HINT_SIZE];
	bool carries_parity;

	port->fd = serial_open(port->path, &settings, &carries_parity, error, hint);
	if (port->fd < 0 || !wait_for_port(port, EPOLLIN, error)) {
		retry_port(port, error, hint, now_ns);
		modbus_line_close(&port->line, now_ns);
		return;
	}
	if (!carries_parity && port->config->parity != MODBUS_PARITY_NONE && !port->pty_logged) {
		map_log(map, MAP_LOG_INFO, "port %u: %s is a pseudo-terminal, which carries no parity",
			port->config->port, port->path);
		port->pty_logged = true;
	}
	begin_line(port, now_ns);
}

static const struct port_backend serial_backend = {
    .set_path = set_serial_path,
    .say_open = say_serial_open,
    .open = open_serial,
    .close = serial_close,
    .is_as_set = serial_line_is_as_set,
    .discard_output = serial_discard_output,
};

/* ---- TCP connections --------------------------------------------------------------------- */

static void set_tcp_path(struct port *port, const char *directory)
{
	(void)directory;
	snprintf(port->path, sizeof(port->path), "%s port %u", port->config->device, port->config->tcp_port);
}

static void say_connected(const struct port *port, const char *again)
{
	map_log(port->map, MAP_LOG_INFO, "port %u: %s is connected%s", port->config->port, port->path, again);
}

/* Whether it was lost before, or had hung up when it was idle. */
static void fail_to_connect(struct port *port, const char *error, int64_t now_ns)
{
	retry_port(port, error, "", now_ns);
	modbus_line_close(&port->line, now_ns);
}

static void begin_connection(struct port *port, int64_t now_ns)
{
	char error[TCP_ERROR_SIZE];

	_Static_assert(TCP_ERROR_SIZE == SERIAL_ERROR_SIZE, "both are a port's");
	port->fd = tcp_connect(port->config->device, port->config->tcp_port, error);
	if (port->fd < 0 || !wait_for_port(port, EPOLLOUT, error)) {
		fail_to_connect(port, error, now_ns);
		return;
	}
	port->connect_ns = now_ns + APART_NS;
	port->deadline_ns = port->connected_by_ns = now_ns + CONNECT_NS;
}

static void end_connecting(struct port *port, int64_t now_ns)
{
	struct epoll_event event = {.events = EPOLLIN, .data.ptr = port};
	char error[TCP_ERROR_SIZE];

	switch (tcp_look(port->fd, error)) {
	case TCP_PENDING:
		port->deadline_ns = port->connected_by_ns;
		if (now_ns < port->connected_by_ns)
			return;
		close_port(port);
		fail_to_connect(port, "does not answer", now_ns);
		return;
	case TCP_FAILED:
		close_port(port);
		fail_to_connect(port, error, now_ns);
		return;
	case TCP_CONNECTED:
		break;
	}
	port->connected_by_ns = 0;
	epoll_ctl(port->epoll_fd, EPOLL_CTL_MOD, port->fd, &event);
	port->listening = true;
	if (port->line.state == MODBUS_CLOSED)
		begin_line(port, now_ns);
	else
		modbus_line_connected(&port->line, now_ns);
}

static void open_connection(struct port *port, int64_t now_ns)
{
	if (port->fd < 0)
		begin_connection(port, now_ns);
	else
		end_connecting(port, now_ns);
}

static void close_connection(int fd)
{
	close(fd);
}

/* A connection has no settings that another program could change. */
static bool is_connection_as_set(int fd, const struct modbus_port *line)
{
	(void)fd;
	(void)line;
	return true;
}

/* What was written to a connection has left. */
static void keep_output(int fd)
{
	(void)fd;
}

static const struct port_backend tcp_backend = {
    .set_path = set_tcp_path,
    .say_open = say_connected,
    .open = open_connection,
    .close = close_connection,
    .is_as_set = is_connection_as_set,
    .discard_output = keep_output,
};

/* ---- UDP ----------------------------------------------------------------------------------- */

static void say_udp_open(const struct port *port, const char *again)
{
	map_log(port->map, MAP_LOG_INFO, "port %u: %s is asked by UDP%s", port->config->port, port->path,
		again);
}

/* Whether anybody is there shows when something is asked. */
static void open_udp(struct port *port, int64_t now_ns)
{
	char error[TCP_ERROR_SIZE];

	port->fd = udp_connect(port->config->device, port->config->tcp_port, error);
	if (port->fd < 0 || !wait_for_port(port, EPOLLIN, error))
		fail_to_connect(port, error, now_ns);
	else
		begin_line(port, now_ns);
}

static const struct port_backend udp_backend = {
    .set_path = set_tcp_path,
    .say_open = say_udp_open,
    .open = open_udp,
    .close = close_connection,
    .is_as_set = is_connection_as_set,
    .discard_output = keep_output,
};

/* ---- either ------------------------------------------------------------------------------ */

void port_init(struct port *port, struct map *map, uint32_t number, const char *directory, int epoll_fd)
{
	const struct modbus_port *line = &modbus_ports(map_config(map))[number];

	*port = (struct port){.map = map,
			      .frames = modbus_line_frames(map, number),
			      .config = line,
			      .number = number,
			      .epoll_fd = epoll_fd,
			      .fd = -1,
			      .attempts = attempts_begin(ATTEMPTS_FIRST_NS, ATTEMPTS_MOST_NS)};
	port->backend = modbus_is_udp(line)   ? &udp_backend
			: modbus_is_tcp(line) ? &tcp_backend
					      : &serial_backend;
	port->backend->set_path(port, directory);
}

bool port_is_open(const struct port *port)
{
	return port->line.state != MODBUS_CLOSED;
}

/* What was written there arrives. */
static bool is_there(const struct port *port)
{
	return port->fd >= 0 && port->connected_by_ns == 0;
}

static void lose_port(struct port *port, const char *cause, int64_t now_ns)
{
	char error[SERIAL_ERROR_SIZE];

	snprintf(error, sizeof(error), "is lost: %s", cause);
	close_port(port);
	retry_port(port, error, "", now_ns);
	modbus_line_close(&port->line, now_ns);
}

/* A peer that is none any more has hung up; one that does so when nothing is asked of it has a right to. */
static void end_port(struct port *port, const char *cause, int64_t now_ns)
{
	if (!modbus_line_interrupted(&port->line, now_ns)) {
		lose_port(port, cause, now_ns);
		return;
	}
	close_port(port);
	port->deadline_ns = 0;
}

static bool is_connection(const struct port *port)
{
	return modbus_is_tcp(port->config) && !modbus_is_udp(port->config);
}

static bool has_hung_up(const struct port *port, int error)
{
	return is_connection(port) && (error == 0 || error == ECONNRESET || error == EPIPE);
}

/* What is set anew is the whole port: its speed, its format and, behind them, its RS-485 mode. */
static void check_port(struct port *port, int64_t now_ns)
{
	if (now_ns < port->check_ns)
		return;
	port->check_ns = now_ns + CHECK_NS;
	if (!port->backend->is_as_set(port->fd, port->config))
		lose_port(port, "another program changed its settings", now_ns);
}

static void end_reading(struct port *port, int error, int64_t now_ns)
{
	const char *cause = error == 0 ? "hung up" : strerror(error);

	if (has_hung_up(port, error))
		end_port(port, cause, now_ns);
	else
		lose_port(port, cause, now_ns);
}

/* Before it is asked, it is looked whether it has: what is written then arrives nowhere, and of a command nobody knows. */
static bool may_hang_up(const struct port *port)
{
	return is_connection(port) && (port->line.connection.closes > 0 || port->line.command_count > 0);
}

/* Of datagrams, one may be empty. */
static bool is_end(const struct port *port, ssize_t length)
{
	return length == 0 && !modbus_is_udp(port->config);
}

/* There is nothing behind it that needs another look. */
static bool is_last(const struct port *port, ssize_t length, size_t size)
{
	if (modbus_is_udp(port->config))
		return length < 0;
	return length < (ssize_t)size && (length <= 0 || !may_hang_up(port));
}

/* Gives what is readable to the line: far more than a device sends, and never a flood without end. */
static void read_port(struct port *port)
{
	for (int reads = 0; reads < READS_A_CYCLE && port->fd >= 0; reads++) {
		uint8_t bytes[READ_SIZE];
		ssize_t length = read(port->fd, bytes, sizeof(bytes));
		int64_t now_ns = map_now_ns();

		if (length > 0)
			modbus_frames_add(port->frames, MODBUS_RECEIVED, bytes, (size_t)length, now_ns);
		if (length > 0 && !modbus_line_receive(&port->line, bytes, (size_t)length, now_ns))
			lose_port(port, "it sends something that is not Modbus", now_ns);
		else if (is_end(port, length) || (length < 0 && errno != EAGAIN && errno != EINTR))
			end_reading(port, length == 0 ? 0 : errno, now_ns);
		if (is_last(port, length, sizeof(bytes)))
			return;
	}
}

/*
 * What the port has not sent of an older request, which has timed out by now, it shall not send any
 * more; one that was answered has left. A port that does not even then take a request whole is broken,
 * and what was to be sent is not confirmed: a broadcast, too, was not sent.
 */
static void write_port(struct port *port, const struct modbus_output *output, int64_t now_ns)
{
	if (port->answered == port->line.counters.answers)
		port->backend->discard_output(port->fd);
	port->answered = port->line.counters.answers;
	ssize_t length = write(port->fd, output->frame, output->length);

	if (length > 0)
		modbus_frames_add(port->frames, MODBUS_SENT, output->frame, (size_t)length, now_ns);
	if (length < 0 && has_hung_up(port, errno))
		end_port(port, strerror(errno), now_ns);
	else if (length != (ssize_t)output->length)
		lose_port(port, length < 0 ? strerror(errno) : "it does not accept a whole request", now_ns);
}

/*
 * An answer comes character by character: to wake for each would be most of a line's cost. One wakes, and then none until
 * this is called.
 */
static void listen_to(struct port *port)
{
	struct epoll_event event = {.events = EPOLLIN | EPOLLONESHOT, .data.ptr = port};

	if (port->listening)
		return;
	epoll_ctl(port->epoll_fd, EPOLL_CTL_MOD, port->fd, &event);
	port->listening = true;
}

/* How late we are for what the line waits for. */
static void measure_wakeup(struct port *port, int64_t due_ns, int64_t now_ns)
{
	if (port->waiting && port->deadline_ns != 0)
		modbus_histogram_add(&port->wakeups, now_ns - later(port->deadline_ns, due_ns));
	port->waiting = false;
}

void port_wake(struct port *port)
{
	port->deadline_ns = 0;
	port->listening = false;
}

/* A connection that brings nothing any more, though it is there. The next one is made at once. */
static void give_up_connection(struct port *port, int64_t now_ns)
{
	close_port(port);
	port->deadline_ns = 0;
	if (map_repeats_happened(&port->hangs, 1, now_ns) > 0)
		map_log(port->map, MAP_LOG_WARNING,
			"port %u: %s answers nothing on its connection: making another", port->config->port,
			port->path);
}

/* The line goes on without a connection until it has something to ask. */
static bool is_to_wait(struct port *port, int64_t now_ns)
{
	return port_is_open(port) && port->fd < 0 && !modbus_line_is_due(&port->line, now_ns);
}

static void open_port(struct port *port, int64_t now_ns)
{
	if (is_to_wait(port, now_ns))
		return;
	if (port->fd < 0 && now_ns < port->connect_ns)
		port->deadline_ns = port->connect_ns;
	else
		port->backend->open(port, now_ns);
}

static void poll_line(struct port *port, int64_t now_ns)
{
	struct modbus_output output = modbus_line_poll(&port->line, now_ns);
	bool listening = now_ns >= output.listen_ns;

	port->deadline_ns = listening ? output.deadline_ns : earlier(output.deadline_ns, output.listen_ns);
	port->waiting = port->deadline_ns > now_ns;
	if (listening && is_there(port))
		listen_to(port);
	if (output.reconnect)
		give_up_connection(port, now_ns);
	else if (output.length > 0)
		write_port(port, &output, now_ns);
}

void port_serve(struct port *port, int64_t due_ns)
{
	int64_t now_ns = map_now_ns();

	measure_wakeup(port, due_ns, now_ns);
	if (!is_there(port))
		open_port(port, now_ns);
	if (is_there(port))
		check_port(port, now_ns);
	/* A delayed process reads what came before now_ns, and then judges what has timed out. */
	if (is_there(port))
		read_port(port);
	if (is_there(port))
		note_use(port, now_ns);
	if (is_there(port) || is_to_wait(port, now_ns))
		poll_line(port, now_ns);
}

int64_t ports_due_ns(const struct port *ports, uint32_t count)
{
	int64_t first_ns = INT64_MAX, last_ns;

	for (uint32_t i = 0; i < count; i++)
		first_ns = earlier(first_ns, ports[i].deadline_ns);
	last_ns = first_ns;
	for (uint32_t i = 0; i < count; i++)
		if (ports[i].deadline_ns - first_ns <= PORT_GATHER_NS)
			last_ns = later(last_ns, ports[i].deadline_ns);
	return last_ns;
}
