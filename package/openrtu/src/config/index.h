/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Which point has a name, or an information object address in its set: found in a few steps, however many points there are. */
#ifndef OPENRTU_CONFIG_INDEX_H
#define OPENRTU_CONFIG_INDEX_H

#include "map/config.h"

/* Begins with zeros. */
struct config_index {
	uint32_t *by_name, *by_ioa; /* points, and one more, each at its hash or behind; 0: free */
	uint32_t size;              /* of each, a power of two */
	uint32_t count;             /* so many points of the configuration are in it */
};

/*
 * Takes in the points that the configuration has got since. False: out of memory. The points that are there do not change any
 * more, but for their places among all.
 */
bool config_index_renew(struct config_index *index, const struct map_config *config);
/* UINT32_MAX: none. */
uint32_t config_index_name(const struct config_index *index, const struct map_config *config,
			   const char *name);
uint32_t config_index_ioa(const struct config_index *index, const struct map_config *config, uint32_t set,
			  uint32_t ioa);
void config_index_free(struct config_index *index);

#endif
