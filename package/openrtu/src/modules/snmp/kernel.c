/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/snmp/kernel.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/ethtool.h>
#include <linux/if.h>
#include <linux/if_arp.h>
#include <linux/rtnetlink.h>
#include <linux/sockios.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/vfs.h>
#include <time.h>
#include <unistd.h>

static int links = -1, any_socket = -1, memory = -1, mounts = -1;

/* ---- a link ------------------------------------------------------------------------------ */

/* Headers and their contents are multiples of four octets; a header says how long it is with what it carries. */
static const uint8_t *take(const uint8_t **at, size_t *left, void *header, size_t header_size,
			   size_t (*length_of)(const void *header), size_t *size)
{
	const uint8_t *here = *at;
	size_t length, step;

	if (*left < header_size)
		return NULL;
	memcpy(header, here, header_size);
	length = length_of(header);
	if (length < header_size || length > *left)
		return NULL;
	step = NLMSG_ALIGN(length);
	step = step < *left ? step : *left;
	*at += step;
	*left -= step;
	*size = length - header_size;
	return here + header_size;
}

static size_t length_of_attribute(const void *header)
{
	return ((const struct rtattr *)header)->rta_len;
}

static size_t length_of_message(const void *header)
{
	return ((const struct nlmsghdr *)header)->nlmsg_len;
}

static const uint8_t *take_attribute(const uint8_t **at, size_t *left, struct rtattr *header, size_t *size)
{
	return take(at, left, header, sizeof(*header), length_of_attribute, size);
}

static void copy_text(char *out, size_t room, const uint8_t *octets, size_t size)
{
	const size_t length = strnlen((const char *)octets, size);
	const size_t kept = length < room ? length : room - 1;

	memcpy(out, octets, kept);
	out[kept] = '\0';
}

/* IANAifType, of what is not "other". */
enum { OTHER = 1, ETHERNET = 6, PPP = 23, LOOPBACK = 24, TUNNEL = 131, VLAN = 135, LAG = 161, BRIDGE = 209 };

static uint16_t type_of_hardware(uint16_t hardware)
{
	switch (hardware) {
	case ARPHRD_ETHER:
		return ETHERNET;
	case ARPHRD_LOOPBACK:
		return LOOPBACK;
	case ARPHRD_PPP:
		return PPP;
	case ARPHRD_TUNNEL:
	case ARPHRD_TUNNEL6:
	case ARPHRD_SIT:
	case ARPHRD_IPGRE:
		return TUNNEL;
	default:
		return OTHER;
	}
}

/* What is made of software has a kind. */
static void take_kind(struct snmp_interface *out, const char *kind)
{
	static const struct {
		const char *kind;
		uint16_t type;
	} types[] = {
	    {"bridge", BRIDGE}, {"vlan", VLAN}, {"bond", LAG}, {"tun", TUNNEL}, {"wireguard", TUNNEL}};

	out->connector = false;
	for (size_t i = 0; i < sizeof(types) / sizeof(types[0]); i++)
		if (strcmp(kind, types[i].kind) == 0)
			out->type = types[i].type;
}

static void take_link_info(struct snmp_interface *out, const uint8_t *at, size_t left)
{
	struct rtattr header;
	const uint8_t *octets;
	size_t size;

	while ((octets = take_attribute(&at, &left, &header, &size)) != NULL) {
		char kind[SNMP_IF_NAME_SIZE];

		if (header.rta_type != IFLA_INFO_KIND)
			continue;
		copy_text(kind, sizeof(kind), octets, size);
		take_kind(out, kind);
	}
}

/* Packets of several addresses are among all that came. Of those that go Linux knows no more than how many. */
static void take_traffic(uint64_t out[SNMP_TRAFFIC], const uint8_t *octets, size_t size)
{
	struct rtnl_link_stats64 stats = {0};

	memcpy(&stats, octets, size < sizeof(stats) ? size : sizeof(stats));
	out[SNMP_IN_OCTETS] = stats.rx_bytes;
	out[SNMP_IN_PACKETS] = stats.rx_packets > stats.multicast ? stats.rx_packets - stats.multicast : 0;
	out[SNMP_IN_MULTICAST] = stats.multicast;
	out[SNMP_IN_DISCARDS] = stats.rx_dropped;
	out[SNMP_IN_ERRORS] = stats.rx_errors;
	out[SNMP_OUT_OCTETS] = stats.tx_bytes;
	out[SNMP_OUT_PACKETS] = stats.tx_packets;
	out[SNMP_OUT_DISCARDS] = stats.tx_dropped;
	out[SNMP_OUT_ERRORS] = stats.tx_errors;
}

/* RFC 2863, 3.1.13. A driver that sets no state, as that of the loopback, has none but IFF_RUNNING. */
static uint8_t link_of(uint8_t state, unsigned flags)
{
	switch ((flags & IFF_UP) == 0 ? IF_OPER_DOWN : state) {
	case IF_OPER_UP:
		return SNMP_LINK_UP;
	case IF_OPER_NOTPRESENT:
		return SNMP_LINK_NOT_PRESENT;
	case IF_OPER_LOWERLAYERDOWN:
		return SNMP_LINK_LOWER_DOWN;
	case IF_OPER_TESTING:
		return SNMP_LINK_TESTING;
	case IF_OPER_DORMANT:
		return SNMP_LINK_DORMANT;
	case IF_OPER_UNKNOWN:
		return (flags & IFF_RUNNING) != 0 ? SNMP_LINK_UP : SNMP_LINK_DOWN;
	default:
		return SNMP_LINK_DOWN;
	}
}

static void take_of_link(struct snmp_interface *out, unsigned flags, uint16_t type, const uint8_t *octets,
			 size_t size)
{
	switch (type) {
	case IFLA_IFNAME:
		copy_text(out->name, sizeof(out->name), octets, size);
		break;
	case IFLA_IFALIAS:
		copy_text(out->alias, sizeof(out->alias), octets, size);
		break;
	case IFLA_MTU:
		memcpy(&out->mtu, octets, size < sizeof(out->mtu) ? size : sizeof(out->mtu));
		break;
	case IFLA_ADDRESS:
		out->address_size = (uint8_t)(size < sizeof(out->address) ? size : sizeof(out->address));
		memcpy(out->address, octets, out->address_size);
		break;
	case IFLA_OPERSTATE:
		out->link = link_of(size > 0 ? octets[0] : IF_OPER_UNKNOWN, flags);
		break;
	case IFLA_STATS64:
		take_traffic(out->traffic, octets, size);
		break;
	case IFLA_LINKINFO:
		take_link_info(out, octets, size);
		break;
	default:
		break;
	}
}

/* Mbit/s, 0: it has none, or does not know. */
static uint32_t speed_of(const char *name)
{
	struct ethtool_cmd command = {.cmd = ETHTOOL_GSET};
	struct ifreq request = {.ifr_data = (void *)&command};
	uint32_t speed;

	memcpy(request.ifr_name, name, SNMP_IF_NAME_SIZE);
	if (ioctl(any_socket, SIOCETHTOOL, &request) < 0)
		return 0;
	speed = ethtool_cmd_speed(&command);
	return speed == (uint32_t)SPEED_UNKNOWN ? 0 : speed;
}

/* What a bridge says of its ports has another family. */
static void take_link(struct snmp_agent *agent, uint16_t type, const uint8_t *at, size_t left)
{
	struct snmp_interface interface = {.link = SNMP_LINK_UNKNOWN};
	struct ifinfomsg link;
	struct rtattr header;
	const uint8_t *octets;
	size_t size;

	if (left < sizeof(link))
		return;
	memcpy(&link, at, sizeof(link));
	if (link.ifi_family != AF_UNSPEC || (type != RTM_NEWLINK && type != RTM_DELLINK))
		return;
	if (type == RTM_DELLINK) {
		snmp_interface_gone(agent, (uint32_t)link.ifi_index);
		return;
	}
	interface.kernel = (uint32_t)link.ifi_index;
	interface.type = type_of_hardware(link.ifi_type);
	interface.enabled = (link.ifi_flags & IFF_UP) != 0;
	interface.promiscuous = (link.ifi_flags & IFF_PROMISC) != 0;
	interface.connector = interface.type == ETHERNET;
	at += sizeof(link);
	left -= sizeof(link);
	while ((octets = take_attribute(&at, &left, &header, &size)) != NULL)
		take_of_link(&interface, link.ifi_flags, header.rta_type & NLA_TYPE_MASK, octets, size);
	if (interface.link == SNMP_LINK_UP)
		interface.speed = speed_of(interface.name);
	if (interface.type == LOOPBACK)
		interface.address_size = 0; /* the kernel's zeros are none (RFC 2863, ifPhysAddress) */
	if (interface.name[0] != '\0')
		snmp_interface_is(agent, &interface);
}

/* ---- all links --------------------------------------------------------------------------- */

/* What ends a list of links. */
enum ending { NOT_YET, ENDED, ENDED_TORN };

static enum ending take_messages(struct snmp_agent *agent, const uint8_t *at, size_t left, uint32_t list)
{
	struct nlmsghdr header;
	const uint8_t *octets;
	size_t size;

	while ((octets = take(&at, &left, &header, sizeof(header), length_of_message, &size)) != NULL) {
		if (header.nlmsg_seq == list && header.nlmsg_type == NLMSG_ERROR)
			return ENDED_TORN;
		if (header.nlmsg_seq == list && header.nlmsg_type == NLMSG_DONE)
			return (header.nlmsg_flags & NLM_F_DUMP_INTR) != 0 ? ENDED_TORN : ENDED;
		take_link(agent, header.nlmsg_type, octets, size);
	}
	return NOT_YET;
}

/* Of the kernel alone. 0: there is none, -1: some were lost. */
static ssize_t receive(uint8_t *octets, size_t room)
{
	struct sockaddr_nl from;
	socklen_t from_size;
	ssize_t size;

	do {
		from_size = sizeof(from);
		size = recvfrom(links, octets, room, 0, (struct sockaddr *)&from, &from_size);
	} while (size > 0 && from.nl_pid != 0);
	if (size < 0)
		return errno == ENOBUFS ? -1 : 0;
	return size;
}

static _Alignas(struct nlmsghdr) uint8_t heard[16384];

#define AT_ONCE 64 /* messages of a turn */

void kernel_hear(struct snmp_agent *agent)
{
	ssize_t size;

	for (unsigned i = 0; links >= 0 && i < AT_ONCE; i++) {
		size = receive(heard, sizeof(heard));
		if (size == 0)
			return;
		if (size > 0)
			take_messages(agent, heard, (size_t)size, 0);
	}
}

/* The kernel writes the next part of a list when one was read: it never has to be waited for. */
static void look_at_links(struct snmp_agent *agent)
{
	static uint32_t list;
	struct {
		struct nlmsghdr header;
		struct ifinfomsg link;
	} request = {.header = {.nlmsg_len = sizeof(request),
				.nlmsg_type = RTM_GETLINK,
				.nlmsg_flags = NLM_F_REQUEST | NLM_F_DUMP,
				.nlmsg_seq = ++list}};
	enum ending ending = NOT_YET;
	ssize_t size;

	if (links < 0 ||
	    sendto(links, &request, sizeof(request), 0, NULL, 0) < 0) /* send is another call on ARM */
		return;
	snmp_interfaces_before(agent);
	while (ending == NOT_YET && (size = receive(heard, sizeof(heard))) != 0)
		if (size > 0)
			ending = take_messages(agent, heard, (size_t)size, list);
	if (ending == ENDED)
		snmp_interfaces_after(agent);
}

/* ---- memory and file systems ------------------------------------------------------------- */

static uint64_t kilobytes(const char *text, const char *name)
{
	const char *at = strstr(text, name);

	return at == NULL ? 0 : strtoull(at + strlen(name), NULL, 10);
}

/* Used is what a program could not get. */
static void look_at_memory(struct snmp_agent *agent)
{
	char text[2048];
	const ssize_t size = pread(memory, text, sizeof(text) - 1, 0);
	struct snmp_storage ram = {.type = SNMP_STORAGE_RAM, .name = "Physical memory", .unit = 1024},
			    swap = {.type = SNMP_STORAGE_VIRTUAL, .name = "Swap space", .unit = 1024};

	if (size <= 0)
		return;
	text[size] = '\0';
	ram.size = kilobytes(text, "MemTotal:");
	ram.used = ram.size - kilobytes(text, "MemAvailable:");
	swap.size = kilobytes(text, "SwapTotal:");
	swap.used = swap.size - kilobytes(text, "SwapFree:");
	agent->machine.memory_kb = ram.size;
	snmp_storage_is(agent, &ram);
	if (swap.size > 0)
		snmp_storage_is(agent, &swap);
}

/* Those of this machine that can be full: one that is read only always is, and one of a network can hang. 0: another. */
static uint8_t type_of_file_system(const char *name)
{
	static const struct {
		const char *name;
		uint8_t type;
	} types[] = {
	    {"ubifs", SNMP_STORAGE_FLASH}, {"jffs2", SNMP_STORAGE_FLASH},  {"f2fs", SNMP_STORAGE_FLASH},
	    {"ext2", SNMP_STORAGE_DISK},   {"ext3", SNMP_STORAGE_DISK},    {"ext4", SNMP_STORAGE_DISK},
	    {"xfs", SNMP_STORAGE_DISK},    {"btrfs", SNMP_STORAGE_DISK},   {"vfat", SNMP_STORAGE_DISK},
	    {"exfat", SNMP_STORAGE_DISK},  {"overlay", SNMP_STORAGE_DISK}, {"tmpfs", SNMP_STORAGE_RAM_DISK},
	};

	for (size_t i = 0; i < sizeof(types) / sizeof(types[0]); i++)
		if (strcmp(name, types[i].name) == 0)
			return types[i].type;
	return 0;
}

/* A blank is \040 (proc(5)). */
static void unescape(char *text)
{
	char *out = text;

	for (; *text != '\0'; text++, out++) {
		unsigned octet;

		if (*text == '\\' && sscanf(text, "\\%3o", &octet) == 1) {
			*out = (char)octet;
			text += 3;
		} else {
			*out = *text;
		}
	}
	*out = '\0';
}

struct seen {
	fsid_t systems[SNMP_MOUNTS_MAX];
	uint32_t count;
};

/* One that is mounted in several places is told of the first. Some have no number. */
static bool is_seen(struct seen *seen, const fsid_t *system)
{
	static const fsid_t none;

	if (memcmp(system, &none, sizeof(none)) == 0)
		return false;
	for (uint32_t i = 0; i < seen->count; i++)
		if (memcmp(&seen->systems[i], system, sizeof(*system)) == 0)
			return true;
	if (seen->count < SNMP_MOUNTS_MAX)
		seen->systems[seen->count++] = *system;
	return false;
}

/* "/dev/ubi0_1 /data ubifs rw,noatime 0 0" */
static void take_mount(struct snmp_agent *agent, struct seen *seen, char *line)
{
	const char *device = strsep(&line, " ");
	char *path = strsep(&line, " ");
	const char *type = strsep(&line, " ");
	struct snmp_storage storage = {0};
	struct statfs status;

	if (device == NULL || path == NULL || type == NULL)
		return;
	storage.type = type_of_file_system(type);
	unescape(path);
	if (storage.type == 0 || strlen(path) >= sizeof(storage.name) || statfs(path, &status) < 0 ||
	    status.f_blocks == 0 || is_seen(seen, &status.f_fsid))
		return;
	strcpy(storage.name, path);
	storage.unit = (uint64_t)(status.f_frsize > 0 ? status.f_frsize : status.f_bsize);
	storage.size = status.f_blocks;
	storage.used = status.f_blocks - status.f_bfree;
	snmp_storage_is(agent, &storage);
}

/* Returns how much of an unfinished line is left, at the beginning. */
static size_t take_mounts(struct snmp_agent *agent, struct seen *seen, char *text)
{
	char *line = text, *end;

	while ((end = strchr(line, '\n')) != NULL) {
		*end = '\0';
		take_mount(agent, seen, line);
		line = end + 1;
	}
	memmove(text, line, strlen(line) + 1);
	return strlen(text);
}

/* A line that is longer than this is none of ours, and neither are its pieces. */
static void look_at_mounts(struct snmp_agent *agent)
{
	static char text[4096];
	struct seen seen = {.count = 0};
	size_t kept = 0;
	off_t at = 0;
	ssize_t size;

	while ((size = pread(mounts, text + kept, sizeof(text) - 1 - kept, at)) > 0) {
		at += size;
		text[kept + (size_t)size] = '\0';
		kept = take_mounts(agent, &seen, text);
		if (kept == sizeof(text) - 1)
			kept = 0;
	}
}

/* ---- all --------------------------------------------------------------------------------- */

#define FRESH_NS NS_PER_S

static int64_t since_start_ns(void)
{
	struct timespec time;

	clock_gettime(CLOCK_BOOTTIME, &time);
	return time.tv_sec * NS_PER_S + time.tv_nsec;
}

void kernel_look(struct snmp_agent *agent)
{
	static int64_t looked_ns;

	kernel_hear(agent);
	if (looked_ns == 0 || agent->now_ns - looked_ns >= FRESH_NS) {
		looked_ns = agent->now_ns;
		look_at_links(agent);
		snmp_storages_before(agent);
		look_at_memory(agent);
		look_at_mounts(agent);
		snmp_storages_after(agent);
	}
	agent->machine.up_ns = since_start_ns();
}

/* From before the first list on, so that nothing is missed between. */
static int open_links(void)
{
	const struct sockaddr_nl all = {.nl_family = AF_NETLINK, .nl_groups = RTMGRP_LINK};
	const int fd = socket(AF_NETLINK, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, NETLINK_ROUTE);

	if (fd >= 0 && bind(fd, (const struct sockaddr *)&all, sizeof(all)) < 0) {
		close(fd);
		return -1;
	}
	return fd;
}

static int said(struct snmp_agent *agent, int fd, const char *what)
{
	if (fd < 0)
		map_log(agent->map, MAP_LOG_WARNING, "managers are not told of %s: %s", what,
			strerror(errno));
	return fd;
}

void kernel_begin(struct snmp_agent *agent)
{
	links = said(agent, open_links(), "interfaces");
	any_socket = said(agent, socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0), "speeds");
	memory = said(agent, open("/proc/meminfo", O_RDONLY | O_CLOEXEC), "memory");
	mounts = said(agent, open("/proc/self/mounts", O_RDONLY | O_CLOEXEC), "file systems");
	kernel_look(agent);
}

int kernel_fd(void)
{
	return links;
}
