/* SPDX-License-Identifier: GPL-3.0-or-later */
/* QEMU's machine virt: a PL011, a PL031 that counts seconds, and power control by PSCI. */
#include "kernel.h"

#define REG(address) (*(volatile uint32_t *)(uintptr_t)(address))
#define PL011_DR     REG(0x09000000)
#define PL011_FR     REG(0x09000018)
#define FR_TX_FULL   0x20
#define PL031_DR     REG(0x09010000)

void open_console(void)
{
}

void close_console(void)
{
}

void put(char character)
{
	while (PL011_FR & FR_TX_FULL)
		;
	PL011_DR = (uint8_t)character;
}

void wait_seconds(uint32_t seconds)
{
	const uint32_t start = PL031_DR;

	while (PL031_DR - start < seconds)
		;
}

void restart(void)
{
	const uint32_t system_reset = 0x84000009;

	__asm__ volatile(".arch armv7ve\n\tmov r0, %0\n\thvc #0" : : "r"(system_reset) : "r0");
}
