/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A bucket for each address that sends, so that one that sends without end leaves time for the others. */
#ifndef OPENRTU_MODULES_SNMP_BUCKET_H
#define OPENRTU_MODULES_SNMP_BUCKET_H

#include <netinet/in.h>
#include <stdbool.h>
#include <stdint.h>

/* Whether a message of this address is one of its so many in a second. */
bool bucket_takes(const struct in6_addr *address, uint32_t rate, int64_t now_ns);

/*
 * Whether a message that is not authentic, as a discovery is, is one of the share that its address has of so many in a second: a flood of
 * them by many addresses leaves time for messages that are, and for everybody's discovery.
 */
bool bucket_discovers(const struct in6_addr *address, uint32_t rate, int64_t now_ns);

#endif
