/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Several processes of one kind, for the cores of a machine: each has a part of the work, and shares nothing with the others. */
#ifndef OPENRTU_CENTRE_SHARDS_H
#define OPENRTU_CENTRE_SHARDS_H

#include <stdint.h>

#include "centre/config.h"

/*
 * Calls run in a process for each shard. One that a signal ends begins again, at most once a second; one that ends by itself
 * has said why, and ends them all. Until SIGTERM or SIGINT: all are told, and waited for. An exit code.
 */
int centre_shards_keep(uint32_t count, int (*run)(void *context, uint32_t shard), void *context);

#endif
