/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The interrupt controller: order of levels, masks, an interrupt inside another, the fast interrupt. */
#include "board.h"

#define LATE 3000 /* microseconds: later than anything here takes */

static volatile unsigned order[8], served;

static void note(unsigned timer)
{
	ETIMER_ISR(timer) = 1;
	order[served++] = timer;
}

static void timer0(void)
{
	note(0);
}

static void timer1(void)
{
	note(1);
}

static void timer2(void)
{
	note(2);
}

static void show(const char *what)
{
	say("%s:", what);
	for (unsigned i = 0; i < served; i++)
		say(" %u", order[i]);
	say("\n");
	served = 0;
}

static void expire(unsigned timer)
{
	etimer_start(timer, ETIMER_ONE_SHOT, 50);
	wait(100);
}

static void levels(unsigned first, unsigned second, unsigned third)
{
	irq_level(IRQ_ETIMER(first), 1);
	irq_level(IRQ_ETIMER(second), 4);
	irq_level(IRQ_ETIMER(third), 7);
	for (unsigned timer = 0; timer < 3; timer++)
		expire(timer);
	say("first of %u%u%u: %u\n", first, second, third, AIC_IRQNUM);
	AIC_EOIS = 1;
	interrupts_on();
	wait(100);
	interrupts_off();
	show("served");
}

static void mask(void)
{
	irq_mask(IRQ_ETIMER(1));
	expire(0);
	expire(1);
	say("raw while masked: %u\n", AIC_RAWSTS(IRQ_ETIMER(1)) >> IRQ_ETIMER(1) & 1);
	interrupts_on();
	wait(100);
	show("masked 1");
	irq_unmask(IRQ_ETIMER(1));
	wait(100);
	interrupts_off();
	show("unmasked 1");
}

/* The last in rank lets others in while it is served. */
static void timer2_slow(void)
{
	note(2);
	etimer_start(1, ETIMER_ONE_SHOT, 50);
	interrupts_on();
	wait(LATE);
	interrupts_off();
	order[served++] = 9;
}

static void nested(void)
{
	irq_level(IRQ_ETIMER(1), 1);
	irq_level(IRQ_ETIMER(2), 7);
	irq_handle(IRQ_ETIMER(2), timer2_slow);
	interrupts_on();
	etimer_start(2, ETIMER_ONE_SHOT, 50);
	wait(2 * LATE);
	interrupts_off();
	show("nested");
}

/* A FIQ comes while an IRQ is served that lets nothing in. */
static void timer2_closed(void)
{
	note(2);
	etimer_start(3, ETIMER_ONE_SHOT, 50);
	wait(LATE);
	order[served++] = 9;
}

static void timer3_fast(void)
{
	uint32_t cpsr;

	__asm__("mrs %0, cpsr" : "=r"(cpsr));
	note(3);
	order[served++] = cpsr & 0x1f;
}

static void fast(void)
{
	irq_level(IRQ_ETIMER(3), 0);
	irq_handle(IRQ_ETIMER(3), timer3_fast);
	irq_handle(IRQ_ETIMER(2), timer2_closed);
	interrupts_on();
	etimer_start(2, ETIMER_ONE_SHOT, 50);
	wait(2 * LATE);
	interrupts_off();
	show("fast");
}

void probe(void)
{
	irq_handle(IRQ_ETIMER(0), timer0);
	irq_handle(IRQ_ETIMER(1), timer1);
	irq_handle(IRQ_ETIMER(2), timer2);
	levels(0, 1, 2);
	levels(2, 0, 1);
	levels(1, 2, 0);
	mask();
	nested();
	fast();
	say("none left: %u\n", AIC_IRQNUM);
}
