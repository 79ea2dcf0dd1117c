/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Each timer's periodic interrupts, counted against TIMER5, and a one-shot. */
#include "board.h"

#define PERIOD 1000 /* microseconds */
#define COUNT  50

static volatile uint32_t interrupts, first, last;
static unsigned timer;

static void tick(void)
{
	ETIMER_ISR(timer) = 1;
	last = microseconds();
	if (!interrupts++)
		first = last;
}

static void periodic(void)
{
	interrupts = 0;
	etimer_start(timer, ETIMER_PERIODIC, PERIOD);
	while (interrupts < COUNT)
		;
	ETIMER_CTL(timer) = 0;
	say("timer %u: %u interrupts in %u us\n", timer, interrupts - 1, (last - first) & 0xffffff);
}

static void one_shot(void)
{
	const uint32_t start = microseconds();

	interrupts = 0;
	etimer_start(timer, ETIMER_ONE_SHOT, PERIOD);
	wait(5 * PERIOD);
	say("timer %u: %u one-shot after %u us, then off %x at %u\n", timer, interrupts,
	    (first - start) & 0xffffff, ETIMER_CTL(timer) & 1, ETIMER_DR(timer));
}

void probe(void)
{
	interrupts_on();
	for (timer = 0; timer < 5; timer++) {
		irq_handle(IRQ_ETIMER(timer), tick);
		periodic();
		one_shot();
	}
}
