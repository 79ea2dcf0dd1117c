/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Never ends: TIMER0 interrupts each millisecond, TIMER5 is the clock beside it, bytes of UART1 go back by interrupts.
 * A number asked on UART0 is answered by what has happened until now.
 */
#include "board.h"

#define SIZE 4096

static volatile uint32_t ticks, received, sent, overruns;
static uint8_t bytes[SIZE];

static void tick(void)
{
	ETIMER_ISR(0) = 1;
	ticks++;
}

static void serve(void)
{
	if (UART_FSR(1) & FSR_RX_OVER) {
		UART_FSR(1) = FSR_RX_OVER;
		overruns++;
	}
	while (!(UART_FSR(1) & FSR_RX_EMPTY))
		bytes[received++ % SIZE] = (uint8_t)UART_DAT(1);
	while (sent < received && !(UART_FSR(1) & FSR_TX_FULL))
		UART_DAT(1) = bytes[sent++ % SIZE];
	UART_IER(1) = IER_RDA | IER_RXTO | IER_TOCNTEN | (sent < received ? IER_THRE : 0);
}

void probe(void)
{
	pin_select('A', 0, 4);
	pin_select('F', 10, 2);
	uart_start(1, XIN_HZ, 1200, FCR_TRIGGER_8); /* slow: bytes are on their way for long */
	irq_handle(IRQ_UART(1), serve);
	irq_handle(IRQ_ETIMER(0), tick);
	UART_IER(1) = IER_RDA | IER_RXTO | IER_TOCNTEN;
	etimer_start(0, ETIMER_PERIODIC, 1000);
	const uint32_t start = microseconds();

	interrupts_on();
	say("ready\n");
	for (;;) {
		while (UART_FSR(0) & FSR_RX_EMPTY)
			for (volatile unsigned i = 0; i < 300; i++)
				; /* a look at the bus is slow in an emulator */
		const uint32_t number = ask();

		interrupts_off();
		const uint32_t time = since(start), counted = ticks;

		interrupts_on();
		say("%u: ticks %u in %u us, bytes %u, overruns %u\n", number, counted, time, sent, overruns);
	}
}
