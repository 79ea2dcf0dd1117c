/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Both Ethernet ports by descriptors and interrupts: each says hello to all, then sends every frame back to whom it
 * came from. A frame of the type 0x88b6 asks both for their counters.
 */
#include "board.h"

#define DESCRIPTORS 4
#define FRAME_MAX   1536
#define HEADER      14
#define PHY         1

static struct port {
	struct descriptor {
		volatile uint32_t status, buffer, length, next;
	} rx[DESCRIPTORS], tx[DESCRIPTORS];
	uint8_t in[DESCRIPTORS][FRAME_MAX] __attribute__((aligned(4)));
	uint8_t out[DESCRIPTORS][FRAME_MAX + 4] __attribute__((aligned(4)));
	unsigned rx_next, tx_next;
	volatile uint32_t received, transmitted, rx_interrupts, tx_interrupts;
	volatile bool asked;
} ports[2];

static uint8_t address(unsigned port, unsigned byte)
{
	return byte < 5 ? (const uint8_t[]){0x02, 0, 0, 0x09, 0x80}[byte] : (uint8_t)port;
}

static uint32_t physical(const volatile void *at)
{
	return (uint32_t)(uintptr_t)at;
}

static uint32_t phy_read(unsigned port, unsigned number)
{
	EMAC_MIIDA(port) = MIIDA_MDCON | MIIDA_BUSY | PHY << 8 | number;
	while (EMAC_MIIDA(port) & MIIDA_BUSY)
		;
	return EMAC_MIID(port);
}

static void count_sent(struct descriptor *tx, struct port *port)
{
	if (tx->length & TXDS_TXCP) {
		tx->length = 0;
		port->transmitted++;
	}
}

/* The bytes lie in out[tx_next] from its third on: an unaligned buffer is the usual case under Linux. */
static void transmit(struct port *port, unsigned n, uint32_t length)
{
	struct descriptor *tx = &port->tx[port->tx_next];

	count_sent(tx, port); /* before the interrupt does */
	tx->buffer = physical(&port->out[port->tx_next][2]);
	tx->length = length;
	tx->status = TXDS_OWN_DMA | TXDS_INTERRUPT | TXDS_CRC | TXDS_PAD;
	port->tx_next = (port->tx_next + 1) % DESCRIPTORS;
	EMAC_TSDR(n) = 1;
}

static void hello(unsigned n)
{
	struct port *port = &ports[n];
	uint8_t *frame = &port->out[port->tx_next][2];

	for (unsigned i = 0; i < 6; i++) {
		frame[i] = 0xff;
		frame[6 + i] = address(n, i);
	}
	frame[12] = 0x88;
	frame[13] = 0xb5; /* local experimental */
	for (unsigned i = 0; i < 5; i++)
		frame[HEADER + i] = (uint8_t) "hello"[i];
	transmit(port, n, HEADER + 5);
}

static void echo(unsigned n, const uint8_t *in, uint32_t length)
{
	struct port *port = &ports[n];
	uint8_t *frame = &port->out[port->tx_next][2];

	for (unsigned i = 0; i < 6; i++) {
		frame[i] = in[6 + i];
		frame[6 + i] = address(n, i);
	}
	for (unsigned i = 12; i < length; i++)
		frame[i] = in[i];
	port->asked |= in[12] == 0x88 && in[13] == 0xb6;
	transmit(port, n, length);
}

static void rx_serve(unsigned n)
{
	struct port *port = &ports[n];

	EMAC_MISTA(n) = EMAC_MISTA(n) & 0xffff;
	port->rx_interrupts++;
	for (;;) {
		struct descriptor *rx = &port->rx[port->rx_next];
		const uint32_t status = rx->status;

		if (status & RXDS_OWN_DMA)
			break;
		if (status & RXDS_RXGD) {
			port->received++;
			echo(n, port->in[port->rx_next], status & 0xffff);
		}
		rx->status = RXDS_OWN_DMA;
		port->rx_next = (port->rx_next + 1) % DESCRIPTORS;
	}
	EMAC_RSDR(n) = 1;
}

static void tx_serve(unsigned n)
{
	struct port *port = &ports[n];

	EMAC_MISTA(n) = EMAC_MISTA(n) & 0xffff0000;
	port->tx_interrupts++;
	for (unsigned i = 0; i < DESCRIPTORS; i++)
		count_sent(&port->tx[i], port);
}

static void rx0(void)
{
	rx_serve(0);
}

static void rx1(void)
{
	rx_serve(1);
}

static void tx0(void)
{
	tx_serve(0);
}

static void tx1(void)
{
	tx_serve(1);
}

static void start(unsigned n)
{
	struct port *port = &ports[n];

	for (unsigned i = 0; i < DESCRIPTORS; i++) {
		port->rx[i].status = RXDS_OWN_DMA;
		port->rx[i].buffer = physical(port->in[i]);
		port->rx[i].next = physical(&port->rx[(i + 1) % DESCRIPTORS]);
		port->tx[i].next = physical(&port->tx[(i + 1) % DESCRIPTORS]);
	}
	EMAC_MCMDR(n) = MCMDR_SWR;
	while (EMAC_MCMDR(n) & MCMDR_SWR)
		;
	say("port %u: phy %x %x, link %u\n", n, phy_read(n, 2), phy_read(n, 3), phy_read(n, 1) >> 2 & 1);
	EMAC_CAM0M(n) = (uint32_t)address(n, 0) << 24 | (uint32_t)address(n, 1) << 16 |
			(uint32_t)address(n, 2) << 8 | address(n, 3);
	EMAC_CAM0L(n) = (uint32_t)address(n, 4) << 24 | (uint32_t)address(n, 5) << 16;
	EMAC_CAMEN(n) = 1;
	EMAC_CAMCMR(n) = CAMCMR_ECMP | CAMCMR_ABP;
	EMAC_TXDLSA(n) = physical(port->tx);
	EMAC_RXDLSA(n) = physical(port->rx);
	EMAC_DMARFC(n) = FRAME_MAX;
	EMAC_MIEN(n) = MISTA_RXINTR | MISTA_RXGD | MISTA_TXINTR | MISTA_TXCP;
	EMAC_MCMDR(n) = MCMDR_RXON | MCMDR_TXON | MCMDR_SPCRC | MCMDR_FDUP | MCMDR_100M;
	EMAC_RSDR(n) = 1;
	hello(n);
}

void probe(void)
{
	/* Before its pins are selected a port hears no PHY. */
	say("no pins: phy %x\n", phy_read(0, 2));
	for (unsigned pin = 0; pin < 10; pin++) {
		pin_select('E', pin, 1);
		pin_select('F', pin, 1);
	}
	irq_handle(IRQ_EMAC_RX(0), rx0);
	irq_handle(IRQ_EMAC_RX(1), rx1);
	irq_handle(IRQ_EMAC_TX(0), tx0);
	irq_handle(IRQ_EMAC_TX(1), tx1);
	for (unsigned n = 0; n < 2; n++)
		start(n);
	interrupts_on();
	say("ready\n");
	for (unsigned n = 0; n < 2; n++) {
		struct port *port = &ports[n];

		while (!port->asked || port->transmitted < port->received + 1)
			;
		say("port %u: received %u, transmitted %u, interrupts %s\n", n, port->received,
		    port->transmitted, port->rx_interrupts && port->tx_interrupts ? "of both" : "missing");
	}
}
