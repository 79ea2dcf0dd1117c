/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The page: one module, if the configuration has "web". */
#include "modules/kind.h"

#include <string.h>
#include <sys/socket.h>

#include "process/calls.h"
#include "web/config.h"
#include "web/config_part.h"
#include "web/setup.h"

#define USER 18 /* behind rtu-iec61850's */
/*
 * Of address space, much of it the code of libraries: libmicrohttpd may be built with GnuTLS, which the page does not use. The
 * hash of a password takes 16 MiB at most, for as long as it is computed.
 */
#define MEMORY (64u << 20)

static const struct call_rule calls[] = {
    TLS_CALLS,
    CALL(poll),
    CALL(ppoll_time64),
    CALL(ppoll),
    CALL(epoll_ctl),
    CALL(epoll_wait),
    CALL(epoll_pwait),
    CALL(epoll_pwait2),
    CALL(accept4),
    CALL(recv),
    CALL(recvfrom),
    CALL(send),
    CALL(sendto),
    CALL(sendmsg),
    CALL(writev),
    CALL(shutdown),
    CALL(getsockopt),
    CALL(setsockopt),
    CALL(fcntl),
    CALL(fcntl64),
    CALL(madvise), /* of malloc */
    CALL_WITH(socketpair, EQUAL(0, AF_UNIX)),
};

static const struct kind_program program = {
    .name = "rtu-web",
    .calls = calls,
    .call_count = sizeof(calls) / sizeof(calls[0]),
};

/* Without commands, rtud takes its wishes and no point does. */
static uint32_t flags_of(const struct web_settings *settings)
{
	uint32_t flags = settings->commands || settings->setup ? MAP_MAY_REQUEST : 0;

	if (settings->setup)
		flags |= settings->commands ? MAP_ASKS_SETUP : MAP_ASKS_SETUP | MAP_REQUESTS_LISTED;
	return flags;
}

static bool plan(struct map_config *config)
{
	const struct web_settings *settings = web_settings(config);
	const struct map_module_plan module = {
	    .name = "rtu-web",
	    .kind = WEB_KIND,
	    .flags = settings != NULL ? flags_of(settings) : 0,
	    .rings = {.requests = 64, .answers = 1, .events = 1, .log = 128},
	    .heartbeat_limit_ms = MAP_IDLE_HEARTBEAT_LIMIT_MS,
	    .section_size =
		settings != NULL && settings->setup ? sizeof(struct web_section) : sizeof(struct web_stats),
	    .counters = WEB_COUNT_OF_COUNTERS,
	    .user = USER,
	};

	return settings == NULL || map_plan_module(config, &module) != MAP_NONE;
}

static void run(const struct map_config *config, const char *module, struct kind_run *out)
{
	(void)config, (void)module;
	out->memory = MEMORY;
}

/* A port below 1024 is root's. */
static int open_socket(const struct map_config *config, const char *module)
{
	const struct web_settings *settings = web_settings(config);

	(void)module;
	return kind_open_port(settings->address, settings->port, SOCK_STREAM);
}

static void begin(struct map *map, const struct map_config *config, uid_t user, gid_t group)
{
	const struct web_settings *settings = web_settings(config);

	if (settings != NULL && user != 0)
		kind_give_secret(map, settings->users, "the users of the page to rtu-web", user, group);
}

static bool same(const struct map_config *a, const struct map_config *b, uint32_t module, const char *name)
{
	(void)module, (void)name;
	return memcmp(web_settings(a), web_settings(b), sizeof(struct web_settings)) == 0;
}

static bool listens(const struct map_config *config, const char *module, struct kind_port *out)
{
	(void)module;
	*out = (struct kind_port){SOCK_STREAM, web_settings(config)->address, web_settings(config)->port};
	return true;
}

const struct kind web_kind = {
    .name = WEB_KIND,
    .part = &web_part,
    .plan = plan,
    .listens = listens,
    .programs = &program,
    .program_count = 1,
    .run = run,
    .begin = begin,
    .open = open_socket,
    .same = same,
    .change = kind_starts_again, /* its socket is what it was started with */
};
