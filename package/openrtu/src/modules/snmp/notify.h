/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Events as notifications, to each sink from a socket of its own. */
#ifndef OPENRTU_MODULES_SNMP_NOTIFY_H
#define OPENRTU_MODULES_SNMP_NOTIFY_H

#include "modules/snmp/wire.h"

/* Opens the sinks' sockets. False with errno: it cannot. */
bool notify_begin(struct snmp_agent *agent, const struct snmp_keyring *ring);
/* Sends what is due and takes what was answered. True: something waits. */
bool notify_run(struct snmp_agent *agent);
int notify_fd(uint32_t sink);

#endif
