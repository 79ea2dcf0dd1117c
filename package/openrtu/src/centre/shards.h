/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Several processes of one kind, for the cores of a machine: each has a part of the work, and shares nothing with the others. */
#ifndef OPENRTU_CENTRE_SHARDS_H
#define OPENRTU_CENTRE_SHARDS_H

#include <stdatomic.h>
#include <stdint.h>

#include "centre/config.h"

#define CENTRE_SHARD_LOOKS                                                                                   \
	10 /* of the keeper, a second apart: a shard that has made no turn between them hangs */

/* The work of a shard, in its process. turns: counts those of its loop. An exit code. */
typedef int centre_shard(void *context, uint32_t shard, atomic_uint *turns);

/*
 * Calls run in a process for each shard. One that a signal ends begins again, at most once a second; one that hangs is ended
 * so; one that ends by itself has said why, and ends them all. Until SIGTERM or SIGINT: all are told, and waited for; who
 * hangs then is ended, too. An exit code.
 */
int centre_shards_keep(uint32_t count, centre_shard *run, void *context);

#endif
