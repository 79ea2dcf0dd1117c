/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The board: UART0 is as U-Boot left it, but for its pins, which U-Boot gives back before it starts a kernel. What it
 * still had to send is lost by then: a kernel takes longer to its console.
 */
#include "kernel.h"
#include "nuc980.h"

#define XIN_HZ 12000000

static void wait_until_sent(void)
{
	while (!(UART_FSR(0) & FSR_TX_DONE))
		;
}

static void give_pins(uint32_t function)
{
	volatile uint32_t *pf8_to_pf15 = &SYS_MFP('F')[1];

	wait_until_sent();
	*pf8_to_pf15 = (*pf8_to_pf15 & ~0xff000u) | function << 12 | function << 16; /* PF11 and PF12 */
}

void open_console(void)
{
	give_pins(1); /* UART0 */
}

void close_console(void)
{
	give_pins(0); /* GPIO */
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
	wait_until_sent();
	do {
		SYS_REGWPCTL = 0x59;
		SYS_REGWPCTL = 0x16;
		SYS_REGWPCTL = 0x88;
	} while (!(SYS_REGWPCTL & 1));
	SYS_AHBIPRST = 1;
}
