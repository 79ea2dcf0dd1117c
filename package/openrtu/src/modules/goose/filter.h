/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the kernel lets through to rtu-goose: rtud sets it, and rtu-goose narrows it in a flood. */
#ifndef OPENRTU_MODULES_GOOSE_FILTER_H
#define OPENRTU_MODULES_GOOSE_FILTER_H

#include "goose/config.h"

#define GOOSE_APP_ID_AT 14 /* the kernel has taken a VLAN's tag away */

_Static_assert(GOOSE_SUBSCRIBED_MAX <= 32, "a bit for each subscription");

/*
 * The messages of all APPIDs with a subscription, but of those whose bit is set in silenced: a storm of them does not reach the process.
 * Negative: errno.
 */
int goose_filter(int fd, const struct map_config *config, uint32_t silenced);

#endif
