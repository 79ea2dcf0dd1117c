/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Reads a word where none begins; ends by SIGBUS if the kernel minds. */
#include <stdint.h>
#include <stdio.h>

int main(void)
{
	static const uint8_t bytes[8] __attribute__((aligned(4))) = {1, 2, 3, 4, 5, 6, 7, 8};
	const uint32_t *volatile word = (const void *)(bytes + 1);

	printf("%x\n", (unsigned)*word);
	return 0;
}
