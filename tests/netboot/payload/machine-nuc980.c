/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The board: UART0 is as U-Boot left it, but for its pins, which U-Boot gives back before it starts a kernel. */
#include "kernel.h"
#include "nuc980.h"

#define XIN_HZ 12000000

void open_console(void)
{
	volatile uint32_t *pf8_to_pf15 = &SYS_MFP('F')[1];

	*pf8_to_pf15 = (*pf8_to_pf15 & ~0xff000u) | 0x11000; /* PF11 and PF12: UART0 */
}

void put(char character)
{
	while (UART_FSR(0) & FSR_TX_FULL)
		;
	UART_DAT(0) = (uint8_t)character;
}

void wait_seconds(uint32_t seconds)
{
	CLK_PCLKEN0 = 0xffffffff;
	ETIMER_PRECNT(5) = XIN_HZ / 1000000 - 1;
	ETIMER_CMPR(5) = 0xffffff;
	ETIMER_CTL(5) = ETIMER_CONTINUOUS;
	while (seconds--) {
		const uint32_t start = ETIMER_DR(5);

		while (((ETIMER_DR(5) - start) & 0xffffff) < 1000000)
			;
	}
}

void restart(void)
{
	while (!(UART_FSR(0) & FSR_TX_DONE))
		;
	do {
		SYS_REGWPCTL = 0x59;
		SYS_REGWPCTL = 0x16;
		SYS_REGWPCTL = 0x88;
	} while (!(SYS_REGWPCTL & 1));
	SYS_AHBIPRST = 1;
}
