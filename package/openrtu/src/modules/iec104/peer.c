/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/iec104/peer.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>

#include "map/address.h"

/* An IPv4 peer of an IPv6 socket is seen as a mapped address; here both are the same. */
static void map_to_ipv6(const struct sockaddr_storage *address, struct in6_addr *out)
{
	if (address->ss_family == AF_INET6) {
		memcpy(out, &((const struct sockaddr_in6 *)address)->sin6_addr, sizeof(*out));
		return;
	}
	memset(out, 0, sizeof(*out));
	out->s6_addr[10] = out->s6_addr[11] = 0xff;
	memcpy(&out->s6_addr[12], &((const struct sockaddr_in *)address)->sin_addr, sizeof(struct in_addr));
}

/* Where an address is in a list; count: nowhere. */
static uint32_t place_in(const char (*list)[MAP_ADDRESS_SIZE], uint32_t count, const struct in6_addr *address)
{
	struct in6_addr listed;

	for (uint32_t i = 0; i < count; i++)
		if (map_address_parse(list[i], &listed) && memcmp(address, &listed, sizeof(listed)) == 0)
			return i;
	return count;
}

static bool is_among(const struct in6_addr *address, const char (*list)[MAP_ADDRESS_SIZE], uint32_t count)
{
	return place_in(list, count, address) < count;
}

static bool may_set_clock(const struct iec104_settings *settings, const struct in6_addr *address)
{
	return settings->clock_master_count == 0 ||
	       is_among(address, settings->clock_masters, settings->clock_master_count);
}

/* As struct iec104_peer has it. */
static uint32_t party_of(const struct map_config *config, const struct in6_addr *address)
{
	const struct iec104_settings *settings = iec104_settings(config);
	const uint32_t groups = config->settings.queue_count;
	uint32_t master = place_in(settings->masters, settings->master_count, address);

	for (uint32_t i = 0; i < groups; i++)
		if (is_among(address, settings->groups[i].masters, settings->groups[i].master_count))
			return i;
	return master < settings->master_count ? groups + master : MAP_NONE;
}

static void write_address(const struct in6_addr *address, char text[MAP_ADDRESS_SIZE])
{
	if (IN6_IS_ADDR_V4MAPPED(address))
		inet_ntop(AF_INET, &address->s6_addr[12], text, MAP_ADDRESS_SIZE);
	else
		inet_ntop(AF_INET6, address, text, MAP_ADDRESS_SIZE);
}

static bool look_up(const struct in6_addr *address, const struct map_config *config, struct iec104_peer *out)
{
	const struct iec104_settings *settings = iec104_settings(config);

	out->party = party_of(config, address);
	out->clock_master = may_set_clock(settings, address);
	return settings->master_count == 0 || is_among(address, settings->masters, settings->master_count);
}

bool peer_look_again(const struct map_config *config, struct iec104_peer *peer)
{
	struct in6_addr address;

	return map_address_parse(peer->address, &address) && look_up(&address, config, peer);
}

bool peer_identify(const struct sockaddr_storage *from, const struct map_config *config,
		   struct iec104_peer *out)
{
	/* the port has the same place in both families */
	unsigned port = ntohs(((const struct sockaddr_in *)from)->sin_port);
	struct in6_addr address;

	map_to_ipv6(from, &address);
	write_address(&address, out->address);
	snprintf(out->name, sizeof(out->name), "%s port %u", out->address, port);
	return look_up(&address, config, out);
}
