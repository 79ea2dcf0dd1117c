/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The dog is fed for a while, then not: it bites, and the probe finds itself at its beginning with the dog's mark. */
#include "board.h"

#define TIME_OUT_31MS 3u /* 2^10 of 32768 Hz; the reset comes 1026 later */

static volatile uint32_t warned;

static void warn(void)
{
	unlock();
	WDT_CTL = WDT_CTL & ~WDT_RSTF; /* the interrupt's flag clears by a one */
	warned = microseconds();
}

void probe(void)
{
	say("up, dog's mark %u\n", WDT_CTL / WDT_RSTF & 1);
	say("cause %x\n", SYS_RSTSTS);
	if (WDT_CTL & WDT_RSTF) {
		unlock();
		WDT_CTL = WDT_RSTF;
		say("cleared: %u\n", WDT_CTL / WDT_RSTF & 1);
		return;
	}
	WDT_CTL = 0xffffffff;
	say("locked: %x\n", WDT_CTL & WDT_WDTEN);
	irq_handle(IRQ_WDT, warn);
	interrupts_on();
	CLK_DIV8 |= 0x300;
	unlock();
	WDT_CTL = WDT_TOUT(TIME_OUT_31MS) | WDT_WDTEN | WDT_RSTEN | WDT_INTEN;
	for (unsigned meals = 0; meals < 4; meals++) {
		wait(25000);
		WDT_RSTCNT = WDT_KEY;
	}
	say("fed, warned %u\n", warned);
	const uint32_t start = microseconds();

	while (!warned)
		;
	say("warned after %u us\n", (warned - start) & 0xffffff);
	for (;;)
		;
}
