/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Edges on pins of port B: 2 rises, 3 falls, 4 does both, 5 is not asked. The pins drive themselves. */
#include "board.h"

static volatile uint32_t interrupts, seen;

static void serve(void)
{
	const uint32_t source = GPIO_INTSRC('B');

	GPIO_INTSRC('B') = source;
	seen |= source;
	interrupts++;
}

static void drive(const char *what, uint32_t levels)
{
	GPIO_DOUT('B') = levels;
	wait(100);
	say("%s: pins %x, interrupts %u, source %x\n", what, GPIO_PIN('B') & 0x3c, interrupts, seen);
	interrupts = seen = 0;
}

void probe(void)
{
	GPIO_DOUT('B') = 0;
	GPIO_MODE('B') = 0x550; /* pins 2..5 are outputs */
	GPIO_INTSRC('B') = 0xffff;
	GPIO_INTEN('B') = (BIT(2) | BIT(4)) << 16 | BIT(3) | BIT(4);
	irq_handle(IRQ_GPIO('B'), serve);
	interrupts_on();
	drive("up", 0x3c);
	drive("same", 0x3c);
	drive("down", 0);
}
