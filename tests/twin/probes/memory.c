/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How much SDRAM the controller says, and where memory really ends. */
#include "board.h"

#define MIB 0x100000u

void probe(void)
{
	uint32_t size = 16 * MIB; /* the probe itself lies below */

	say("controller %u MiB\n", 1u << (SDIC_SIZE0 & 7));
	for (; size < 256 * MIB; size *= 2) {
		volatile uint32_t *word = (volatile uint32_t *)size;

		*word = 0x55aa1234;
		if (*word != 0x55aa1234)
			break;
	}
	say("memory %u MiB\n", size / MIB);
}
