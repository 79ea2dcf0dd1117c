/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The addresses that the configuration names, and those of peers, as an IPv6 socket sees both. */
#ifndef OPENRTU_MAP_ADDRESS_H
#define OPENRTU_MAP_ADDRESS_H

#include <arpa/inet.h>
#include <stdbool.h>
#include <string.h>

#include "map/config.h"

/* Reads an IPv6 address, or an IPv4 one as an IPv6 socket sees it. False: it is none. */
static inline bool map_address_parse(const char *text, struct in6_addr *out)
{
	if (inet_pton(AF_INET6, text, out) == 1)
		return true;
	memset(out, 0, sizeof(*out));
	out->s6_addr[10] = out->s6_addr[11] = 0xff;
	return inet_pton(AF_INET, text, &out->s6_addr[12]) == 1;
}

/* A peer's, of either family. */
static inline struct in6_addr map_address_of(const struct sockaddr_storage *from)
{
	struct in6_addr address = {.s6_addr[10] = 0xff, .s6_addr[11] = 0xff};

	if (from->ss_family == AF_INET6)
		memcpy(&address, &((const struct sockaddr_in6 *)from)->sin6_addr, sizeof(address));
	else
		memcpy(&address.s6_addr[12], &((const struct sockaddr_in *)from)->sin_addr,
		       sizeof(struct in_addr));
	return address;
}

/* As people write it. */
static inline void map_address_text(const struct in6_addr *address, char text[MAP_ADDRESS_SIZE])
{
	if (IN6_IS_ADDR_V4MAPPED(address))
		inet_ntop(AF_INET, &address->s6_addr[12], text, MAP_ADDRESS_SIZE);
	else
		inet_ntop(AF_INET6, address, text, MAP_ADDRESS_SIZE);
}

/* Where an address is in a list; count: nowhere. */
static inline uint32_t map_address_place(const char (*list)[MAP_ADDRESS_SIZE], uint32_t count,
					 const struct in6_addr *address)
{
	struct in6_addr listed;

	for (uint32_t i = 0; i < count; i++)
		if (map_address_parse(list[i], &listed) && memcmp(address, &listed, sizeof(listed)) == 0)
			return i;
	return count;
}

#endif
