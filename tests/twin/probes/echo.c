/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * UART0 by interrupts: what comes goes back, until a full stop. Asks for the speed first.
 * The receiver interrupts at 8 characters, and at the time-out for those that are left.
 */
#include "board.h"

#define SIZE 4096

static volatile uint32_t received, sent, full, rests, overruns, first, last;
static uint8_t bytes[SIZE];
static volatile bool stop;

static void take(unsigned count)
{
	for (; count && !(UART_FSR(0) & FSR_RX_EMPTY); count--) {
		const uint8_t byte = (uint8_t)UART_DAT(0);

		last = microseconds();
		if (!received)
			first = last;
		bytes[received++ % SIZE] = byte;
		stop |= byte == '.';
	}
}

static void serve(void)
{
	const uint32_t isr = UART_ISR(0);

	if (UART_FSR(0) & FSR_RX_OVER) {
		UART_FSR(0) = FSR_RX_OVER;
		overruns++;
	}
	if (isr & ISR_RDA_INT) {
		full++;
		take(7); /* one stays, for the time-out */
	} else if (isr & ISR_RXTO_INT) {
		rests++;
		take(16);
	}
	if (isr & ISR_THRE_INT) {
		while (sent < received && !(UART_FSR(0) & FSR_TX_FULL))
			UART_DAT(0) = bytes[sent++ % SIZE];
	}
	UART_IER(0) = IER_RDA | IER_RXTO | IER_TOCNTEN | (sent < received ? IER_THRE : 0);
}

void probe(void)
{
	say("speed?\n");
	const uint32_t baud = ask();

	uart_start(0, XIN_HZ, baud, FCR_TRIGGER_8);
	say("at %u\n", baud);
	irq_handle(IRQ_UART(0), serve);
	UART_IER(0) = IER_RDA | IER_RXTO | IER_TOCNTEN;
	interrupts_on();
	while (!stop || sent < received)
		;
	interrupts_off();
	say("\nbytes %u in %u us, full %u, rests %u, overruns %u\n", received, (last - first) & 0xffffff,
	    full, rests, overruns);
}
