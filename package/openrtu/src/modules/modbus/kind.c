/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Modbus lines: a module for each process number among them. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#include "modbus/config.h"
#include "modbus/config_part.h"
#include "modbus/same.h"
#include "modbus/stats.h"
#include "modules/kind.h"
#include "process/calls.h"
#include "synch/config.h"

#define FIRST_USER 3             /* those before are of modules that there is one of */
#define NAME       "rtu-modbus-" /* and the number of the process */

/* The first: what the scheduler counts of this process (process/heartbeat.c). */
#define LINE_CALLS                                                                                           \
	CALL(pread64), CALL(epoll_wait), CALL(epoll_pwait), CALL(epoll_ctl), CALL(timerfd_settime64),        \
	    CALL(timerfd_settime), SERIAL_PORT_CALLS, TCP_CONNECTION_CALLS, CALL(poll), CALL(ppoll_time64),  \
	    CALL(ppoll)
#define LISTENING_CALLS CALL(accept4), CALL(send), CALL(sendto)
#define UDP_CALLS       UDP_SOCKET(AF_INET), UDP_SOCKET(AF_INET6)
static const struct call_rule calls[] = {LINE_CALLS};
static const struct call_rule listening_calls[] = {LINE_CALLS, LISTENING_CALLS};
static const struct call_rule udp_calls[] = {LINE_CALLS, UDP_CALLS};
static const struct call_rule all_calls[] = {LINE_CALLS, LISTENING_CALLS, UDP_CALLS};

#define PROGRAM(calls)                                                                                       \
	{                                                                                                    \
		"rtu-modbus", calls, sizeof(calls) / sizeof((calls)[0])                                      \
	}
static const struct kind_program programs[] = {PROGRAM(calls), PROGRAM(listening_calls), PROGRAM(udp_calls),
					       PROGRAM(all_calls)};

static bool has_udp(const struct map_config *config)
{
	for (uint32_t i = 0; i < modbus_port_count(config); i++)
		if (modbus_is_udp(&modbus_ports(config)[i]))
			return true;
	return false;
}

/* It may do what the file asks for. */
static const struct kind_program *choose(const struct map_config *config)
{
	return &programs[(map_record_count(config, MODBUS_PASSES) > 0 ? 1 : 0) + (has_udp(config) ? 2 : 0)];
}

static int priority(const struct map_config *config)
{
	return modbus_settings(config)->priority;
}

static uint32_t lines_of(const struct map_config *config, uint16_t process)
{
	uint32_t lines = 0;

	for (uint32_t i = 0; i < modbus_port_count(config); i++)
		lines += modbus_ports(config)[i].process == process;
	return lines;
}

static bool plan(struct map_config *config)
{
	const uint32_t limit_ms = modbus_settings(config)->heartbeat_limit_ms;
	struct map_module_plan module = {
	    .kind = MODBUS_KIND,
	    .flags = MAP_MAY_OWN,
	    .rings = {.requests = 1, .answers = 256, .events = config->settings.event_ring, .log = 128},
	    .heartbeat_limit_ms = limit_ms ? limit_ms : MAP_HEARTBEAT_LIMIT_MS,
	    .user = FIRST_USER,
	};

	for (uint32_t i = 0; i < modbus_port_count(config); i++) {
		uint32_t before = config->module_count, number;
		char line[MAP_NAME_SIZE];

		snprintf(module.name, sizeof(module.name), NAME "%u", modbus_ports(config)[i].process);
		module.section_size = (uint32_t)modbus_stats_size(config, modbus_ports(config)[i].process);
		module.counters = MODBUS_LINE_COUNTERS * lines_of(config, modbus_ports(config)[i].process);
		number = map_plan_module(config, &module);
		if (number == MAP_NONE)
			return false;
		modbus_ports(config)[i].module = (uint16_t)number;
		module.user += config->module_count - before;
		snprintf(line, sizeof(line), "line%u", modbus_ports(config)[i].port);
		synch_bind(config, line, number);
	}
	for (uint32_t i = 0; i < modbus_slave_count(config); i++)
		config->sets[i].module = modbus_ports(config)[modbus_slaves(config)[i].port].module;
	return true;
}

/* ---- where a tool connects ------------------------------------------------------------------- */

static uint16_t process_of(const char *module)
{
	return (uint16_t)strtoul(module + strlen(NAME), NULL, 10);
}

static const struct modbus_pass *pass_of(const struct map_config *config, const char *module)
{
	return modbus_pass_of(config, process_of(module));
}

static bool listens(const struct map_config *config, const char *module, struct kind_port *out)
{
	const struct modbus_pass *pass = pass_of(config, module);

	if (pass != NULL)
		*out = (struct kind_port){SOCK_STREAM, pass->address, pass->tcp_port};
	return pass != NULL;
}

/* Port 502 is root's. */
static int open_socket(const struct map_config *config, const char *module)
{
	const struct modbus_pass *pass = pass_of(config, module);

	return kind_open_port(pass->address, pass->tcp_port, SOCK_STREAM);
}

/* ---- what is the same in two configurations -------------------------------------------------- */

static bool same_expected(const struct map_config *a, uint32_t in_a, const struct map_config *b,
			  uint32_t in_b)
{
	uint32_t count, other;
	const struct modbus_expected *of_a = modbus_expected_of(a, in_a, &count);
	const struct modbus_expected *of_b = modbus_expected_of(b, in_b, &other);

	if (count != other)
		return false;
	for (uint32_t i = 0; i < count; i++)
		if (of_a[i].object != of_b[i].object || strcmp(of_a[i].text, of_b[i].text) != 0)
			return false;
	return true;
}

static bool same_slave(const struct map_config *a, uint32_t in_a, const struct map_config *b, uint32_t in_b)
{
	const struct modbus_slave *of_a = &modbus_slaves(a)[in_a], *of_b = &modbus_slaves(b)[in_b];

	if (of_a->unit != of_b->unit || of_a->retries != of_b->retries ||
	    of_a->response_timeout_ms != of_b->response_timeout_ms ||
	    of_a->response_timeout_min_ms != of_b->response_timeout_min_ms ||
	    of_a->max_bits != of_b->max_bits || of_a->max_registers != of_b->max_registers ||
	    of_a->no_holes != of_b->no_holes || of_a->probe_max_s != of_b->probe_max_s ||
	    of_a->reaction_us != of_b->reaction_us || of_a->pause_ms != of_b->pause_ms ||
	    of_a->writes_multiple != of_b->writes_multiple || of_a->not_asked != of_b->not_asked ||
	    of_a->page_address != of_b->page_address)
		return false;
	if (!same_expected(a, in_a, b, in_b))
		return false;
	for (uint32_t i = 0; i < a->sets[in_a].point_count; i++)
		if (!modbus_same_point(a, a->sets[in_a].first_point + i, b, b->sets[in_b].first_point + i))
			return false;
	return true;
}

static bool same_port(const struct map_config *a, const struct modbus_port *of_a, const struct map_config *b,
		      const struct modbus_port *of_b)
{
	if (of_a->port != of_b->port || of_a->process != of_b->process ||
	    of_a->device_count != of_b->device_count || of_a->data_bits != of_b->data_bits ||
	    of_a->stop_bits != of_b->stop_bits || of_a->parity != of_b->parity || of_a->baud != of_b->baud ||
	    of_a->rs485 != of_b->rs485 || of_a->before_ms != of_b->before_ms ||
	    of_a->after_ms != of_b->after_ms || of_a->tcp_port != of_b->tcp_port ||
	    of_a->settle_ms != of_b->settle_ms || of_a->framing != of_b->framing ||
	    of_a->transport != of_b->transport || strcmp(of_a->device, of_b->device) != 0)
		return false;
	for (uint32_t i = 0; i < of_a->device_count; i++)
		if (!same_slave(a, of_a->first_device + i, b, of_b->first_device + i))
			return false;
	return true;
}

static bool same_pass(const struct map_config *a, const struct map_config *b, const char *module)
{
	const struct modbus_pass *in_a = pass_of(a, module), *in_b = pass_of(b, module);
	struct modbus_pass of_a, of_b;

	if (in_a == NULL || in_b == NULL)
		return in_a == in_b;
	of_a = *in_a;
	of_b = *in_b;
	of_a.port = modbus_ports(a)[of_a.port].port;
	of_b.port = modbus_ports(b)[of_b.port].port;
	return memcmp(&of_a, &of_b, sizeof(of_a)) == 0;
}

static uint32_t next_port(const struct map_config *config, uint32_t module, uint32_t from)
{
	while (from < modbus_port_count(config) && modbus_ports(config)[from].module != module)
		from++;
	return from;
}

/* Their sets have been compared: there are as many of their points. */
static bool same(const struct map_config *a, const struct map_config *b, uint32_t module, const char *name)
{
	uint32_t i = next_port(a, module, 0), j = next_port(b, module, 0);

	if (modbus_settings(a)->priority != modbus_settings(b)->priority || !same_pass(a, b, name))
		return false;
	while (i < modbus_port_count(a) && j < modbus_port_count(b) &&
	       same_port(a, &modbus_ports(a)[i], b, &modbus_ports(b)[j])) {
		i = next_port(a, module, i + 1);
		j = next_port(b, module, j + 1);
	}
	return i == modbus_port_count(a) && j == modbus_port_count(b);
}

static void carry(const struct map_config *before, const void *from, const struct map_config *now, void *to,
		  const char *module)
{
	modbus_carry_stats(before, from, now, to, process_of(module));
}

const struct kind modbus_kind = {
    .name = MODBUS_KIND,
    .part = &modbus_part,
    .plan = plan,
    .programs = programs,
    .program_count = sizeof(programs) / sizeof(programs[0]),
    .choose = choose,
    .listens = listens,
    .open = open_socket,
    .priority = priority,
    .same = same,
    .carry = carry,
    .group = "dialout", /* to which Debian and Buildroot give serial devices */
};
