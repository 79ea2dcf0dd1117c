/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The six RS-485 ports at once, by interrupts: each byte goes back plus the number of its port. */
#include "board.h"

#define UPLL_HZ 300000000
#define BAUD    115200
#define SIZE    1024

/* The board's wiring: board/nuc980/boards/gateway/pins.yml. */
static const struct wiring {
	uint8_t uart;
	struct {
		char port;
		uint8_t pin, function;
	} rxd, txd;
} ports[] = {
    {1, {'A', 0, 4}, {'F', 10, 2}},  {2, {'A', 9, 2}, {'A', 10, 2}}, {3, {'D', 3, 2}, {'D', 2, 2}},
    {4, {'D', 13, 1}, {'D', 12, 1}}, {6, {'A', 4, 1}, {'A', 5, 1}},  {8, {'A', 11, 2}, {'A', 12, 2}},
};

static struct line {
	uint8_t bytes[SIZE];
	volatile uint32_t received, sent;
} lines[9];

static volatile uint32_t overruns;

static void serve(unsigned uart)
{
	struct line *line = &lines[uart];

	if (UART_FSR(uart) & FSR_RX_OVER) {
		UART_FSR(uart) = FSR_RX_OVER;
		overruns++;
	}
	while (!(UART_FSR(uart) & FSR_RX_EMPTY))
		line->bytes[line->received++ % SIZE] = (uint8_t)UART_DAT(uart);
	while (line->sent < line->received && !(UART_FSR(uart) & FSR_TX_FULL))
		UART_DAT(uart) = (uint8_t)(line->bytes[line->sent++ % SIZE] + uart);
	UART_IER(uart) = IER_RDA | IER_RXTO | IER_TOCNTEN | (line->sent < line->received ? IER_THRE : 0);
}

static void serve1(void)
{
	serve(1);
}

static void serve2(void)
{
	serve(2);
}

static void serve3(void)
{
	serve(3);
}

static void serve4(void)
{
	serve(4);
}

static void serve6(void)
{
	serve(6);
}

static void serve8(void)
{
	serve(8);
}

static void (*const handlers[])(void) = {serve1, serve2, serve3, serve4, serve6, serve8};

void probe(void)
{
	uint32_t bytes = 0;

	/* UART1..9 from UPLL / 2, as the vendor's driver wants them; UART0 stays on XIN. */
	CLK_UPLLCON = 0xd0000018;
	for (unsigned uart = 1; uart < 10; uart++)
		CLK_DIV4(uart) = (CLK_DIV4(uart) & ~(0xffu << uart % 4 * 8)) | 0x38u << uart % 4 * 8;
	for (unsigned i = 0; i < ARRAY_SIZE(ports); i++) {
		const struct wiring *port = &ports[i];

		pin_select(port->rxd.port, port->rxd.pin, port->rxd.function);
		pin_select(port->txd.port, port->txd.pin, port->txd.function);
		uart_start(port->uart, UPLL_HZ / 2, BAUD, FCR_TRIGGER_14);
		irq_handle(IRQ_UART(port->uart), handlers[i]);
		UART_IER(port->uart) = IER_RDA | IER_RXTO | IER_TOCNTEN;
	}
	interrupts_on();
	say("ready\n");
	const uint32_t wanted = ask();

	while (bytes < wanted) {
		bytes = 0;
		for (unsigned i = 0; i < ARRAY_SIZE(ports); i++)
			bytes += lines[ports[i].uart].sent;
	}
	say("bytes %u, overruns %u\n", bytes, overruns);
}
