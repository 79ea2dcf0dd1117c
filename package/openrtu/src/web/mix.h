/* SPDX-License-Identifier: GPL-3.0-or-later */
/* FNV-1a in 64 bits: a key for what is counted, or was used, by name and address. */
#ifndef OPENRTU_WEB_MIX_H
#define OPENRTU_WEB_MIX_H

#include <stddef.h>
#include <stdint.h>

#define WEB_MIX_BEGIN UINT64_C(0xcbf29ce484222325)

static inline uint64_t web_mix(uint64_t key, const void *octets, size_t size)
{
	const uint8_t *octet = octets;

	for (size_t i = 0; i < size; i++)
		key = (key ^ octet[i]) * UINT64_C(0x100000001b3);
	return key;
}

#endif
