/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The addresses that the configuration names, as numbers. */
#ifndef OPENRTU_MAP_ADDRESS_H
#define OPENRTU_MAP_ADDRESS_H

#include <arpa/inet.h>
#include <stdbool.h>
#include <string.h>

/* Reads an IPv6 address, or an IPv4 one as an IPv6 socket sees it. False: it is none. */
static inline bool map_address_parse(const char *text, struct in6_addr *out)
{
	if (inet_pton(AF_INET6, text, out) == 1)
		return true;
	memset(out, 0, sizeof(*out));
	out->s6_addr[10] = out->s6_addr[11] = 0xff;
	return inet_pton(AF_INET, text, &out->s6_addr[12]) == 1;
}

#endif
