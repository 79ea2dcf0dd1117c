/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The agent: one module, if the configuration has "snmp". */
#include "modules/kind.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "map/address.h"
#include "map/folder.h"
#include "modules/calls.h"
#include "snmp/config.h"
#include "snmp/config_part.h"
#include "snmp/shared.h"

#define USER 16 /* behind those that programs of rtu-logic take, before those of others */

static const struct call_rule calls[] = {
    CALL(poll),      CALL(ppoll_time64), CALL(ppoll),  CALL(recvmsg),
    CALL(sendmsg),   CALL(recvfrom),     CALL(sendto), CALL(times), /* libnetsnmp: ticks */
    CALL(getrandom), CALL(futex_time64), CALL(futex),               /* libcrypto */
};

static const struct kind_program program = {
    .name = "rtu-snmp",
    .calls = calls,
    .call_count = sizeof(calls) / sizeof(calls[0]),
};

static bool plan(struct map_config *config)
{
	const struct map_module_plan module = {
	    .name = "rtu-snmp",
	    .kind = SNMP_KIND,
	    .flags = MAP_MAY_REQUEST | MAP_HEARS_EVENTS,
	    .rings = {.requests = 256, .answers = 1, .events = 1, .log = 128},
	    .heartbeat_limit_ms = MAP_IDLE_HEARTBEAT_LIMIT_MS,
	    .section_size = sizeof(struct snmp_shared),
	    .counters = SNMP_COUNT_OF_COUNTERS,
	    .user = USER,
	};

	return snmp_settings(config) == NULL || map_plan_module(config, &module) != MAP_NONE;
}

/* ---- what the module's user may not ------------------------------------------------------ */

/* A port below 1024 is root's. */
static int open_socket(const struct map_config *config)
{
	const struct snmp_settings *settings = snmp_settings(config);
	const uint16_t port = htons(settings->port);
	struct sockaddr_in6 six = {.sin6_family = AF_INET6, .sin6_port = port};
	struct sockaddr_in four = {.sin_family = AF_INET, .sin_port = port};
	const int on = 1;
	bool is_four;
	int fd;

	if (!map_address_parse(settings->address, &six.sin6_addr))
		return -1;
	is_four = IN6_IS_ADDR_V4MAPPED(&six.sin6_addr);
	memcpy(&four.sin_addr, &six.sin6_addr.s6_addr[12], sizeof(four.sin_addr));
	fd = socket(is_four ? AF_INET : AF_INET6, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
	if (fd < 0)
		return -1;
	setsockopt(fd, is_four ? IPPROTO_IP : IPPROTO_IPV6, is_four ? IP_PKTINFO : IPV6_RECVPKTINFO, &on,
		   sizeof(on));
	if (bind(fd, is_four ? (const struct sockaddr *)&four : (const struct sockaddr *)&six,
		 is_four ? sizeof(four) : sizeof(six)) == 0)
		return fd;
	close(fd);
	return -1;
}

/* The keys are the module's alone, whoever brought them. */
static void give_keys(struct map *map, const char *path, uid_t user, gid_t group)
{
	const int fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
	struct stat status;

	if (fd < 0)
		return; /* the module says what is wrong with them */
	if (fstat(fd, &status) == 0 && S_ISREG(status.st_mode) &&
	    (fchown(fd, user, group) < 0 || fchmod(fd, 0400) < 0))
		map_log(map, MAP_LOG_ERROR, "cannot give the keys of SNMP to rtu-snmp: %s", strerror(errno));
	close(fd);
}

static void begin(struct map *map, uid_t user, gid_t group)
{
	const struct snmp_settings *settings = snmp_settings(map_config(map));
	int folder;

	if (settings == NULL)
		return;
	folder = map_open_folder(settings->state);
	if (folder < 0) {
		map_log(map, MAP_LOG_ERROR, "cannot make the folder %s for rtu-snmp: %s", settings->state,
			strerror(errno));
		return;
	}
	if (user != 0 && (fchown(folder, user, group) < 0 || fchmod(folder, 0700) < 0))
		map_log(map, MAP_LOG_ERROR, "cannot give the folder %s to rtu-snmp: %s", settings->state,
			strerror(errno));
	close(folder);
	if (user != 0)
		give_keys(map, settings->keys, user, group);
}

static bool same(const struct map_config *a, const struct map_config *b, uint32_t module, const char *name)
{
	(void)module, (void)name;
	return memcmp(snmp_settings(a), snmp_settings(b), sizeof(struct snmp_settings)) == 0;
}

/* The agent keeps what its sessions were opened with. */
static enum kind_change change(const struct map_config *before, const struct map_config *now)
{
	(void)before, (void)now;
	return KIND_STARTS_AGAIN;
}

/*
 * Its events name points by numbers that may be others' now, and their places at the sinks are those of former sinks: the numbers
 * of events begin anew, as after a start of the gateway.
 */
static void carry(const struct map_config *before, const void *from, const struct map_config *now, void *to,
		  const char *module)
{
	const size_t counters = offsetof(struct snmp_shared, confirmed);

	(void)before, (void)from, (void)now, (void)module;
	memset((uint8_t *)to + counters, 0, sizeof(struct snmp_shared) - counters);
}

const struct kind snmp_kind = {
    .name = SNMP_KIND,
    .part = &snmp_part,
    .plan = plan,
    .programs = &program,
    .program_count = 1,
    .begin = begin,
    .open = open_socket,
    .same = same,
    .change = change,
    .carry = carry,
    .fixed = "snmp",
    .by_numbers = true, /* of its events, and of what a manager has learned */
};
