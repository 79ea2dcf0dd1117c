/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A point's quality as a bit string (IEC 61850-7-3, 6.2; its places: IEC 61850-8-1, table 32). */
#ifndef OPENRTU_BER_QUALITY_H
#define OPENRTU_BER_QUALITY_H

#include <stdint.h>

#define BER_QUALITY_BITS 13

/* The first bit in the most significant place of 16. */
enum ber_quality {
	BER_Q_INVALID = 0x4000,
	BER_Q_QUESTIONABLE = 0xc000,
	BER_Q_VALIDITY = 0xc000,
	BER_Q_OVERFLOW = 0x2000,
	BER_Q_FAILURE = 0x0200,
	BER_Q_OLD_DATA = 0x0100,
	BER_Q_SUBSTITUTED = 0x0020,
	BER_Q_TEST = 0x0010,
	BER_Q_OPERATOR_BLOCKED = 0x0008,
};

/* Of enum map_quality. */
uint16_t ber_quality_of(uint8_t quality);

#endif
