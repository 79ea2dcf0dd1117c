/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * UART1 by PDMA, as the vendor's driver programs it: a ring of two receive buffers with the request time-out for what
 * does not fill one, and single transfers for what is sent. What comes goes back after each event.
 */
#include "board.h"

#define UPLL_HZ  300000000
#define BAUD     115200
#define HALF     128
#define RX       3 /* channels */
#define TX       6
#define TIME_OUT 0xcc /* with prescaler 0, the driver's value for 115200: 0.35 ms at 150 MHz */

static struct task {
	uint32_t control, from, to, next;
} ring[2] __attribute__((aligned(16)));

static uint8_t rx[2][HALF], tx[HALF], heard[4096];
static volatile uint32_t done, time_outs, bytes, taken, transmitted;
static volatile bool sending;

static uint32_t physical(const volatile void *at)
{
	return (uint32_t)(uintptr_t)at;
}

static void ring_start(void)
{
	for (unsigned i = 0; i < 2; i++)
		ring[i] = (struct task){
		    .control = PDMA_COUNT(HALF) | PDMA_SA_FIXED | PDMA_SINGLE | PDMA_SCATTER,
		    .from = UART(1),
		    .to = physical(rx[i]),
		    .next = physical(&ring[!i]),
		};
	taken = 0;
	PDMA_REQSEL(RX) = (PDMA_REQSEL(RX) & ~(0xffu << RX % 4 * 8)) | PDMA_UART_RX(1) << RX % 4 * 8;
	PDMA_CHCTL |= BIT(RX);
	PDMA_TOUTPSC &= ~(7u << 4 * RX);
	PDMA_TOC(RX) = (PDMA_TOC(RX) & ~(0xffffu << RX % 2 * 16)) | (uint32_t)TIME_OUT << RX % 2 * 16;
	PDMA_TOUTEN |= BIT(RX);
	PDMA_TOUTIEN |= BIT(RX);
	PDMA_NEXT(RX) = physical(&ring[0]);
	PDMA_CTL(RX) = PDMA_SCATTER;
	UART_IER(1) |= IER_RXPDMAEN;
}

static void send(uint32_t from, uint32_t count)
{
	for (uint32_t i = 0; i < count; i++)
		tx[i] = heard[(from + i) % sizeof(heard)];
	sending = true;
	PDMA_REQSEL(TX) = (PDMA_REQSEL(TX) & ~(0xffu << TX % 4 * 8)) | PDMA_UART_TX(1) << TX % 4 * 8;
	PDMA_SA(TX) = physical(tx);
	PDMA_DA(TX) = UART(1);
	PDMA_CTL(TX) = PDMA_COUNT(count) | PDMA_DA_FIXED | PDMA_SINGLE | PDMA_BASIC;
	interrupts_off(); /* both registers also change in serve() */
	PDMA_CHCTL |= BIT(TX);
	UART_IER(1) |= IER_TXPDMAEN;
	interrupts_on();
}

static void event(const uint8_t *from, uint32_t count)
{
	for (uint32_t i = 0; i < count; i++)
		heard[bytes++ % sizeof(heard)] = from[i];
}

static void buffer_full(void)
{
	done++;
	event(rx[taken++ % 2], HALF);
}

/* The buffer in work has count - 1 of what is missing in its control word. */
static void rest(void)
{
	const uint32_t missing = (PDMA_CTL(RX) >> 16) + 1;

	time_outs++;
	PDMA_TOUTEN &= ~BIT(RX);
	UART_IER(1) &= ~IER_RXPDMAEN;
	event(rx[taken % 2], HALF - missing);
	PDMA_CHRST = BIT(RX);
	ring_start();
}

static void serve(void)
{
	const uint32_t finished = PDMA_TDSTS, late = PDMA_INTSTS;

	PDMA_TDSTS = finished;
	PDMA_INTSTS = late;
	if (finished & BIT(TX)) {
		UART_IER(1) &= ~IER_TXPDMAEN;
		sending = false;
		transmitted++;
	}
	if (finished & BIT(RX))
		buffer_full();
	if (late & BIT(8 + RX))
		rest();
}

void probe(void)
{
	uint32_t echoed = 0;

	CLK_UPLLCON = 0xd0000018;
	CLK_DIV0 = (CLK_DIV0 & ~0x18u) | 0x18; /* SYS from UPLL: HCLK at 150 MHz */
	CLK_DIV4(1) = (CLK_DIV4(1) & ~0xff00u) | 0x3800;
	pin_select('A', 0, 4);
	pin_select('F', 10, 2);
	uart_start(1, UPLL_HZ / 2, BAUD, FCR_TRIGGER_1);
	PDMA_INTEN |= BIT(RX) | BIT(TX);
	irq_handle(IRQ_PDMA0, serve);
	ring_start();
	interrupts_on();
	say("ready\n");
	const uint32_t wanted = ask();

	while (echoed < wanted) {
		const uint32_t count = bytes - echoed;

		if (!count || sending)
			continue;
		send(echoed, count < HALF ? count : HALF);
		echoed += count < HALF ? count : HALF;
	}
	while (sending)
		;
	interrupts_off();
	say("bytes %u, full %u, time-outs %u, transmits %u\n", bytes, done, time_outs, transmitted);
}
