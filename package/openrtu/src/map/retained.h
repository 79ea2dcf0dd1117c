/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Values that are no points, which a module retains in its own section: they outlive its process there, and a power cut by
 * the journal, which knows them from here. What they mean is their module's.
 */
#ifndef OPENRTU_MAP_RETAINED_H
#define OPENRTU_MAP_RETAINED_H

#include "map/latch.h"
#include "map/map.h"

/* Names of the values that the journal keeps, in the configuration: a module's one behind the other. */
#define MAP_RETAINED MAP_SECTION_ID('R', 'T', 'N', 'D')

/* 64 bits that tell a value from all others, in a changed configuration too. */
struct map_retained_name {
	uint32_t low, high;
};

struct map_retained_value {
	uint32_t low, high;
	uint32_t quality; /* 0: there is none yet */
};
#define MAP_RETAINED_KNOWN 0x100u /* in a quality, beside its flags */

/* What is at the plan's place: two copies of all values, of which the latch says which one is whole. */
struct map_retained {
	map_latch latch;
	uint32_t reserved;
	struct map_retained_value values[];
};

/* Octets that it takes. */
static inline size_t map_retained_size(uint32_t values)
{
	return sizeof(struct map_retained) + 2 * values * sizeof(struct map_retained_value);
}

/* The copy that is whole; for its writer, behind a former one too. */
static inline struct map_retained_value *map_retained_whole(struct map_retained *retained, uint32_t values)
{
	return retained->values + latch_whole_copy(&retained->latch) * values;
}

/* The other one. When it is filled, latch_flip() makes it the whole one. */
static inline struct map_retained_value *map_retained_other(struct map_retained *retained, uint32_t values)
{
	return retained->values + !latch_whole_copy(&retained->latch) * values;
}

/* With its plan. NULL: the module has none, or the configuration has it no more. Read-only for others than the module. */
struct map_retained *map_retained(const struct map *map, uint32_t module,
				  const struct map_retained_plan **plan);
/* The module whose value has that name; MAP_NONE: none has. name: its place in MAP_RETAINED. */
uint32_t map_retained_owner(const struct map *map, uint32_t name);

#endif
