/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What the kernel says of the machine: of interfaces by netlink, of memory and file systems by two files of /proc that are open
 * before the module is confined.
 */
#ifndef OPENRTU_MODULES_SNMP_KERNEL_H
#define OPENRTU_MODULES_SNMP_KERNEL_H

#include "snmp/agent.h"

/* Opens both, and looks for the first time. What cannot be opened is not told, and the log says so. */
void kernel_begin(struct snmp_agent *agent);
/* Becomes readable when an interface comes, goes or changes. -1: nobody says. */
int kernel_fd(void);
/* Takes what has been said of interfaces. */
void kernel_hear(struct snmp_agent *agent);
/* Before an answer: takes the same, and looks at all, but no more than once a second. */
void kernel_look(struct snmp_agent *agent);

#endif
