/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A point's quality as a bit string (IEC 61850-7-3, 6.2; its places: IEC 61850-8-1, table 32). */
#ifndef OPENRTU_QUALITY_QUALITY_H
#define OPENRTU_QUALITY_QUALITY_H

#include <stdint.h>

#define QUALITY_BITS 13

/* The first bit in the most significant place of 16. */
enum quality_bits {
	QUALITY_INVALID = 0x4000,
	QUALITY_QUESTIONABLE = 0xc000,
	QUALITY_VALIDITY = 0xc000,
	QUALITY_OVERFLOW = 0x2000,
	QUALITY_FAILURE = 0x0200,
	QUALITY_OLD_DATA = 0x0100,
	QUALITY_SUBSTITUTED = 0x0020,
	QUALITY_TEST = 0x0010,
	QUALITY_OPERATOR_BLOCKED = 0x0008,
};

/* Of enum map_quality. */
uint16_t quality_of_map(uint8_t quality);

#endif
