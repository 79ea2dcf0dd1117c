/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/iec104/peer.h"

#include <netinet/in.h>
#include <stdio.h>
#include <string.h>

#include "map/address.h"

static bool is_among(const struct in6_addr *address, const char (*list)[MAP_ADDRESS_SIZE], uint32_t count)
{
	return map_address_place(list, count, address) < count;
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
	uint32_t master = map_address_place(settings->masters, settings->master_count, address);

	for (uint32_t i = 0; i < groups; i++)
		if (is_among(address, settings->groups[i].masters, settings->groups[i].master_count))
			return i;
	return master < settings->master_count ? groups + master : MAP_NONE;
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
	const struct in6_addr address = map_address_of(from);

	map_address_text(&address, out->address);
	snprintf(out->name, sizeof(out->name), "%s port %u", out->address, port);
	return look_up(&address, config, out);
}
