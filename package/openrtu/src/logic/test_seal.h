/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Makes a program's CRC right, so that a test gets behind it. */
#ifndef OPENRTU_LOGIC_TEST_SEAL_H
#define OPENRTU_LOGIC_TEST_SEAL_H

#include <stddef.h>
#include <stdint.h>

#include "logic/format.h"

static void seal(void *file, size_t size)
{
	const uint8_t *octets = (const uint8_t *)file;
	uint32_t crc = UINT32_MAX;

	for (size_t i = 16; i < size; i++) {
		crc ^= octets[i];
		for (int bit = 0; bit < 8; bit++)
			crc = crc >> 1 ^ (crc & 1 ? 0xedb88320 : 0);
	}
	((struct logic_head *)file)->crc = ~crc;
}

#endif
