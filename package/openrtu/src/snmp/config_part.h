/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_SNMP_CONFIG_PART_H
#define OPENRTU_SNMP_CONFIG_PART_H

#include "config/part.h"

/* "snmp": an object; without it there is no agent. */
extern const struct config_part snmp_part;

#endif
