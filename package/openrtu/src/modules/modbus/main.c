/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * rtu-modbus: the controlling station of some RS-485 lines and Modbus TCP connections. One loop serves all lines
 * that the configuration gives to this process: their ports (port.c), what they tell (line_results.c) and what they
 * are told to write (commands.c).
 */
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/mman.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include "map/map.h"
#include "map/time_ns.h"
#include "modbus/configured.h"
#include "modbus/convert.h"
#include "modbus/stats.h"
#include "modules/modbus/commands.h"
#include "modules/modbus/constants.h"
#include "modules/modbus/line_counters.h"
#include "modules/modbus/line_results.h"
#include "modules/modbus/passing.h"
#include "modules/modbus/port.h"
#include "modules/modbus/quality.h"
#include "modules/modbus/refresh.h"
#include "process/heartbeat.h"
#include "process/module.h"
#include "synch/synched.h"

#define STOP_NS      (2 * NS_PER_S) /* rtud waits 3 s */
#define HEARTBEAT_NS (MAP_HEARTBEAT_PERIOD_MS * NS_PER_MS)
#define EPOLL_EVENTS 16

/* What the net is told of a line's scans, if it wants to know. */
struct line_scans {
	struct synched synched;
	uint32_t told;
};

struct gateway {
	struct map *map;
	const struct map_config *config;
	struct port *ports;           /* one for each line of this process */
	struct line_results *results; /* of these lines */
	struct line_scans *scans;
	uint32_t port_count;
	struct commands commands;
	struct passing passing;
	struct quality quality;
	int8_t *exponents; /* of all points */
	struct heartbeat heartbeat;
	struct refresh refresh;
	struct map_update *updates; /* room for the largest device */
	int epoll_fd;
	int timer_fd;
	int heartbeat_fd;
	int64_t heartbeat_ns; /* the next one, which wakes this process */
	int64_t due_ns;       /* of the ports that are due first */
	int64_t armed_ns;     /* what the timer is set to; 0: it has expired */
};

static volatile sig_atomic_t stop_requested;

static void request_stop(int signal_number)
{
	(void)signal_number;
	stop_requested = 1;
}

/* ---- commands ---------------------------------------------------------------------------------------- */

static struct port *port_of_line(struct gateway *gateway, uint32_t line)
{
	for (uint32_t i = 0; i < gateway->port_count; i++)
		if (gateway->ports[i].number == line)
			return &gateway->ports[i];
	return NULL;
}

/* Where what a command has changed shows at once; 0: it is not read, or not ahead of its turn. */
static uint8_t reads_back(const struct map_config *config, uint32_t point)
{
	const struct modbus_point *wire = &modbus_points(config)[point];

	if (wire->flags & MODBUS_NO_READ_BACK)
		return 0;
	if ((config->points[point].flags & MAP_POINT_NEVER_READ) &&
	    !modbus_is_broadcast(config, config->points[point].set))
		return 0;
	return modbus_read_function((enum modbus_table)wire->table);
}

/* Hands a write to its line, which will answer it. */
static bool write_to_line(void *context, uint32_t point, const struct modbus_request *request,
			  int64_t deadline_ns)
{
	struct gateway *gateway = context;
	uint32_t device = gateway->config->points[point].set;
	struct port *port = port_of_line(gateway, modbus_slaves(gateway->config)[device].port);
	struct modbus_command command = {.tag = point,
					 .deadline_ns = deadline_ns,
					 .read_function = reads_back(gateway->config, point),
					 .read_address = modbus_points(gateway->config)[point].address,
					 .request = *request};

	if (port == NULL)
		return false;
	command.device = device - port->config->first_device;
	if (!modbus_line_command(&port->line, &command))
		return false;
	port->deadline_ns = 0;
	return true;
}

static void hear_bell(struct gateway *gateway, bool heard)
{
	struct epoll_event event = {.events = heard ? EPOLLIN : 0, .data.ptr = gateway};

	epoll_ctl(gateway->epoll_fd, EPOLL_CTL_MOD, map_bell_fd(gateway->map), &event);
}

static void take_requests(struct gateway *gateway)
{
	struct map_request request;

	map_bell_clear(gateway->map);
	if (map_bell_is_wild(gateway->map))
		hear_bell(gateway, false);
	while (!stop_requested && map_request_next(gateway->map, &request))
		commands_request(&gateway->commands, &request);
}

/* ---- start ------------------------------------------------------------------------------------------- */

static void out_of_memory(void)
{
	fputs("rtu-modbus: not enough memory for the configuration\n", stderr);
	exit(MODULE_FAILED);
}

static void *allocate(size_t count, size_t size)
{
	void *memory = calloc(count ? count : 1, size);

	if (memory == NULL)
		out_of_memory();
	return memory;
}

static struct line_news *new_news(uint32_t count)
{
	struct line_news *news = allocate(count, sizeof(*news));

	for (uint32_t i = 0; i < count; i++)
		news[i].stranger = LINE_NEWS_NOBODY;
	return news;
}

/* That it is written without a command. */
static void say_pages(const struct gateway *gateway, uint32_t device, const struct modbus_pages *pages)
{
	if (pages != NULL)
		map_log(gateway->map, MAP_LOG_INFO,
			"%s: register %u is written before each read of its %u page%s",
			gateway->config->sets[device].name, pages->address, pages->count,
			pages->count == 1 ? "" : "s");
}

static void set_up_port(struct gateway *gateway, uint32_t number, const char *directory)
{
	struct port *port = &gateway->ports[gateway->port_count];
	char name[MAP_NAME_SIZE];
	struct line_results *results = &gateway->results[gateway->port_count];

	port_init(port, gateway->map, number, directory, gateway->epoll_fd);
	port->line = (struct modbus_line){.events = &line_results_events, .context = results};
	*results = (struct line_results){.map = gateway->map,
					 .config = port->config,
					 .line = &port->line,
					 .commands = &gateway->commands,
					 .passing = &gateway->passing,
					 .quality = &gateway->quality,
					 .updates = gateway->updates,
					 .news = new_news(port->config->device_count),
					 .points = modbus_points(gateway->config),
					 .exponents = gateway->exponents};
	if (!modbus_line_configure(&port->line, gateway->config, number))
		out_of_memory();
	for (uint32_t i = 0; i < port->line.device_count; i++) {
		constants_make(gateway->config, &port->line.devices[i]);
		say_pages(gateway, port->config->first_device + i, port->line.devices[i].pages);
		port->line.devices[i].vouched = line_results_vouch(results, i);
	}
	modbus_name_counters(gateway->map, number);
	line_counters_take(port);
	snprintf(name, sizeof(name), "line%u", port->config->port);
	synched_begin(&gateway->scans[gateway->port_count].synched, gateway->map, name);
	gateway->port_count++;
}

static void set_up_ports(struct gateway *gateway, const char *directory)
{
	const struct map_config *config = gateway->config;
	uint32_t largest = 0;

	for (uint32_t i = 0; i < config->set_count; i++)
		if (config->sets[i].point_count > largest)
			largest = config->sets[i].point_count;
	gateway->updates = allocate(largest, sizeof(*gateway->updates));
	quality_init(&gateway->quality, gateway->map,
		     allocate(map_record_count(config, MODBUS_POINTS), sizeof(*gateway->quality.points)));
	gateway->exponents = allocate(map_record_count(config, MODBUS_POINTS), sizeof(*gateway->exponents));
	for (uint32_t i = 0; i < map_record_count(config, MODBUS_POINTS); i++)
		gateway->exponents[i] = convert_first_exponent(&modbus_points(config)[i]);
	gateway->ports = allocate(modbus_port_count(config), sizeof(*gateway->ports));
	gateway->results = allocate(modbus_port_count(config), sizeof(*gateway->results));
	gateway->scans = allocate(modbus_port_count(config), sizeof(*gateway->scans));
	for (uint32_t i = 0; i < modbus_port_count(config); i++)
		if (modbus_ports(config)[i].module == map_self(gateway->map))
			set_up_port(gateway, i, directory);
	gateway->refresh = (struct refresh){
	    .map = gateway->map, .lines = gateway->results, .line_count = gateway->port_count};
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
			      .exponents = gateway->exponents,
			      .progress = allocate(commands, sizeof(*gateway->commands.progress)),
			      .write = write_to_line,
			      .context = gateway};
	commands_resume(&gateway->commands);
}

/* A tool's requests go to a line of this process, if the configuration has it so. */
static bool set_up_passing(struct gateway *gateway, int listener)
{
	const struct modbus_pass *pass = modbus_pass_of(gateway->config, gateway->ports[0].config->process);

	return pass == NULL ||
	       passing_begin(&gateway->passing, gateway->map, pass, &port_of_line(gateway, pass->port)->line,
			     listener, gateway->epoll_fd);
}

static void release_ports(struct gateway *gateway)
{
	for (uint32_t i = 0; i < gateway->port_count; i++) {
		modbus_line_release(&gateway->ports[i].line);
		free(gateway->results[i].news);
	}
	free(gateway->ports);
	free(gateway->results);
	free(gateway->scans);
	free(gateway->updates);
	free(gateway->exponents);
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

/* ---- the loop ---------------------------------------------------------------------------------------- */

/* To set the timer costs most of what a wake-up costs. What is due behind the next heartbeat is looked at again then. */
static void arm_timer(struct gateway *gateway)
{
	int64_t at_ns = commands_deadline(&gateway->commands);

	gateway->due_ns = ports_due_ns(gateway->ports, gateway->port_count);
	if (gateway->due_ns < at_ns)
		at_ns = gateway->due_ns;
	if (at_ns < 1)
		at_ns = 1; /* 0 would disarm */
	if (at_ns >= gateway->heartbeat_ns || at_ns == gateway->armed_ns)
		return;
	gateway->armed_ns = at_ns;
	struct itimerspec timer = {.it_value = timespec_of(at_ns)};
	timerfd_settime(gateway->timer_fd, TFD_TIMER_ABSTIME, &timer, NULL);
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
		else if (passing_has(&gateway->passing, events[i].data.ptr))
			passing_wake(&gateway->passing, events[i].data.ptr, map_now_ns());
		else
			port_wake(events[i].data.ptr);
	}
}

static void beat(struct gateway *gateway, int64_t now_ns)
{
	if (now_ns < gateway->heartbeat_ns)
		return;
	gateway->heartbeat_ns += ((now_ns - gateway->heartbeat_ns) / HEARTBEAT_NS + 1) * HEARTBEAT_NS;
	if (map_bell_is_wild(gateway->map))
		hear_bell(gateway, true);
	map_bell_new_period(gateway->map);
	if (!refresh_holds(&gateway->refresh, gateway->heartbeat.beaten_ns, now_ns))
		heartbeat_beat(&gateway->heartbeat, gateway->map, now_ns);
	map_totals_tick(gateway->map);
	passing_watch(&gateway->passing, now_ns);
	for (uint32_t i = 0; i < gateway->port_count; i++)
		line_counters_show(&gateway->ports[i]);
}

/* Whoever scans behind this line may begin. */
static void tell_scan(struct gateway *gateway, uint32_t port)
{
	struct line_scans *scans = &gateway->scans[port];

	if (gateway->ports[port].line.counters.scans == scans->told)
		return;
	scans->told = gateway->ports[port].line.counters.scans;
	synched_ended(&scans->synched);
}

/* The line looks at it now. */
static void offer_passing(struct gateway *gateway, int64_t now_ns)
{
	if (passing_offer(&gateway->passing, now_ns))
		port_of_line(gateway, gateway->passing.pass->port)->deadline_ns = 0;
}

static void take_turn(struct gateway *gateway)
{
	int64_t now_ns = map_now_ns();

	beat(gateway, now_ns);
	commands_run(&gateway->commands, now_ns);
	offer_passing(gateway, now_ns);
	for (uint32_t i = 0; i < gateway->port_count; i++)
		if (now_ns >= gateway->ports[i].deadline_ns) {
			port_serve(&gateway->ports[i], gateway->due_ns);
			tell_scan(gateway, i);
		}
	arm_timer(gateway);
	wait_and_take(gateway);
}

/* Nothing shall stay switched on for want of a gateway, so far as the devices answer before rtud loses its patience. */
static void serve(struct gateway *gateway)
{
	int64_t limit_ns;

	while (!stop_requested && map_may_run(gateway->map))
		take_turn(gateway);
	limit_ns = map_now_ns() + STOP_NS;
	while (commands_end_pulses(&gateway->commands, map_now_ns()) && map_now_ns() < limit_ns &&
	       map_may_run(gateway->map))
		take_turn(gateway);
	/* The next process goes on with it. */
	for (uint32_t i = 0; i < gateway->port_count; i++)
		line_counters_show(&gateway->ports[i]);
}

int main(int argc, char **argv)
{
	struct options options;
	struct gateway gateway = {0};

	set_up_signals();
	gateway.map = module_begin(argc, argv, &options);
	if (!modbus_is_known(gateway.map))
		return module_is_of_another_build(gateway.map);
	gateway.config = map_config(gateway.map);
	gateway.epoll_fd = epoll_create1(EPOLL_CLOEXEC);
	set_up_ports(&gateway, options.devices);
	set_up_commands(&gateway);
	heartbeat_begin(&gateway.heartbeat, gateway.map);
	if (!set_up_waiting(&gateway) || !set_up_passing(&gateway, options.socket_fd)) {
		map_log(gateway.map, MAP_LOG_ERROR, "cannot set up waiting: %s", strerror(errno));
		return MODULE_FAILED;
	}
	/* What it has used stays in memory. What it never uses, as most of libc and of the room for split reads, takes none. */
	if (mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) < 0)
		map_log(gateway.map, MAP_LOG_INFO, "cannot lock memory: %s", strerror(errno));
	if (!module_confine(gateway.map, &options, 0))
		return MODULE_FAILED;
	serve(&gateway);
	map_detach(gateway.map);
	release_ports(&gateway);
	return MODULE_ENDED;
}
