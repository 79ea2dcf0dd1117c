/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Requests to answers: GET, GETNEXT, GETBULK, SET (RFC 3416, 4.2). */
#ifndef OPENRTU_MODULES_SNMP_ANSWER_H
#define OPENRTU_MODULES_SNMP_ANSWER_H

#include "modules/snmp/wire.h"

/* A wire_handler; context is the agent. */
void answer_request(void *context, void *session, netsnmp_pdu *pdu);
/* Adds a varbind to the end of a list. False: no memory, or it would be longer than left, of which its octets are taken. */
bool answer_add(netsnmp_variable_list **end, const uint32_t *name, size_t length,
		const struct snmp_value *value, long *left);
/* Octets of a message of this user around its varbinds, at most. */
long answer_overhead(const struct snmp_agent *agent, size_t name_size);

#endif
