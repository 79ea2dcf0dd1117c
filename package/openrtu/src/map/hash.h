/* SPDX-License-Identifier: GPL-3.0-or-later */
/* FNV-1a in 32 bits, to tell apart what nobody forges. For all rooms. Words go in whole: the same on each machine. */
#ifndef OPENRTU_MAP_HASH_H
#define OPENRTU_MAP_HASH_H

#include <stddef.h>
#include <stdint.h>

#define MAP_HASH_BASIS 2166136261u

static inline uint32_t map_hash_word(uint32_t hash, uint32_t word)
{
	return (hash ^ word) * 16777619u;
}

static inline uint32_t map_hash_octets(uint32_t hash, const void *octets, size_t size)
{
	const uint8_t *octet = octets;

	for (size_t i = 0; i < size; i++)
		hash = map_hash_word(hash, octet[i]);
	return hash;
}

#endif
