/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * rtu-modbus: the controlling station of some RS-485 lines and Modbus TCP connections. One loop serves all lines
 * that the configuration gives to this process: it carries bytes between ports and lines, and results between
 * lines and the map.
 */
#include <errno.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include "map/map.h"
#include "modbus/configured.h"
#include "modules/commands.h"
#include "modules/convert.h"
#include "modules/options.h"
#include "modules/quality.h"
#include "modules/serial.h"
#include "modules/tcp.h"

#define NS_PER_MS      1000000LL
#define NS_PER_S       1000000000LL
#define REOPEN_NS      NS_PER_S
#define CONNECT_NS     (3 * NS_PER_S) /* then a host that has said nothing is not there */
#define RECONNECT_NS   (5 * NS_PER_S) /* to such a one: nobody else is there to refuse it */
#define CHECK_NS       NS_PER_S
#define STOP_NS        (2 * NS_PER_S) /* rtud waits 3 s */
#define HEARTBEAT_NS   (MAP_HEARTBEAT_PERIOD_MS * NS_PER_MS)
#define READ_SIZE      512
#define READS_A_TURN   16
#define EPOLL_EVENTS   16
#define WRONG_USAGE    2
#define PORT_PATH_SIZE 512

struct gateway;

/* One line and its port: a serial port, or a TCP connection. */
struct port {
	struct gateway *gateway;
	const struct map_line *config;
	uint32_t number; /* of the line in the configuration */
	char path[PORT_PATH_SIZE];
	int fd;       /* -1: not open */
	bool failing; /* said in the log */
	bool pty_logged;
	int64_t connected_by_ns; /* until then a connection may take; 0: none is being made */
	uint32_t answers;        /* of the line, before the port was opened */
	int64_t check_ns;        /* the next look whether the port is as it was set */
	int64_t deadline_ns; /* of the line, or of the next try to open the port; 0: it is to be served now */
	bool listening;      /* bytes that arrive wake this process */
	bool waiting;        /* for deadline_ns, which lay ahead */
	uint32_t answered;   /* line.counters.answers when the last request was written */
	struct modbus_histogram wakeups;
	struct modbus_line line;
};

struct gateway {
	struct map *map;
	const struct map_config *config;
	struct port *ports;
	uint32_t port_count;
	struct commands commands;
	struct quality quality;
	struct map_update *updates; /* room for the largest device */
	int epoll_fd;
	int timer_fd;
	int heartbeat_fd;
	int64_t heartbeat_ns; /* the next one, which wakes this process */
	int64_t armed_ns;     /* what the timer is set to; 0: it has expired */
};

static volatile sig_atomic_t stop_requested;

static void request_stop(int signal_number)
{
	(void)signal_number;
	stop_requested = 1;
}

static int64_t earlier(int64_t a, int64_t b)
{
	return a < b ? a : b;
}

static void count_port_error(struct port *port)
{
	atomic_fetch_add_explicit(&map_line_stats(port->gateway->map, port->number)->port_errors, 1,
				  memory_order_relaxed);
}

/* ---- what a line tells goes into the map ---------------------------------------------------------- */

static const struct map_device *device_config(const struct port *port, uint32_t device)
{
	return &port->gateway->config->devices[port->config->first_device + device];
}

/* gateway->updates, so many of them */
static void publish(struct gateway *gateway, const struct map_device *device, size_t count, int64_t now_ns)
{
	count = quality_complete(&gateway->quality, device, gateway->updates, count, now_ns);
	map_publish(gateway->map, gateway->updates, count);
}

static uint16_t raw_word(const struct modbus_read *read, const uint8_t *data, uint32_t index)
{
	if (index >= read->count)
		return 0;
	return modbus_is_bit_function(read->function) ? modbus_bit(data, (uint16_t)index)
						      : modbus_register(data, (uint16_t)index);
}

static void publish_read(void *context, uint32_t device, const struct modbus_read *read, const uint8_t *data,
			 int64_t now_ns)
{
	struct port *port = context;
	struct gateway *gateway = port->gateway;

	for (uint32_t i = 0; i < read->objects; i++) {
		uint32_t point = port->line.devices[device].objects[read->first + i].tag;
		const struct map_point *config = &gateway->config->points[point];
		const uint16_t raw[CONVERT_WIDTH_MAX] = {
		    raw_word(read, data, (uint32_t)config->address - read->address),
		    raw_word(read, data, (uint32_t)config->second_address - read->address)};
		struct map_update *update = &gateway->updates[i];

		*update = (struct map_update){.point = point,
					      .cause = (uint8_t)commands_cause(&gateway->commands, point),
					      .sample = {.time_ns = now_ns}};
		convert_to_sample(config, raw, &update->sample);
		if (config->type == MAP_COUNTER)
			map_total_count(gateway->map, point, &update->sample);
		else
			map_smooth(gateway->map, point, &update->sample);
	}
	publish(gateway, device_config(port, device), read->objects, now_ns);
	for (uint32_t i = 0; i < read->objects; i++)
		commands_published(&gateway->commands, gateway->updates[i].point);
}

static void lose_read(void *context, uint32_t device, const struct modbus_read *read, uint8_t exception,
		      int64_t now_ns)
{
	struct port *port = context;
	struct gateway *gateway = port->gateway;
	/* What was read before may be old, and not wrong. */
	enum map_quality quality = modbus_is_of_the_moment(exception) ? MAP_NOT_TOPICAL : MAP_INVALID;

	for (uint32_t i = 0; i < read->objects; i++)
		gateway->updates[i] =
		    quality_lost(&gateway->quality, port->line.devices[device].objects[read->first + i].tag,
				 quality, now_ns);
	publish(gateway, device_config(port, device), read->objects, now_ns);
	if (exception == 0)
		map_log(gateway->map, MAP_LOG_WARNING, "%s: no answer to function %u, address %u",
			device_config(port, device)->name, read->function, read->address);
	else
		map_log(gateway->map, MAP_LOG_WARNING, "%s: exception %u to function %u, address %u",
			device_config(port, device)->name, exception, read->function, read->address);
}

static void invalidate_device(struct gateway *gateway, const struct map_device *device, int64_t now_ns)
{
	for (uint32_t i = 0; i < device->point_count; i++)
		gateway->updates[i] =
		    quality_lost(&gateway->quality, device->first_point + i, MAP_INVALID, now_ns);
	publish(gateway, device, device->point_count, now_ns);
}

static void device_changed(void *context, uint32_t device, bool alive, int64_t now_ns)
{
	struct port *port = context;
	const struct map_device *config = device_config(port, device);

	if (!alive)
		invalidate_device(port->gateway, config, now_ns);
	commands_device_changed(&port->gateway->commands, port->config->first_device + device, alive, now_ns);
	map_log(port->gateway->map, alive ? MAP_LOG_INFO : MAP_LOG_WARNING, "%s: unit %u on port %u %s",
		config->name, config->unit, port->config->port, alive ? "answers" : "is dead");
}

static void take_command_answer(void *context, const struct modbus_command *command,
				enum modbus_result result, uint8_t exception)
{
	struct port *port = context;

	commands_answered(&port->gateway->commands, command->tag, result, exception, map_now_ns());
}

static const struct modbus_events line_events = {publish_read, lose_read, device_changed,
						 take_command_answer};

/* ---- commands ---------------------------------------------------------------------------------------- */

static struct port *port_of_line(struct gateway *gateway, uint32_t line)
{
	for (uint32_t i = 0; i < gateway->port_count; i++)
		if (gateway->ports[i].number == line)
			return &gateway->ports[i];
	return NULL;
}

/* Hands a write to its line, which will answer it. */
static bool write_to_line(void *context, uint32_t point, const struct modbus_request *request,
			  int64_t deadline_ns)
{
	struct gateway *gateway = context;
	uint32_t device = gateway->config->points[point].device;
	struct port *port = port_of_line(gateway, gateway->config->devices[device].line);
	struct modbus_command command = {.tag = point,
					 .deadline_ns = deadline_ns,
					 .no_read_back =
					     gateway->config->points[point].flags & MAP_POINT_NO_READ_BACK,
					 .request = *request};

	if (port == NULL)
		return false;
	command.device = device - port->config->first_device;
	if (!modbus_line_command(&port->line, &command))
		return false;
	port->deadline_ns = 0;
	return true;
}

static void take_requests(struct gateway *gateway)
{
	struct map_request request;

	map_bell_clear(gateway->map);
	while (!stop_requested && map_request_next(gateway->map, &request))
		commands_request(&gateway->commands, &request);
}

/* ---- ports -------------------------------------------------------------------------------------------- */

static void close_port(struct port *port)
{
	if (map_line_is_tcp(port->config))
		close(port->fd);
	else
		serial_close(port->fd);
	port->fd = -1;
	port->connected_by_ns = 0;
	port->waiting = false;
}

/* Said once, until the port is open again. */
static void retry_port(struct port *port, const char *error, int64_t after_ns, int64_t now_ns)
{
	count_port_error(port);
	if (!port->failing)
		map_log(port->gateway->map, MAP_LOG_ERROR, "port %u: %s %s; tried again %s",
			port->config->port, port->path, error,
			after_ns == REOPEN_NS ? "each second" : "every few seconds");
	port->failing = true;
	port->deadline_ns = now_ns + after_ns;
}

/* The descriptor that was opened; events: what wakes this process. */
static bool wait_for_port(struct port *port, uint32_t events, char error[SERIAL_ERROR_SIZE])
{
	struct epoll_event event = {.events = events, .data.ptr = port};

	if (epoll_ctl(port->gateway->epoll_fd, EPOLL_CTL_ADD, port->fd, &event) == 0)
		return true;
	snprintf(error, SERIAL_ERROR_SIZE, "cannot be waited for: %s", strerror(errno));
	close_port(port);
	return false;
}

static void begin_line(struct port *port, int64_t now_ns)
{
	port->answers = port->line.counters.answers;
	port->listening = true;
	modbus_line_open(&port->line, now_ns);
}

static void log_connected(const struct port *port)
{
	map_log(port->gateway->map, MAP_LOG_INFO, "port %u: %s is connected", port->config->port, port->path);
}

/*
 * A device that takes no further connection accepts it and hangs up: a connection that has failed before is said to be
 * there when something came of it, and not each second.
 */
static void note_answers(struct port *port)
{
	if (!port->failing || port->line.counters.answers == port->answers)
		return;
	port->failing = false;
	log_connected(port);
}

static void open_serial(struct port *port, int64_t now_ns)
{
	struct map *map = port->gateway->map;
	char error[SERIAL_ERROR_SIZE];
	bool carries_parity;

	port->fd = serial_open(port->path, port->config, &carries_parity, error);
	if (port->fd < 0 || !wait_for_port(port, EPOLLIN, error)) {
		retry_port(port, error, REOPEN_NS, now_ns);
		return;
	}
	if (!carries_parity && port->config->parity != MAP_PARITY_NONE && !port->pty_logged) {
		map_log(map, MAP_LOG_INFO, "port %u: %s is a pseudo-terminal, which carries no parity",
			port->config->port, port->path);
		port->pty_logged = true;
	}
	map_log(map, MAP_LOG_INFO, "port %u: %s is open, %u bit/s", port->config->port, port->path,
		(unsigned)port->config->baud);
	port->failing = false;
	begin_line(port, now_ns);
}

static void begin_connection(struct port *port, int64_t now_ns)
{
	char error[TCP_ERROR_SIZE];

	_Static_assert(TCP_ERROR_SIZE == SERIAL_ERROR_SIZE, "both are a port's");
	port->fd = tcp_connect(port->config, error);
	if (port->fd < 0 || !wait_for_port(port, EPOLLOUT, error)) {
		retry_port(port, error, REOPEN_NS, now_ns);
		return;
	}
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
		retry_port(port, "does not answer", RECONNECT_NS, now_ns);
		return;
	case TCP_FAILED:
		close_port(port);
		retry_port(port, error, REOPEN_NS, now_ns);
		return;
	case TCP_CONNECTED:
		break;
	}
	port->connected_by_ns = 0;
	epoll_ctl(port->gateway->epoll_fd, EPOLL_CTL_MOD, port->fd, &event);
	if (!port->failing)
		log_connected(port);
	begin_line(port, now_ns);
}

static void open_port(struct port *port, int64_t now_ns)
{
	if (!map_line_is_tcp(port->config))
		open_serial(port, now_ns);
	else if (port->fd < 0)
		begin_connection(port, now_ns);
	else
		end_connecting(port, now_ns);
}

static bool is_open(const struct port *port)
{
	return port->fd >= 0 && port->connected_by_ns == 0;
}

static void lose_port(struct port *port, const char *cause, int64_t now_ns)
{
	close_port(port);
	if (!port->failing)
		map_log(port->gateway->map, MAP_LOG_ERROR, "port %u: %s is lost: %s", port->config->port,
			port->path, cause);
	port->failing = true;
	port->deadline_ns = now_ns + REOPEN_NS;
	count_port_error(port);
	modbus_line_close(&port->line, now_ns);
}

/* What is set anew is the whole port: its speed, its format and, behind them, its RS-485 mode. */
static void check_port(struct port *port, int64_t now_ns)
{
	if (map_line_is_tcp(port->config) || now_ns < port->check_ns)
		return;
	port->check_ns = now_ns + CHECK_NS;
	if (!serial_is_as_set(port->fd, port->config))
		lose_port(port, "another program has changed its settings", now_ns);
}

/* Gives what is readable to the line: far more than a device sends, and never a flood without end. */
static void read_port(struct port *port)
{
	for (int reads = 0; reads < READS_A_TURN && port->fd >= 0; reads++) {
		uint8_t bytes[READ_SIZE];
		ssize_t length = read(port->fd, bytes, sizeof(bytes));
		int64_t now_ns = map_now_ns();

		if (length > 0 && !modbus_line_receive(&port->line, bytes, (size_t)length, now_ns))
			lose_port(port, "what comes is not Modbus", now_ns);
		else if (length == 0 || (length < 0 && errno != EAGAIN && errno != EINTR))
			lose_port(port, length == 0 ? "hung up" : strerror(errno), now_ns);
		if (length < (ssize_t)sizeof(bytes))
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
	if (!map_line_is_tcp(port->config) && port->answered == port->line.counters.answers)
		serial_discard_output(port->fd);
	port->answered = port->line.counters.answers;
	ssize_t length = write(port->fd, output->frame, output->length);

	if (length != (ssize_t)output->length)
		lose_port(port, length < 0 ? strerror(errno) : "it does not send", now_ns);
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
	epoll_ctl(port->gateway->epoll_fd, EPOLL_CTL_MOD, port->fd, &event);
	port->listening = true;
}

/* How late we are for what the line waits for. */
static void measure_wakeup(struct port *port, int64_t now_ns)
{
	if (port->waiting && port->deadline_ns != 0)
		modbus_histogram_add(&port->wakeups, now_ns - port->deadline_ns);
	port->waiting = false;
}

static void serve_port(struct port *port)
{
	int64_t now_ns = map_now_ns();

	measure_wakeup(port, now_ns);
	if (!is_open(port))
		open_port(port, now_ns);
	if (is_open(port))
		check_port(port, now_ns);
	/* A delayed process reads what came before now_ns, and then judges what has timed out. */
	if (is_open(port))
		read_port(port);
	if (!is_open(port))
		return;
	note_answers(port);
	struct modbus_output output = modbus_line_poll(&port->line, now_ns);
	bool listening = now_ns >= output.listen_ns;

	port->deadline_ns = listening ? output.deadline_ns : earlier(output.deadline_ns, output.listen_ns);
	port->waiting = port->deadline_ns > now_ns;
	if (listening)
		listen_to(port);
	if (output.length > 0)
		write_port(port, &output, now_ns);
}

/*
 * ---- counters
 * --------------------------------------------------------------------------------------------
 */

static void show(_Atomic uint32_t *counter, uint32_t value)
{
	atomic_store_explicit(counter, value, memory_order_relaxed);
}

static void show_histogram(struct map_histogram *shown, const struct modbus_histogram *histogram)
{
	_Static_assert(MAP_BUCKETS == MODBUS_BUCKETS, "they are the same");
	for (uint32_t i = 0; i < MODBUS_BUCKETS; i++)
		show(&shown->counts[i], histogram->counts[i]);
	show(&shown->longest_us, histogram->longest_us);
}

static void show_learned(struct map_learned *shown, const struct modbus_learned *learned)
{
	show(&shown->given_bits, learned->given_bits);
	show(&shown->given_registers, learned->given_registers);
	show(&shown->refused_bits, learned->refused_bits);
	show(&shown->refused_registers, learned->refused_registers);
	show(&shown->hole_function, learned->hole.function);
	show(&shown->hole_address, learned->hole.address);
	show(&shown->hole_count, learned->hole.count);
	show(&shown->hole_exception, learned->hole.exception);
	show(&shown->hole_read, learned->hole.read);
	show(&shown->lacking_function, learned->lacking.function);
	show(&shown->lacking_address, learned->lacking.address);
	show(&shown->lacking_exception, learned->lacking.exception);
	show(&shown->lacking_count, learned->lacking.count);
	show(&shown->holes_given, learned->holes_given);
	show(&shown->unclear, learned->unclear);
	show(&shown->open, learned->open);
}

static void show_device(struct map_device_stats *stats, struct modbus_device *device)
{
	show(&stats->requests, device->counters.requests);
	show(&stats->answers, device->counters.answers);
	show(&stats->exceptions, device->counters.exceptions);
	show(&stats->timeouts, device->counters.timeouts);
	show(&stats->errors, device->counters.errors);
	show(&stats->alive, device->alive);
	show(&stats->next_probe_ms, (uint32_t)(device->backoff_ns / NS_PER_MS));
	show(&stats->latency_us, device->counters.latency_us);
	show(&stats->planned_requests, device->read_count);
	show(&stats->missed_periods, device->counters.missed_periods);
	show(&stats->latency_least_us, device->latency.least_us);
	show(&stats->latency_typical_us, device->latency.typical_us);
	show(&stats->latency_most_us, device->latency.most_us);
	if (device->news) {
		struct modbus_learned learned = modbus_learn(device->reads, device->read_count);

		show_learned(&stats->learned, &learned);
		device->news = false;
	}
}

static void show_counters(struct port *port)
{
	const struct modbus_line_counters *counters = &port->line.counters;
	struct map *map = port->gateway->map;
	struct map_line_stats *stats = map_line_stats(map, port->number);

	show(&stats->requests, counters->requests);
	show(&stats->answers, counters->answers);
	show(&stats->exceptions, counters->exceptions);
	show(&stats->timeouts, counters->timeouts);
	show(&stats->crc_errors, counters->crc_errors);
	show(&stats->wrong_units, counters->wrong_units);
	show(&stats->wrong_functions, counters->wrong_functions);
	show(&stats->wrong_lengths, counters->wrong_lengths);
	show(&stats->wrong_answers, counters->wrong_answers);
	show(&stats->late_answers, counters->late_answers);
	show(&stats->unasked_frames, counters->unasked_frames);
	show(&stats->echoes, counters->echoes);
	show(&stats->noise_bytes, counters->noise_bytes);
	show(&stats->stuck_s, counters->stuck_s);
	show(&stats->commands, counters->commands);
	show(&stats->scan_us, counters->scan_us);
	show(&stats->open, is_open(port));
	show_histogram(&stats->wakeups, &port->wakeups);
	show_histogram(&stats->transactions, &counters->transactions);
	for (uint32_t i = 0; i < port->line.device_count; i++)
		show_device(map_device_stats(map, port->config->first_device + i), &port->line.devices[i]);
}

/*
 * ---- start
 * ------------------------------------------------------------------------------------------------
 */

static void out_of_memory(void)
{
	fputs("rtu-modbus: not enough memory for the configuration\n", stderr);
	exit(EXIT_FAILURE);
}

static void *allocate(size_t count, size_t size)
{
	void *memory = calloc(count ? count : 1, size);

	if (memory == NULL)
		out_of_memory();
	return memory;
}

static void set_up_port(struct gateway *gateway, struct port *port, uint32_t number, const char *directory)
{
	const struct map_config *config = gateway->config;
	const struct map_line *line = &config->lines[number];

	*port = (struct port){.gateway = gateway, .config = line, .number = number, .fd = -1};
	if (map_line_is_tcp(line))
		snprintf(port->path, sizeof(port->path), "%s port %u", line->device, line->tcp_port);
	else if (line->device[0] == '/')
		snprintf(port->path, sizeof(port->path), "%s", line->device);
	else
		snprintf(port->path, sizeof(port->path), "%s/%s", directory, line->device);
	port->line = (struct modbus_line){.events = &line_events, .context = port};
	if (!modbus_line_configure(&port->line, config, number))
		out_of_memory();
}

static void set_up_ports(struct gateway *gateway, const char *directory)
{
	const struct map_config *config = gateway->config;
	uint32_t largest = 0;

	gateway->ports = allocate(config->line_count, sizeof(*gateway->ports));
	for (uint32_t i = 0; i < config->line_count; i++)
		if (config->lines[i].module == map_self(gateway->map))
			set_up_port(gateway, &gateway->ports[gateway->port_count++], i, directory);
	for (uint32_t i = 0; i < config->device_count; i++)
		if (config->devices[i].point_count > largest)
			largest = config->devices[i].point_count;
	gateway->updates = allocate(largest, sizeof(*gateway->updates));
	quality_init(&gateway->quality, gateway->map,
		     allocate(config->point_count, sizeof(*gateway->quality.points)));
}

static void set_up_commands(struct gateway *gateway)
{
	const struct map_config *config = gateway->config;
	uint32_t commands = 0;

	for (uint32_t i = 0; i < config->point_count; i++)
		commands += (config->points[i].flags & MAP_POINT_COMMAND) &&
			    map_owner(gateway->map, i) == map_self(gateway->map);
	gateway->commands =
	    (struct commands){.map = gateway->map,
			      .progress = allocate(commands, sizeof(*gateway->commands.progress)),
			      .write = write_to_line,
			      .context = gateway};
	commands_resume(&gateway->commands);
}

static void release_ports(struct gateway *gateway)
{
	for (uint32_t i = 0; i < gateway->port_count; i++)
		modbus_line_release(&gateway->ports[i].line);
	free(gateway->ports);
	free(gateway->updates);
	free(gateway->quality.points);
	free(gateway->commands.progress);
}

static struct timespec timespec_of(int64_t ns)
{
	return (struct timespec){.tv_sec = (time_t)(ns / NS_PER_S), .tv_nsec = (long)(ns % NS_PER_S)};
}

static bool set_up_waiting(struct gateway *gateway)
{
	struct epoll_event bell = {.events = EPOLLIN, .data.ptr = gateway};
	struct epoll_event timer = {.events = EPOLLIN | EPOLLET, .data.ptr = &gateway->timer_fd};
	struct epoll_event heartbeat = {.events = EPOLLIN, .data.ptr = &gateway->heartbeat_fd};
	struct itimerspec beats = {.it_interval = {.tv_nsec = HEARTBEAT_NS}};

	gateway->heartbeat_ns = map_now_ns() + HEARTBEAT_NS;
	beats.it_value = timespec_of(gateway->heartbeat_ns);
	gateway->epoll_fd = epoll_create1(EPOLL_CLOEXEC);
	gateway->timer_fd = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
	gateway->heartbeat_fd = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
	return gateway->epoll_fd >= 0 && gateway->timer_fd >= 0 && gateway->heartbeat_fd >= 0 &&
	       timerfd_settime(gateway->heartbeat_fd, TFD_TIMER_ABSTIME, &beats, NULL) == 0 &&
	       epoll_ctl(gateway->epoll_fd, EPOLL_CTL_ADD, map_bell_fd(gateway->map), &bell) == 0 &&
	       epoll_ctl(gateway->epoll_fd, EPOLL_CTL_ADD, gateway->timer_fd, &timer) == 0 &&
	       epoll_ctl(gateway->epoll_fd, EPOLL_CTL_ADD, gateway->heartbeat_fd, &heartbeat) == 0;
}

static void set_up_signals(void)
{
	struct sigaction stop = {.sa_handler = request_stop}; /* without SA_RESTART: the loop shall wake */
	struct sigaction ignore = {.sa_handler = SIG_IGN};

	sigaction(SIGTERM, &stop, NULL);
	sigaction(SIGINT, &stop, NULL);
	sigaction(SIGPIPE, &ignore, NULL);
}

/*
 * ---- the loop
 * ----------------------------------------------------------------------------------------------
 */

/* To set the timer costs most of what a wake-up costs. What is due behind the next heartbeat is looked at again then. */
static void arm_timer(struct gateway *gateway)
{
	int64_t at_ns = commands_deadline(&gateway->commands);

	for (uint32_t i = 0; i < gateway->port_count; i++)
		at_ns = earlier(at_ns, gateway->ports[i].deadline_ns);
	if (at_ns < 1)
		at_ns = 1; /* 0 would disarm */
	if (at_ns >= gateway->heartbeat_ns || at_ns == gateway->armed_ns)
		return;
	gateway->armed_ns = at_ns;
	struct itimerspec timer = {.it_value = timespec_of(at_ns)};
	timerfd_settime(gateway->timer_fd, TFD_TIMER_ABSTIME, &timer, NULL);
}

static void wake_port(struct port *port)
{
	port->deadline_ns = 0;
	port->listening = false;
}

/* Starts the next period. */
static void take_heartbeat(const struct gateway *gateway)
{
	uint64_t expiries;

	(void)!read(gateway->heartbeat_fd, &expiries, sizeof(expiries));
}

static void wait_and_take(struct gateway *gateway)
{
	struct epoll_event events[EPOLL_EVENTS];
	int count = epoll_wait(gateway->epoll_fd, events, EPOLL_EVENTS, -1);

	for (int i = 0; i < count; i++) {
		if (events[i].data.ptr == gateway)
			take_requests(gateway);
		else if (events[i].data.ptr == &gateway->timer_fd)
			gateway->armed_ns = 0;
		else if (events[i].data.ptr == &gateway->heartbeat_fd)
			take_heartbeat(gateway);
		else
			wake_port(events[i].data.ptr);
	}
}

static void beat(struct gateway *gateway, int64_t now_ns)
{
	if (now_ns < gateway->heartbeat_ns)
		return;
	gateway->heartbeat_ns += ((now_ns - gateway->heartbeat_ns) / HEARTBEAT_NS + 1) * HEARTBEAT_NS;
	map_heartbeat(gateway->map);
	map_totals_tick(gateway->map);
	for (uint32_t i = 0; i < gateway->port_count; i++)
		show_counters(&gateway->ports[i]);
}

static void take_turn(struct gateway *gateway)
{
	int64_t now_ns = map_now_ns();

	beat(gateway, now_ns);
	commands_run(&gateway->commands, now_ns);
	for (uint32_t i = 0; i < gateway->port_count; i++)
		if (now_ns >= gateway->ports[i].deadline_ns)
			serve_port(&gateway->ports[i]);
	arm_timer(gateway);
	wait_and_take(gateway);
}

/* Nothing shall stay switched on for want of a gateway, so far as the devices answer before rtud loses its patience. */
static void serve(struct gateway *gateway)
{
	int64_t limit_ns;

	while (!stop_requested && map_wanted(gateway->map))
		take_turn(gateway);
	limit_ns = map_now_ns() + STOP_NS;
	while (commands_end_pulses(&gateway->commands, map_now_ns()) && map_now_ns() < limit_ns &&
	       map_wanted(gateway->map))
		take_turn(gateway);
}

int main(int argc, char **argv)
{
	struct options options;
	struct gateway gateway = {0};
	char error[MAP_ERROR_SIZE];

	if (!options_parse(argc, argv, "rtu-modbus", &options))
		return WRONG_USAGE;
	set_up_signals();
	if (map_attach(&gateway.map, options.map, options.module, error) < 0) {
		fprintf(stderr, "rtu-modbus: %s\n", error);
		return WRONG_USAGE;
	}
	prctl(PR_SET_NAME, options.module); /* rtud executes a descriptor, whose number would be its name */
	gateway.config = map_config(gateway.map);
	set_up_ports(&gateway, options.devices);
	set_up_commands(&gateway);
	if (!set_up_waiting(&gateway)) {
		map_log(gateway.map, MAP_LOG_ERROR, "no epoll or timer: %s", strerror(errno));
		return EXIT_FAILURE;
	}
	if (mlockall(MCL_CURRENT | MCL_FUTURE) < 0)
		map_log(gateway.map, MAP_LOG_INFO, "memory is not locked: %s", strerror(errno));
	serve(&gateway);
	map_detach(gateway.map);
	release_ports(&gateway);
	return EXIT_SUCCESS;
}
