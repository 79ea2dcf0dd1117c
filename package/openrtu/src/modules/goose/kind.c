/* SPDX-License-Identifier: GPL-3.0-or-later */
/* GOOSE: one module, if the configuration has "goose". */
#include "modules/kind.h"

#include <arpa/inet.h>
#include <errno.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "goose/config_part.h"
#include "goose/stats.h"
#include "modules/goose/filter.h"
#include "process/calls.h"

#define USER               19 /* docs/architecture.md */
#define HEARTBEAT_LIMIT_MS 1000

static const struct call_rule calls[] = {
    CALL(poll),
    CALL(ppoll_time64),
    CALL(ppoll),
    CALL(recv),
    CALL(send),
    CALL(recvfrom),
    CALL(sendto),
    CALL(getsockopt),
    RENEWAL_CALLS,
    {.call = SCMP_SYS(setsockopt),
     .count = 2,
     .arguments = {EQUAL(1, SOL_SOCKET), EQUAL(2, SO_ATTACH_FILTER)}},
};

static const struct kind_program program = {
    .name = "rtu-goose",
    .calls = calls,
    .call_count = sizeof(calls) / sizeof(calls[0]),
};

static bool plan(struct map_config *config)
{
	const uint32_t count = map_record_count(config, GOOSE_SUBSCRIPTIONS);
	const struct map_module_plan module = {
	    .name = "rtu-goose",
	    .kind = GOOSE_KIND,
	    .flags = MAP_MAY_OWN | MAP_HEARS_EVENTS,
	    .rings = {.requests = 1,
		      .answers = 256,
		      .events = count == 0 ? 1 : config->settings.event_ring,
		      .log = 128},
	    .heartbeat_limit_ms = HEARTBEAT_LIMIT_MS,
	    .section_size = sizeof(struct goose_stats),
	    .counters = GOOSE_COUNTERS,
	    .user = USER,
	};
	uint32_t number;

	if (goose_settings(config) == NULL)
		return true;
	number = map_plan_module(config, &module);
	for (uint32_t i = 0; i < count; i++)
		config->sets[goose_subscriptions(config)[i].set].module = (uint16_t)number;
	return number != MAP_NONE;
}

static int priority(const struct map_config *config)
{
	const struct goose_settings *settings = goose_settings(config);

	return settings == NULL ? 0 : settings->priority;
}

/* ---- what the module's user may not ------------------------------------------------------ */

#define MULTICAST_SIZE 6

static int join(int fd, int interface, const struct map_config *config)
{
	for (uint32_t i = 0; i < map_record_count(config, GOOSE_SUBSCRIPTIONS); i++) {
		struct packet_mreq group = {
		    .mr_ifindex = interface, .mr_type = PACKET_MR_MULTICAST, .mr_alen = MULTICAST_SIZE};

		memcpy(group.mr_address, goose_subscriptions(config)[i].stream.destination, MULTICAST_SIZE);
		if (setsockopt(fd, SOL_PACKET, PACKET_ADD_MEMBERSHIP, &group, sizeof(group)) < 0)
			return -1;
	}
	return 0;
}

/* Bound to the interface, whose frames of this one EtherType it gets; CAP_NET_RAW is rtud's alone. */
static int open_socket(const struct map_config *config, const char *module)
{
	const unsigned interface = if_nametoindex(goose_settings(config)->interface);
	const struct sockaddr_ll address = {
	    .sll_family = AF_PACKET, .sll_protocol = htons(GOOSE_ETHERTYPE), .sll_ifindex = (int)interface};
	int fd;

	(void)module;
	if (interface == 0)
		return -1;
	fd = socket(AF_PACKET, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, 0); /* 0: nothing before bind */
	if (fd < 0)
		return -1;
	if (goose_filter(fd, config, 0) == 0 && join(fd, (int)interface, config) == 0 &&
	    bind(fd, (const struct sockaddr *)&address, sizeof(address)) == 0)
		return fd;
	close(fd);
	return -1;
}

/* ---- a changed configuration ----------------------------------------------------------------- */

/* What of a publication or subscription is a number may be another one by now, for the same points. */
static bool same_publications(const struct map_config *a, const struct map_config *b)
{
	const size_t size = map_record_count(a, GOOSE_PUBLICATIONS) * sizeof(struct goose_publication);

	return map_record_count(a, GOOSE_PUBLICATIONS) == map_record_count(b, GOOSE_PUBLICATIONS) &&
	       (size == 0 || memcmp(goose_publications(a), goose_publications(b), size) == 0);
}

static bool same_subscriptions(const struct map_config *a, const struct map_config *b)
{
	const uint32_t count = map_record_count(a, GOOSE_SUBSCRIPTIONS);
	const uint32_t leaves = map_record_count(a, GOOSE_LEAVES);

	if (count != map_record_count(b, GOOSE_SUBSCRIPTIONS) || leaves != map_record_count(b, GOOSE_LEAVES))
		return false;
	for (uint32_t i = 0; i < count; i++) {
		struct goose_subscription of_a = goose_subscriptions(a)[i], of_b = goose_subscriptions(b)[i];

		of_a.set = of_b.set = 0;
		if (memcmp(&of_a, &of_b, sizeof(of_a)) != 0)
			return false;
	}
	return leaves == 0 ||
	       memcmp(goose_leaves(a), goose_leaves(b), leaves * sizeof(struct goose_leaf)) == 0;
}

static bool same(const struct map_config *a, const struct map_config *b, uint32_t module, const char *name)
{
	(void)module, (void)name;
	return memcmp(goose_settings(a), goose_settings(b), sizeof(struct goose_settings)) == 0 &&
	       same_publications(a, b) && same_subscriptions(a, b);
}

static uint32_t reads(const struct map_config *config, const char *module, uint32_t i)
{
	(void)module;
	return i < map_record_count(config, GOOSE_MEMBERS) ? goose_members(config)[i] : MAP_NONE;
}

const struct kind goose_kind = {
    .name = GOOSE_KIND,
    .part = &goose_part,
    .plan = plan,
    .programs = &program,
    .program_count = 1,
    .priority = priority,
    .open = open_socket,
    .same = same,
    .reads = reads,
};
