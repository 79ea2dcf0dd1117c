/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The server of IEC 61850: one module, if the configuration has "iec61850". */
#include <arpa/inet.h>
#include <errno.h>
#include <string.h>
#include <unistd.h>

#include "iec61850/config.h"
#include "iec61850/config_part.h"
#include "iec61850/kept.h"
#include "map/address.h"
#include "modules/calls.h"
#include "modules/kind.h"

#define USER     17 /* behind rtu-snmp, before those of others */
#define BACKLOG  64
#define REQUESTS 256

static const struct call_rule calls[] = {
    CALL(poll), CALL(ppoll_time64), CALL(ppoll), CALL(accept4),  CALL(setsockopt),
    CALL(send), CALL(sendto),       CALL(recv),  CALL(recvfrom),
};

static const struct kind_program program = {
    .name = "rtu-iec61850",
    .calls = calls,
    .call_count = sizeof(calls) / sizeof(calls[0]),
};

static bool plan(struct map_config *config)
{
	const struct iec61850_settings *settings = iec61850_settings(config);
	const bool commands = settings != NULL && settings->controller_count > 0;
	const struct map_module_plan module = {
	    .name = "rtu-iec61850",
	    .kind = IEC61850_KIND,
	    .flags = MAP_HEARS_EVENTS | (commands ? MAP_MAY_REQUEST : 0u),
	    .rings = {.requests = commands ? REQUESTS : 1, .answers = 1, .events = 1, .log = 128},
	    .heartbeat_limit_ms = MAP_IDLE_HEARTBEAT_LIMIT_MS,
	    .section_size = settings == NULL ? 0 : (uint32_t)iec61850_section_size(config),
	    .history = {.at = IEC61850_HISTORY_AT,
			.readers = IEC61850_KEPT_ALL,
			.entries = settings == NULL ? 0 : settings->report_buffer},
	    .counters = IEC61850_COUNT_OF_COUNTERS,
	    .user = USER,
	};

	return settings == NULL || map_plan_module(config, &module) != MAP_NONE;
}

/* Port 102 is root's. */
static int open_socket(const struct map_config *config)
{
	const struct iec61850_settings *settings = iec61850_settings(config);
	const uint16_t port = htons(settings->port);
	struct sockaddr_in6 six = {.sin6_family = AF_INET6, .sin6_port = port};
	struct sockaddr_in four = {.sin_family = AF_INET, .sin_port = port};
	const int on = 1;
	bool is_four;
	int fd, error;

	if (!map_address_parse(settings->address, &six.sin6_addr))
		return -1;
	is_four = IN6_IS_ADDR_V4MAPPED(&six.sin6_addr);
	memcpy(&four.sin_addr, &six.sin6_addr.s6_addr[12], sizeof(four.sin_addr));
	fd = socket(is_four ? AF_INET : AF_INET6, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
	if (fd < 0)
		return -1;
	setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
	if (bind(fd, is_four ? (const struct sockaddr *)&four : (const struct sockaddr *)&six,
		 is_four ? sizeof(four) : sizeof(six)) == 0 &&
	    listen(fd, BACKLOG) == 0)
		return fd;
	error = errno;
	close(fd);
	errno = error;
	return -1;
}

static bool same(const struct map_config *a, const struct map_config *b, uint32_t module, const char *name)
{
	const uint32_t count = map_record_count(b, IEC61850_ASSIGNMENTS);

	(void)module, (void)name;
	return memcmp(iec61850_settings(a), iec61850_settings(b), sizeof(struct iec61850_settings)) == 0 &&
	       map_record_count(a, IEC61850_ASSIGNMENTS) == count &&
	       (count == 0 || memcmp(iec61850_assignments(a), iec61850_assignments(b),
				     count * sizeof(struct iec61850_assignment)) == 0);
}

/* Its clients browse anew. */
static enum kind_change change(const struct map_config *before, const struct map_config *now)
{
	(void)before, (void)now;
	return KIND_STARTS_AGAIN;
}

const struct kind iec61850_kind = {
    .name = IEC61850_KIND,
    .part = &iec61850_part,
    .plan = plan,
    .programs = &program,
    .program_count = 1,
    .open = open_socket,
    .same = same,
    .change = change,
    .by_numbers = true, /* clients have browsed the points, and have to do so anew when they are others */
};
