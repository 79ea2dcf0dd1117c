/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libnetsnmp's side of the agent: sockets that rtud or main.c has opened, as its transports; the users of USM; its sessions. The
 * library decodes, authenticates and decrypts, and asks for nothing of its own: no file, no name, no socket.
 */
#ifndef OPENRTU_MODULES_SNMP_WIRE_H
#define OPENRTU_MODULES_SNMP_WIRE_H

#include <net-snmp/net-snmp-config.h>

#include <net-snmp/net-snmp-includes.h>

#include <net-snmp/library/snmp_transport.h>

#include "snmp/agent.h"
#include "snmp/keys.h"

/* Called with each request that is authentic, or none that needs to be. */
typedef void (*wire_handler)(void *context, void *session, netsnmp_pdu *pdu);

struct wire;

/* False: it cannot take all keys, and that has been logged. */
bool wire_init(struct snmp_agent *agent, const struct snmp_keyring *ring);
/* A session that answers on a socket. NULL: no memory. */
struct wire *wire_listen(struct snmp_agent *agent, int fd, wire_handler handler, void *context);
/* A session that notifies a sink from a socket. NULL: no memory. */
struct wire *wire_to_sink(struct snmp_agent *agent, const struct snmp_keyring *ring, uint32_t sink, int fd);
/* Takes what has come, at most so many messages. */
void wire_read(struct wire *wire, unsigned most);
/* Ends what waits for too long. */
void wire_expire(struct wire *wire);
/*
 * Forgets the boots and the time of a sink that was heard, and only what was not in its time: its next report says which they are. A
 * sink that has lost its boots is refused for ever otherwise (RFC 3414, 3.2, 7 b). False: nothing of it was refused.
 */
bool wire_discovers_anew(struct wire *wire);
void *wire_session(struct wire *wire);
/* What the library counts. */
uint32_t wire_statistic(enum snmp_statistic which);
int wire_fd(const struct wire *wire);

#endif
