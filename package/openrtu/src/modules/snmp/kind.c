/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The agent: one module, if the configuration has "snmp". */
#include "modules/kind.h"

#include <arpa/inet.h>
#include <errno.h>
#include <linux/sockios.h>
#include <stddef.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "map/folder.h"
#include "process/calls.h"
#include "snmp/config.h"
#include "snmp/config_part.h"
#include "snmp/shared.h"

#define USER 16 /* behind those that programs of rtu-logic take, before those of others */

static const struct call_rule calls[] = {
    CALL(poll),         CALL(ppoll_time64), CALL(ppoll),    CALL(recvmsg), CALL(sendmsg),
    CALL(recvfrom),     CALL(sendto),       CALL(recv),     CALL(times), /* libnetsnmp: ticks */
    CALL(getrandom),    CALL(futex_time64), CALL(futex),                 /* libcrypto */
    CALL(pread64),      CALL(statfs),       CALL(statfs64), /* the machine: modules/snmp/kernel.c */
    IOCTL(SIOCETHTOOL),
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

/* A port below 1024 is root's. An answer leaves from the address that was asked. */
static int open_socket(const struct map_config *config, const char *module)
{
	const struct snmp_settings *settings = snmp_settings(config);
	const int fd = kind_open_port(settings->address, settings->port, SOCK_DGRAM), on = 1;
	int family = AF_UNSPEC;
	socklen_t size = sizeof(family);

	(void)module;
	if (fd < 0)
		return -1;
	getsockopt(fd, SOL_SOCKET, SO_DOMAIN, &family, &size);
	if (family == AF_INET)
		setsockopt(fd, IPPROTO_IP, IP_PKTINFO, &on, sizeof(on));
	else
		setsockopt(fd, IPPROTO_IPV6, IPV6_RECVPKTINFO, &on, sizeof(on));
	return fd;
}

static void begin(struct map *map, const struct map_config *config, uid_t user, gid_t group)
{
	const struct snmp_settings *settings = snmp_settings(config);
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
		kind_give_secret(map, settings->keys, "the keys of SNMP to rtu-snmp", user, group);
}

/* What only SNMP shows of points. */
static bool same_units(const struct map_config *a, const struct map_config *b)
{
	if (a->point_count != b->point_count)
		return false;
	for (uint32_t i = 0; i < a->point_count; i++)
		if (a->points[i].decimals != b->points[i].decimals ||
		    strcmp(map_unit_of(a, &a->points[i]), map_unit_of(b, &b->points[i])) != 0)
			return false;
	return true;
}

static bool same(const struct map_config *a, const struct map_config *b, uint32_t module, const char *name)
{
	(void)module, (void)name;
	return memcmp(snmp_settings(a), snmp_settings(b), sizeof(struct snmp_settings)) == 0 &&
	       same_units(a, b);
}

/* ---- what passes over to a changed configuration ----------------------------------------- */

/* SNMP_NO_USER: there is none of this name any more. */
static uint8_t user_now(const struct snmp_settings *before, uint8_t user, const struct snmp_settings *now)
{
	for (uint8_t i = 0; user < before->user_count && i < now->user_count; i++)
		if (strcmp(now->users[i].name, before->users[user].name) == 0)
			return i;
	return SNMP_NO_USER;
}

static void carry_users(const struct snmp_settings *before, const struct snmp_shared *from,
			const struct snmp_settings *now, struct snmp_shared *to)
{
	for (uint32_t i = 0; i < SNMP_EVENTS; i++)
		if (to->events[i].kind == SNMP_EVENT_COMMAND && to->events[i].user != SNMP_NO_USER)
			to->events[i].user = user_now(before, to->events[i].user, now);
	memset(to->taken, 0, sizeof(to->taken));
	for (uint8_t i = 0; i < before->user_count; i++) {
		const uint8_t user = user_now(before, i, now);

		for (unsigned class = 0; user != SNMP_NO_USER && class < 2; class ++)
			to->taken[user][class] = from->taken[i][class];
	}
}

/* A sink of another name is told what happens from now on. */
static void carry_sinks(const struct snmp_settings *before, struct snmp_shared *from,
			const struct snmp_settings *now, struct snmp_shared *to)
{
	const uint32_t last = from->copies[latch_whole_copy(&from->latch)].last;

	for (uint32_t i = 0; i < now->sink_count; i++) {
		uint32_t j = 0;

		while (j < before->sink_count && strcmp(now->sinks[i].name, before->sinks[j].name) != 0)
			j++;
		to->confirmed[i] = j < before->sink_count ? from->confirmed[j] : last;
		to->sink_lost[i] = j < before->sink_count ? from->sink_lost[j] : 0;
	}
}

/* A station that the configuration has no more is a new one if it comes back. */
static void carry_stations(const struct map_config *now, const struct snmp_shared *from,
			   struct snmp_shared *to)
{
	memset(to->initialised, 0, sizeof(to->initialised));
	for (uint32_t i = 0; i < now->set_count; i++) {
		const uint16_t ca = now->sets[i].ca;

		to->initialised[ca / 8] =
		    (uint8_t)(to->initialised[ca / 8] | (from->initialised[ca / 8] & 1u << ca % 8));
	}
	to->changed = true;
}

/* The numbers of events go on, and each sink and each user who polls is where it was. The new process has its own counters. */
static void carry(const struct map_config *before, const void *from, const struct map_config *now, void *to,
		  const char *module)
{
	static struct snmp_shared former;
	const size_t counters = offsetof(struct snmp_shared, confirmed);

	(void)module;
	memcpy(&former, from, sizeof(former));
	memcpy((uint8_t *)to + counters, (const uint8_t *)&former + counters, sizeof(former) - counters);
	carry_users(snmp_settings(before), &former, snmp_settings(now), to);
	carry_sinks(snmp_settings(before), &former, snmp_settings(now), to);
	carry_stations(now, &former, to);
}

static bool listens(const struct map_config *config, const char *module, struct kind_port *out)
{
	(void)module;
	*out = (struct kind_port){SOCK_DGRAM, snmp_settings(config)->address, snmp_settings(config)->port};
	return true;
}

const struct kind snmp_kind = {
    .name = SNMP_KIND,
    .part = &snmp_part,
    .plan = plan,
    .listens = listens,
    .programs = &program,
    .program_count = 1,
    .begin = begin,
    .open = open_socket,
    .same = same,
    .change = kind_starts_again, /* the agent keeps what its sessions were opened with */
    .carry = carry,
    .by_numbers = true, /* of its lists */
};
