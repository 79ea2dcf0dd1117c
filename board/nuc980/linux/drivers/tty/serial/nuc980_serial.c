// SPDX-License-Identifier: GPL-2.0-only
/*
 * Nuvoton NUC980 UARTs
 *
 * There is no public manual of the chip. Registers are as in its vendor's header
 * files; where those say nothing, as the manuals of its siblings describe the same
 * names (M480, M2354).
 */

#include <linux/atomic.h>
#include <linux/bitfield.h>
#include <linux/clk.h>
#include <linux/console.h>
#include <linux/delay.h>
#include <linux/dma-mapping.h>
#include <linux/dmaengine.h>
#include <linux/dma/nuc980-pdma.h>
#include <linux/hrtimer.h>
#include <linux/interrupt.h>
#include <linux/io.h>
#include <linux/math.h>
#include <linux/module.h>
#include <linux/of.h>
#include <linux/platform_device.h>
#include <linux/serial.h>
#include <linux/serial_core.h>
#include <linux/tty.h>
#include <linux/tty_flip.h>

#include <asm/early_ioremap.h>

#define NUC980_UARTS		10
#define NUC980_FIFO		16

#define NUC980_DAT		0x00
#define NUC980_IER		0x04
#define  NUC980_IER_TIMEOUT	BIT(11)	/* the time-out counter runs */
#define  NUC980_IER_AUTO_RTS	BIT(12)
#define  NUC980_IER_AUTO_CTS	BIT(13)
#define  NUC980_IER_TX_PDMA	BIT(14)
#define  NUC980_IER_RX_PDMA	BIT(15)
#define NUC980_FCR		0x08
#define  NUC980_FCR_RX_RESET	BIT(1)
#define  NUC980_FCR_RX_TRIGGER	GENMASK(7, 4)
#define  NUC980_FCR_RTS_TRIGGER	GENMASK(19, 16)
#define   NUC980_TRIGGER_1	0
#define   NUC980_TRIGGER_8	2
#define NUC980_LCR		0x0c
#define  NUC980_LCR_WORD	GENMASK(1, 0)	/* data bits - 5 */
#define  NUC980_LCR_8N1		3
#define  NUC980_LCR_STOP2	BIT(2)
#define  NUC980_LCR_PARITY	BIT(3)
#define  NUC980_LCR_EVEN	BIT(4)
#define  NUC980_LCR_STICK	BIT(5)
#define  NUC980_LCR_BREAK	BIT(6)
#define NUC980_MCR		0x10
#define  NUC980_MCR_RTS_OFF	BIT(1)
#define  NUC980_MCR_RTS_LOW	BIT(9)	/* RTS is active low */
#define NUC980_MSR		0x14
#define  NUC980_MSR_CTS_CHANGED	BIT(0)
#define  NUC980_MSR_CTS_LEVEL	BIT(4)
#define  NUC980_MSR_CTS_LOW	BIT(8)	/* CTS is active low */
#define NUC980_FSR		0x18
#define  NUC980_FSR_OVERRUN	BIT(0)
#define  NUC980_FSR_PARITY	BIT(4)
#define  NUC980_FSR_FRAMING	BIT(5)
#define  NUC980_FSR_BREAK	BIT(6)
#define  NUC980_FSR_RX_LEVEL	GENMASK(13, 8)
#define  NUC980_FSR_RX_EMPTY	BIT(14)
#define  NUC980_FSR_TX_FULL	BIT(23)
#define  NUC980_FSR_TX_DONE	BIT(28)	/* the last stop bit is out, too */
#define NUC980_ISR		0x1c
#define NUC980_TOR		0x20
#define NUC980_BAUD		0x24
#define  NUC980_BAUD_MODE2	GENMASK(29, 28)	/* does not divide by 16 */
#define NUC980_ALT		0x2c
#define  NUC980_ALT_AUD		BIT(10)	/* RTS follows the transmitter */
#define NUC980_FUNC		0x30
#define  NUC980_FUNC_UART	0
#define  NUC980_FUNC_RS485	3

/*
 * Interrupts: in IER, and 8 bits up in ISR while they are both enabled and pending.
 * With PDMA on, those that are not its business show 24 bits up.
 */
#define NUC980_INT_RX		BIT(0)	/* as many characters as the trigger */
#define NUC980_INT_TX		BIT(1)	/* the transmit FIFO is empty */
#define NUC980_INT_LINE		BIT(2)	/* parity, framing, break */
#define NUC980_INT_MODEM	BIT(3)
#define NUC980_INT_RX_TIMEOUT	BIT(4)
#define NUC980_INT_OVERRUN	BIT(5)
#define NUC980_INT_TX_END	BIT(22)	/* the last stop bit is out; not 24 bits up */
#define NUC980_INT_RX_CHARS	(NUC980_INT_RX | NUC980_INT_RX_TIMEOUT)
#define NUC980_INT_RX_ERRORS	(NUC980_INT_LINE | NUC980_INT_OVERRUN)

/* These flags stay until a 1 is written to them. */
#define NUC980_RX_ERRORS	(NUC980_FSR_BREAK | NUC980_FSR_FRAMING | \
				 NUC980_FSR_PARITY | NUC980_FSR_OVERRUN)
/* The debug UART, its only two pins (PF11, PF12), and their function */
#define NUC980_UART0		0xb0070000
#define NUC980_MFP_PF_HIGH	0xb000009c
#define NUC980_MFP_UART0_PINS	GENMASK(19, 12)
#define NUC980_MFP_UART0	0x11

/* Not a bit of FSR: what is ignored when nothing is to be received */
#define NUC980_RX_ANY		BIT(31)

/* BRD has 16 bits and counts from 2; the vendor's driver goes no lower than this. */
#define NUC980_DIVIDER_MAX	(0xffff + 2)
#define NUC980_DIVIDER_MIN	11

/* Silence after which what has come is handed on: Modbus has 1.5 within a frame. */
#define NUC980_TIMEOUT_CHARS	2

/* A received character waits for the next period or the time-out. */
#define NUC980_RX_RING		4096
#define NUC980_RX_PERIOD	128

/* Of RTS, where the driver moves it: off, on and waiting, on, on and waiting */
enum nuc980_rts {
	NUC980_RTS_OFF,
	NUC980_RTS_BEFORE,
	NUC980_RTS_ON,
	NUC980_RTS_AFTER,
};

struct nuc980_uart {
	struct uart_port port;
	atomic_t console_printing;

	enum nuc980_rts rts;
	struct hrtimer rts_timer;

	bool pdma;			/* may use it */
	struct dma_chan *rx_chan;	/* NULL: by interrupts */
	dma_cookie_t rx_cookie;
	u8 *rx_ring;
	dma_addr_t rx_ring_dma;
	unsigned int rx_tail;
	u32 rx_timeout_ns;

	struct dma_chan *tx_chan;
	dma_cookie_t tx_cookie;
	dma_addr_t tx_dma;
	unsigned int tx_len;		/* 0: no transfer under way */
};

static struct nuc980_uart *nuc980_uarts[NUC980_UARTS];

static struct nuc980_uart *to_nuc980_uart(struct uart_port *port)
{
	return container_of(port, struct nuc980_uart, port);
}

static u32 nuc980_read(struct uart_port *port, unsigned int reg)
{
	return readl(port->membase + reg);
}

static void nuc980_write(struct uart_port *port, unsigned int reg, u32 value)
{
	writel(value, port->membase + reg);
}

static void nuc980_update(struct uart_port *port, unsigned int reg, u32 clear, u32 set)
{
	nuc980_write(port, reg, (nuc980_read(port, reg) & ~clear) | set);
}

/* Receiving */

static unsigned int nuc980_rx_level(u32 fsr)
{
	if (fsr & NUC980_FSR_RX_EMPTY)
		return 0;

	/* A full FIFO shows as 0. */
	return FIELD_GET(NUC980_FSR_RX_LEVEL, fsr) % NUC980_FIFO ?: NUC980_FIFO;
}

static void nuc980_rx_count_errors(struct uart_port *port, u32 errors)
{
	struct uart_icount *icount = &port->icount;

	if (errors & NUC980_FSR_BREAK)
		icount->brk++;
	else if (errors & NUC980_FSR_FRAMING)
		icount->frame++;
	else if (errors & NUC980_FSR_PARITY)
		icount->parity++;
	if (errors & NUC980_FSR_OVERRUN)
		icount->overrun++;
}

static unsigned int nuc980_rx_flag(u32 errors)
{
	if (errors & NUC980_FSR_BREAK)
		return TTY_BREAK;
	if (errors & NUC980_FSR_FRAMING)
		return TTY_FRAME;
	if (errors & NUC980_FSR_PARITY)
		return TTY_PARITY;

	return TTY_NORMAL;
}

static void nuc980_rx_char(struct uart_port *port, unsigned int ch, u32 errors)
{
	port->icount.rx++;

	if (errors & NUC980_FSR_BREAK && uart_handle_break(port))
		return;
	if (uart_prepare_sysrq_char(port, ch))
		return;

	errors &= port->read_status_mask;
	uart_insert_char(port, errors | NUC980_RX_ANY, NUC980_FSR_OVERRUN, ch,
			 nuc980_rx_flag(errors));
}

/* The errors since they were last asked for */
static u32 nuc980_rx_take_errors(struct uart_port *port, u32 fsr)
{
	u32 errors = fsr & NUC980_RX_ERRORS;

	if (errors) {
		nuc980_write(port, NUC980_FSR, errors);
		nuc980_rx_count_errors(port, errors);
	}

	return errors;
}

/*
 * The flags are of the receiver, not of the head of its FIFO: they say that
 * something was wrong with a character that came since they were cleared. The
 * interrupt that they raise is served before the next one is complete, unless the
 * system is late, so they are those of the newest.
 */
static void nuc980_rx_chars(struct uart_port *port)
{
	unsigned int level;
	u32 fsr, errors;

	do {
		fsr = nuc980_read(port, NUC980_FSR);
		errors = nuc980_rx_take_errors(port, fsr);

		for (level = nuc980_rx_level(fsr); level > 0; level--)
			nuc980_rx_char(port, nuc980_read(port, NUC980_DAT) & 0xff,
				       level == 1 ? errors : 0);
	} while (!(nuc980_read(port, NUC980_FSR) & NUC980_FSR_RX_EMPTY));

	tty_flip_buffer_push(&port->state->port);
}

/*
 * RS-485: the transmitter moves RTS itself, from the first start to the last stop
 * bit. It knows no delays: with one, the driver moves RTS.
 */

static bool nuc980_rts_has_delay(const struct serial_rs485 *rs485)
{
	return rs485->delay_rts_before_send || rs485->delay_rts_after_send;
}

static bool nuc980_rts_is_ours(struct uart_port *port)
{
	return port->rs485.flags & SER_RS485_ENABLED &&
	       nuc980_rts_has_delay(&port->rs485);
}

static void nuc980_rts_set(struct uart_port *port, const struct serial_rs485 *rs485,
			   bool on)
{
	bool low = !(rs485->flags & SER_RS485_RTS_ON_SEND);

	nuc980_write(port, NUC980_MCR, (low ? NUC980_MCR_RTS_LOW : 0) |
				       (on ? 0 : NUC980_MCR_RTS_OFF));
}

static void nuc980_rts_off(struct uart_port *port)
{
	nuc980_rts_set(port, &port->rs485, false);
	to_nuc980_uart(port)->rts = NUC980_RTS_OFF;
}

static void nuc980_rts_wait(struct uart_port *port, enum nuc980_rts rts, u32 ms)
{
	struct nuc980_uart *up = to_nuc980_uart(port);

	up->rts = rts;
	hrtimer_start(&up->rts_timer, ms_to_ktime(ms), HRTIMER_MODE_REL);
}

static bool nuc980_tx_nothing(struct uart_port *port)
{
	return !port->x_char && uart_circ_empty(&port->state->xmit);
}

/* Whether it may be sent now; if not, the timer will begin, or there is nothing. */
static bool nuc980_rts_begin(struct uart_port *port)
{
	struct nuc980_uart *up = to_nuc980_uart(port);
	u32 ms = port->rs485.delay_rts_before_send;

	switch (up->rts) {
	case NUC980_RTS_OFF:
		if (nuc980_tx_nothing(port))
			return false;
		nuc980_rts_set(port, &port->rs485, true);
		if (ms) {
			nuc980_rts_wait(port, NUC980_RTS_BEFORE, ms);
			return false;
		}
		up->rts = NUC980_RTS_ON;
		return true;
	case NUC980_RTS_BEFORE:
		return false;
	case NUC980_RTS_AFTER:
		hrtimer_try_to_cancel(&up->rts_timer);
		up->rts = NUC980_RTS_ON;
		return true;
	default:
		return true;
	}
}

static void nuc980_rts_end(struct uart_port *port)
{
	u32 ms = port->rs485.delay_rts_after_send;

	/* More may have been given since the interrupt. */
	if (!(nuc980_read(port, NUC980_IER) & NUC980_INT_TX_END) ||
	    !(nuc980_read(port, NUC980_FSR) & NUC980_FSR_TX_DONE))
		return;

	nuc980_update(port, NUC980_IER, NUC980_INT_TX_END, 0);
	if (to_nuc980_uart(port)->rts != NUC980_RTS_ON)
		return;
	if (ms)
		nuc980_rts_wait(port, NUC980_RTS_AFTER, ms);
	else
		nuc980_rts_off(port);
}

static void nuc980_start_tx(struct uart_port *port);

static enum hrtimer_restart nuc980_rts_timeout(struct hrtimer *timer)
{
	struct nuc980_uart *up = container_of(timer, struct nuc980_uart, rts_timer);
	struct uart_port *port = &up->port;
	unsigned long flags;

	uart_port_lock_irqsave(port, &flags);
	if (hrtimer_is_queued(timer)) {
		/* It was started anew while this waited for the lock. */
	} else if (up->rts == NUC980_RTS_AFTER) {
		nuc980_rts_off(port);
	} else {
		if (up->rts == NUC980_RTS_BEFORE)
			up->rts = NUC980_RTS_ON;
		nuc980_start_tx(port);
	}
	uart_port_unlock_irqrestore(port, flags);

	return HRTIMER_NORESTART;
}

/* Sending */

/* Nothing follows what the FIFO has. */
static void nuc980_tx_all_given(struct uart_port *port)
{
	nuc980_update(port, NUC980_IER, NUC980_INT_TX,
		      nuc980_rts_is_ours(port) ? NUC980_INT_TX_END : 0);
}

static bool nuc980_tx_full(struct uart_port *port)
{
	return nuc980_read(port, NUC980_FSR) & NUC980_FSR_TX_FULL;
}

static void nuc980_tx_xchar(struct uart_port *port)
{
	nuc980_write(port, NUC980_DAT, port->x_char);
	port->x_char = 0;
	port->icount.tx++;
}

/* Fills the FIFO, and asks for an interrupt when that is empty if there is more. */
static void nuc980_tx_chars(struct uart_port *port)
{
	struct circ_buf *xmit = &port->state->xmit;

	if (port->x_char && !nuc980_tx_full(port))
		nuc980_tx_xchar(port);

	if (!uart_tx_stopped(port)) {
		while (!uart_circ_empty(xmit) && !nuc980_tx_full(port)) {
			nuc980_write(port, NUC980_DAT, xmit->buf[xmit->tail]);
			uart_xmit_advance(port, 1);
		}
		if (uart_circ_chars_pending(xmit) < WAKEUP_CHARS)
			uart_write_wakeup(port);
	}

	if (port->x_char || (!uart_circ_empty(xmit) && !uart_tx_stopped(port)))
		nuc980_update(port, NUC980_IER, NUC980_INT_TX_END, NUC980_INT_TX);
	else
		nuc980_tx_all_given(port);
}

/*
 * PDMA
 *
 * Received characters go round in a ring for as long as the port is open. Each
 * period, and each silence as long as the time-out, says that there are new ones;
 * how many is read from the position of the transfer. So there is no moment at which
 * a character finds nobody to take it.
 */

static void nuc980_dma_rx_run(struct uart_port *port, unsigned int head)
{
	struct nuc980_uart *up = to_nuc980_uart(port);
	unsigned int count = head - up->rx_tail;

	port->icount.rx += count;
	if (!(port->ignore_status_mask & NUC980_RX_ANY) &&
	    tty_insert_flip_string(&port->state->port, up->rx_ring + up->rx_tail,
				   count) < count)
		port->icount.buf_overrun++;
	up->rx_tail = head % NUC980_RX_RING;
}

static unsigned int nuc980_dma_rx_head(struct nuc980_uart *up)
{
	struct dma_tx_state state;

	dmaengine_tx_status(up->rx_chan, up->rx_cookie, &state);

	return (NUC980_RX_RING - state.residue) % NUC980_RX_RING;
}

/* What is new in the ring; the errors are those of the newest */
static void nuc980_dma_rx_ring(struct uart_port *port, u32 errors)
{
	struct nuc980_uart *up = to_nuc980_uart(port);
	unsigned int head = nuc980_dma_rx_head(up), newest;

	if (head == up->rx_tail)
		return;
	newest = (head ?: NUC980_RX_RING) - 1;
	if (newest < up->rx_tail)
		nuc980_dma_rx_run(port, NUC980_RX_RING);
	nuc980_dma_rx_run(port, newest);
	nuc980_rx_char(port, up->rx_ring[newest], errors);
	up->rx_tail = head;
}

/*
 * The siblings' manuals say that PDMA stops at a wrong character until the flags are
 * cleared; then it is the first in the FIFO. If it did not stop, it is the newest in
 * the ring. Characters are moved here while PDMA is off.
 */
static void nuc980_dma_rx_errors(struct uart_port *port)
{
	u32 ier = nuc980_read(port, NUC980_IER), fsr, errors;
	unsigned int level;

	nuc980_write(port, NUC980_IER, ier & ~NUC980_IER_RX_PDMA);
	fsr = nuc980_read(port, NUC980_FSR);
	errors = nuc980_rx_take_errors(port, fsr);
	level = nuc980_rx_level(fsr);

	nuc980_dma_rx_ring(port, level ? 0 : errors);
	for (; level > 0; level--) {
		nuc980_rx_char(port, nuc980_read(port, NUC980_DAT) & 0xff, errors);
		errors = 0;
	}
	nuc980_write(port, NUC980_IER, ier);
}

static void nuc980_dma_rx(struct uart_port *port)
{
	if (nuc980_read(port, NUC980_FSR) & NUC980_RX_ERRORS)
		nuc980_dma_rx_errors(port);
	else
		nuc980_dma_rx_ring(port, 0);

	tty_flip_buffer_push(&port->state->port);
}

static void nuc980_dma_rx_callback(void *arg)
{
	struct uart_port *port = arg;
	unsigned long flags;

	uart_port_lock_irqsave(port, &flags);
	nuc980_dma_rx(port);
	uart_port_unlock_irqrestore(port, flags);
}

static void nuc980_dma_start_tx(struct uart_port *port);

static void nuc980_dma_tx_callback(void *arg)
{
	struct uart_port *port = arg;
	struct nuc980_uart *up = to_nuc980_uart(port);
	unsigned long flags;

	uart_port_lock_irqsave(port, &flags);
	/* Not one that was flushed meanwhile */
	if (up->tx_len && dmaengine_tx_status(up->tx_chan, up->tx_cookie, NULL) ==
			  DMA_COMPLETE) {
		uart_xmit_advance(port, up->tx_len);
		up->tx_len = 0;
		if (uart_circ_chars_pending(&port->state->xmit) < WAKEUP_CHARS)
			uart_write_wakeup(port);
		nuc980_dma_start_tx(port);
	}
	uart_port_unlock_irqrestore(port, flags);
}

static void nuc980_dma_tx_chars(struct uart_port *port)
{
	struct nuc980_uart *up = to_nuc980_uart(port);
	struct circ_buf *xmit = &port->state->xmit;
	unsigned int len = CIRC_CNT_TO_END(xmit->head, xmit->tail, UART_XMIT_SIZE);
	struct dma_async_tx_descriptor *desc;

	desc = dmaengine_prep_slave_single(up->tx_chan, up->tx_dma + xmit->tail, len,
					   DMA_MEM_TO_DEV,
					   DMA_PREP_INTERRUPT | DMA_CTRL_ACK);
	if (!desc) {
		nuc980_tx_chars(port);
		return;
	}
	dma_sync_single_for_device(up->tx_chan->device->dev, up->tx_dma + xmit->tail,
				   len, DMA_TO_DEVICE);
	desc->callback = nuc980_dma_tx_callback;
	desc->callback_param = port;
	up->tx_len = len;
	up->tx_cookie = dmaengine_submit(desc);
	dma_async_issue_pending(up->tx_chan);
}

static void nuc980_dma_start_tx(struct uart_port *port)
{
	struct nuc980_uart *up = to_nuc980_uart(port);

	nuc980_update(port, NUC980_IER, NUC980_INT_TX | NUC980_INT_TX_END, 0);
	if (port->x_char) {
		nuc980_update(port, NUC980_IER, NUC980_IER_TX_PDMA, 0);
		if (nuc980_tx_full(port)) {
			nuc980_update(port, NUC980_IER, 0, NUC980_INT_TX);
			return;
		}
		nuc980_tx_xchar(port);
	}
	if (uart_tx_stopped(port)) {
		nuc980_tx_all_given(port);
		return;
	}
	nuc980_update(port, NUC980_IER, 0, NUC980_IER_TX_PDMA);
	if (up->tx_len)
		return;
	if (uart_circ_empty(&port->state->xmit))
		nuc980_tx_all_given(port);
	else
		nuc980_dma_tx_chars(port);
}

static int nuc980_dma_config_rx(struct nuc980_uart *up)
{
	struct nuc980_pdma_config pdma = {
		.timeout_ns = up->rx_timeout_ns,
	};
	struct dma_slave_config config = {
		.direction = DMA_DEV_TO_MEM,
		.src_addr = up->port.mapbase + NUC980_DAT,
		.src_addr_width = DMA_SLAVE_BUSWIDTH_1_BYTE,
		.src_maxburst = 1,
		.peripheral_config = &pdma,
		.peripheral_size = sizeof(pdma),
	};

	return dmaengine_slave_config(up->rx_chan, &config);
}

static int nuc980_dma_config_tx(struct nuc980_uart *up)
{
	struct dma_slave_config config = {
		.direction = DMA_MEM_TO_DEV,
		.dst_addr = up->port.mapbase + NUC980_DAT,
		.dst_addr_width = DMA_SLAVE_BUSWIDTH_1_BYTE,
		.dst_maxburst = 1,
	};

	return dmaengine_slave_config(up->tx_chan, &config);
}

static int nuc980_dma_start_rx(struct nuc980_uart *up)
{
	struct dma_async_tx_descriptor *desc;
	int ret;

	ret = nuc980_dma_config_rx(up);
	if (ret)
		return ret;

	desc = dmaengine_prep_dma_cyclic(up->rx_chan, up->rx_ring_dma, NUC980_RX_RING,
					 NUC980_RX_PERIOD, DMA_DEV_TO_MEM,
					 DMA_PREP_INTERRUPT);
	if (!desc)
		return -EBUSY;

	desc->callback = nuc980_dma_rx_callback;
	desc->callback_param = &up->port;
	up->rx_tail = 0;
	up->rx_cookie = dmaengine_submit(desc);
	ret = dma_submit_error(up->rx_cookie);
	if (!ret)
		dma_async_issue_pending(up->rx_chan);

	return ret;
}

static int nuc980_dma_open_rx(struct nuc980_uart *up)
{
	struct dma_chan *chan = dma_request_chan(up->port.dev, "rx");
	int ret;

	if (IS_ERR(chan))
		return PTR_ERR(chan);

	up->rx_ring = dma_alloc_coherent(chan->device->dev, NUC980_RX_RING,
					 &up->rx_ring_dma, GFP_KERNEL);
	if (!up->rx_ring) {
		ret = -ENOMEM;
		goto release;
	}
	up->rx_chan = chan;
	ret = nuc980_dma_start_rx(up);
	if (!ret)
		return 0;

	up->rx_chan = NULL;
	dma_free_coherent(chan->device->dev, NUC980_RX_RING, up->rx_ring,
			  up->rx_ring_dma);
release:
	dma_release_channel(chan);
	return ret;
}

static int nuc980_dma_open_tx(struct nuc980_uart *up)
{
	struct dma_chan *chan = dma_request_chan(up->port.dev, "tx");
	int ret;

	if (IS_ERR(chan))
		return PTR_ERR(chan);

	up->tx_dma = dma_map_single(chan->device->dev, up->port.state->xmit.buf,
				    UART_XMIT_SIZE, DMA_TO_DEVICE);
	ret = dma_mapping_error(chan->device->dev, up->tx_dma);
	if (ret)
		goto release;

	up->tx_chan = chan;
	ret = nuc980_dma_config_tx(up);
	if (!ret)
		return 0;

	up->tx_chan = NULL;
	dma_unmap_single(chan->device->dev, up->tx_dma, UART_XMIT_SIZE, DMA_TO_DEVICE);
release:
	dma_release_channel(chan);
	return ret;
}

static void nuc980_dma_close_tx(struct nuc980_uart *up)
{
	dmaengine_terminate_sync(up->tx_chan);
	dma_unmap_single(up->tx_chan->device->dev, up->tx_dma, UART_XMIT_SIZE,
			 DMA_TO_DEVICE);
	dma_release_channel(up->tx_chan);
	up->tx_chan = NULL;
	up->tx_len = 0;
}

static void nuc980_dma_close_rx(struct nuc980_uart *up)
{
	dmaengine_terminate_sync(up->rx_chan);
	dma_free_coherent(up->rx_chan->device->dev, NUC980_RX_RING, up->rx_ring,
			  up->rx_ring_dma);
	dma_release_channel(up->rx_chan);
	up->rx_chan = NULL;
}

static void nuc980_dma_open(struct nuc980_uart *up)
{
	int ret = nuc980_dma_open_tx(up);

	if (!ret) {
		ret = nuc980_dma_open_rx(up);
		if (ret)
			nuc980_dma_close_tx(up);
	}
	if (ret) {
		dev_warn(up->port.dev, "no PDMA (%pe), interrupts instead\n",
			 ERR_PTR(ret));
		up->pdma = false;
	}
}

static void nuc980_dma_close(struct nuc980_uart *up)
{
	if (up->rx_chan) {
		nuc980_dma_close_rx(up);
		nuc980_dma_close_tx(up);
	}
}

/* Interrupts */

static void nuc980_modem_status(struct uart_port *port)
{
	u32 msr = nuc980_read(port, NUC980_MSR);

	nuc980_write(port, NUC980_MSR, NUC980_MSR_CTS_LOW | NUC980_MSR_CTS_CHANGED);
	uart_handle_cts_change(port, !(msr & NUC980_MSR_CTS_LEVEL));
	wake_up_interruptible(&port->state->port.delta_msr_wait);
}

static irqreturn_t nuc980_irq(int irq, void *arg)
{
	struct uart_port *port = arg;
	struct nuc980_uart *up = to_nuc980_uart(port);
	unsigned long flags;
	u32 isr;

	uart_port_lock_irqsave(port, &flags);
	isr = nuc980_read(port, NUC980_ISR);
	isr = ((isr >> 8 | isr >> 24) & GENMASK(5, 0)) | (isr >> 8 & NUC980_INT_TX_END);

	if (isr & (NUC980_INT_RX_CHARS | NUC980_INT_RX_ERRORS)) {
		if (up->rx_chan)
			nuc980_dma_rx(port);
		else
			nuc980_rx_chars(port);
	}
	if (isr & NUC980_INT_MODEM)
		nuc980_modem_status(port);
	if (isr & NUC980_INT_TX)
		port->ops->start_tx(port);
	if (isr & NUC980_INT_TX_END)
		nuc980_rts_end(port);
	uart_unlock_and_check_sysrq_irqrestore(port, flags);

	return IRQ_RETVAL(isr);
}

/* A port's operations */

static unsigned int nuc980_tx_empty(struct uart_port *port)
{
	struct nuc980_uart *up = to_nuc980_uart(port);

	if (up->tx_len || up->rts != NUC980_RTS_OFF)
		return 0;

	return nuc980_read(port, NUC980_FSR) & NUC980_FSR_TX_DONE ? TIOCSER_TEMT : 0;
}

static unsigned int nuc980_get_mctrl(struct uart_port *port)
{
	u32 msr = nuc980_read(port, NUC980_MSR);

	return TIOCM_CAR | TIOCM_DSR | (msr & NUC980_MSR_CTS_LEVEL ? 0 : TIOCM_CTS);
}

/* Not called in RS-485 mode */
static void nuc980_set_mctrl(struct uart_port *port, unsigned int mctrl)
{
	bool on = mctrl & TIOCM_RTS;

	nuc980_write(port, NUC980_MCR,
		     NUC980_MCR_RTS_LOW | (on ? 0 : NUC980_MCR_RTS_OFF));
	nuc980_update(port, NUC980_IER, NUC980_IER_AUTO_RTS,
		      on && port->status & UPSTAT_AUTORTS ? NUC980_IER_AUTO_RTS : 0);
}

static void nuc980_send(struct uart_port *port)
{
	if (to_nuc980_uart(port)->tx_chan)
		nuc980_dma_start_tx(port);
	else
		nuc980_tx_chars(port);
}

static void nuc980_start_tx(struct uart_port *port)
{
	if (!nuc980_rts_is_ours(port) || nuc980_rts_begin(port))
		nuc980_send(port);
}

static void nuc980_stop_tx(struct uart_port *port)
{
	nuc980_update(port, NUC980_IER, NUC980_IER_TX_PDMA, 0);
	nuc980_tx_all_given(port);
}

static u32 nuc980_rx_enables(struct uart_port *port)
{
	return NUC980_INT_RX_ERRORS | (to_nuc980_uart(port)->rx_chan ?
		NUC980_IER_RX_PDMA : NUC980_INT_RX_CHARS | NUC980_IER_TIMEOUT);
}

static void nuc980_stop_rx(struct uart_port *port)
{
	nuc980_update(port, NUC980_IER, nuc980_rx_enables(port), 0);
}

/* The FIFO fills up, and automatic RTS tells the far end. */
static void nuc980_throttle(struct uart_port *port)
{
	unsigned long flags;

	uart_port_lock_irqsave(port, &flags);
	nuc980_stop_rx(port);
	uart_port_unlock_irqrestore(port, flags);
}

static void nuc980_unthrottle(struct uart_port *port)
{
	unsigned long flags;

	uart_port_lock_irqsave(port, &flags);
	nuc980_update(port, NUC980_IER, 0, nuc980_rx_enables(port));
	uart_port_unlock_irqrestore(port, flags);
}

static void nuc980_enable_ms(struct uart_port *port)
{
	nuc980_update(port, NUC980_IER, 0, NUC980_INT_MODEM);
}

static void nuc980_break_ctl(struct uart_port *port, int on)
{
	unsigned long flags;

	uart_port_lock_irqsave(port, &flags);
	nuc980_update(port, NUC980_LCR, NUC980_LCR_BREAK, on ? NUC980_LCR_BREAK : 0);
	uart_port_unlock_irqrestore(port, flags);
}

/* The core has emptied the buffer. */
static void nuc980_flush_buffer(struct uart_port *port)
{
	struct nuc980_uart *up = to_nuc980_uart(port);

	if (up->tx_chan) {
		dmaengine_terminate_async(up->tx_chan);
		up->tx_len = 0;
		nuc980_tx_all_given(port);
	}
}

/* FUNC, ALT and MCR stay as they are: RS-485 outlives close and open. */
static int nuc980_startup(struct uart_port *port)
{
	struct nuc980_uart *up = to_nuc980_uart(port);
	unsigned int trigger;
	unsigned long flags;
	int ret;

	if (up->pdma && !uart_console(port))
		nuc980_dma_open(up);

	trigger = up->rx_chan ? NUC980_TRIGGER_1 : NUC980_TRIGGER_8;
	nuc980_write(port, NUC980_IER, 0);
	nuc980_write(port, NUC980_FCR, NUC980_FCR_RX_RESET |
		     FIELD_PREP(NUC980_FCR_RX_TRIGGER, trigger) |
		     FIELD_PREP(NUC980_FCR_RTS_TRIGGER, NUC980_TRIGGER_8));
	nuc980_write(port, NUC980_FSR, NUC980_RX_ERRORS);

	/*
	 * A thread by our own wish: one that PREEMPT_RT makes of a handler runs
	 * with bottom halves disabled, and would wait for the network's.
	 */
	ret = request_threaded_irq(port->irq, NULL, nuc980_irq, IRQF_ONESHOT,
				   port->name, port);
	if (ret) {
		nuc980_dma_close(up);
		return ret;
	}

	uart_port_lock_irqsave(port, &flags);
	nuc980_update(port, NUC980_IER, 0, nuc980_rx_enables(port));
	uart_port_unlock_irqrestore(port, flags);

	return 0;
}

static void nuc980_shutdown(struct uart_port *port)
{
	struct nuc980_uart *up = to_nuc980_uart(port);

	free_irq(port->irq, port);
	hrtimer_cancel(&up->rts_timer);
	if (up->rts != NUC980_RTS_OFF)
		nuc980_rts_off(port);
	nuc980_dma_close(up);
	nuc980_write(port, NUC980_IER, 0);
	nuc980_update(port, NUC980_LCR, NUC980_LCR_BREAK, 0);
}

/* The divider that comes nearest, and the speed that it gives */
static u32 nuc980_baud_divider(struct uart_port *port, unsigned int *baud)
{
	unsigned int divider = DIV_ROUND_CLOSEST(port->uartclk, *baud);

	if (divider <= NUC980_DIVIDER_MAX) {
		*baud = DIV_ROUND_CLOSEST(port->uartclk, divider);
		return NUC980_BAUD_MODE2 | (divider - 2);
	}

	divider = DIV_ROUND_CLOSEST(port->uartclk, 16 * *baud);
	*baud = DIV_ROUND_CLOSEST(port->uartclk, 16 * divider);

	return divider - 2;
}

static u32 nuc980_line_control(const struct ktermios *termios)
{
	tcflag_t cflag = termios->c_cflag;
	u32 lcr = FIELD_PREP(NUC980_LCR_WORD, tty_get_char_size(cflag) - 5);

	if (cflag & CSTOPB)
		lcr |= NUC980_LCR_STOP2;
	if (cflag & PARENB)
		lcr |= NUC980_LCR_PARITY;
	if (!(cflag & PARODD))
		lcr |= NUC980_LCR_EVEN;
	if (cflag & CMSPAR)
		lcr |= NUC980_LCR_STICK;

	return lcr;
}

static void nuc980_set_status_masks(struct uart_port *port, const struct ktermios *termios)
{
	tcflag_t iflag = termios->c_iflag;

	port->read_status_mask = NUC980_FSR_OVERRUN;
	if (iflag & INPCK)
		port->read_status_mask |= NUC980_FSR_FRAMING | NUC980_FSR_PARITY;
	if (iflag & (IGNBRK | BRKINT | PARMRK))
		port->read_status_mask |= NUC980_FSR_BREAK;

	port->ignore_status_mask = 0;
	if (iflag & IGNPAR)
		port->ignore_status_mask |= NUC980_FSR_FRAMING | NUC980_FSR_PARITY;
	if (iflag & IGNBRK) {
		port->ignore_status_mask |= NUC980_FSR_BREAK;
		if (iflag & IGNPAR)
			port->ignore_status_mask |= NUC980_FSR_OVERRUN;
	}
	if (!(termios->c_cflag & CREAD))
		port->ignore_status_mask |= NUC980_RX_ANY;
}

static void nuc980_set_flow_control(struct uart_port *port, bool on)
{
	u32 both = NUC980_IER_AUTO_RTS | NUC980_IER_AUTO_CTS, ier = 0;

	port->status &= ~(UPSTAT_AUTORTS | UPSTAT_AUTOCTS);
	if (on) {
		port->status |= UPSTAT_AUTORTS | UPSTAT_AUTOCTS;
		ier = NUC980_IER_AUTO_CTS;
		if (port->mctrl & TIOCM_RTS)
			ier |= NUC980_IER_AUTO_RTS;
	}
	nuc980_update(port, NUC980_IER, both, ier);
}

static void nuc980_set_termios(struct uart_port *port, struct ktermios *termios,
			       const struct ktermios *old)
{
	struct nuc980_uart *up = to_nuc980_uart(port);
	unsigned int baud, bits;
	unsigned long flags;
	u32 divider;

	/* RTS is the direction. */
	if (port->rs485.flags & SER_RS485_ENABLED)
		termios->c_cflag &= ~CRTSCTS;

	baud = uart_get_baud_rate(port, termios, old,
				  DIV_ROUND_UP(port->uartclk, 16 * NUC980_DIVIDER_MAX),
				  port->uartclk / NUC980_DIVIDER_MIN);
	divider = nuc980_baud_divider(port, &baud);
	bits = NUC980_TIMEOUT_CHARS * tty_get_frame_size(termios->c_cflag);

	uart_port_lock_irqsave(port, &flags);
	uart_update_timeout(port, termios->c_cflag, baud);
	nuc980_set_status_masks(port, termios);
	nuc980_write(port, NUC980_BAUD, divider);
	nuc980_update(port, NUC980_LCR, ~NUC980_LCR_BREAK, nuc980_line_control(termios));
	nuc980_write(port, NUC980_TOR, bits);
	nuc980_set_flow_control(port, termios->c_cflag & CRTSCTS);
	if (UART_ENABLE_MS(port, termios->c_cflag))
		nuc980_enable_ms(port);
	uart_port_unlock_irqrestore(port, flags);

	up->rx_timeout_ns = div_u64((u64)bits * NSEC_PER_SEC, baud);
	if (up->rx_chan)
		nuc980_dma_config_rx(up);

	if (tty_termios_baud_rate(termios))
		tty_termios_encode_baud_rate(termios, baud, baud);
}

static const char *nuc980_type(struct uart_port *port)
{
	return "NUC980";
}

static void nuc980_config_port(struct uart_port *port, int flags)
{
	if (flags & UART_CONFIG_TYPE)
		port->type = PORT_NUC980;
}

static int nuc980_verify_port(struct uart_port *port, struct serial_struct *ser)
{
	if (ser->type != PORT_UNKNOWN && ser->type != PORT_NUC980)
		return -EINVAL;
	if (ser->irq != port->irq)
		return -EINVAL;

	return 0;
}

static const struct uart_ops nuc980_ops = {
	.tx_empty = nuc980_tx_empty,
	.set_mctrl = nuc980_set_mctrl,
	.get_mctrl = nuc980_get_mctrl,
	.stop_tx = nuc980_stop_tx,
	.start_tx = nuc980_start_tx,
	.throttle = nuc980_throttle,
	.unthrottle = nuc980_unthrottle,
	.stop_rx = nuc980_stop_rx,
	.enable_ms = nuc980_enable_ms,
	.break_ctl = nuc980_break_ctl,
	.startup = nuc980_startup,
	.shutdown = nuc980_shutdown,
	.flush_buffer = nuc980_flush_buffer,
	.set_termios = nuc980_set_termios,
	.type = nuc980_type,
	.config_port = nuc980_config_port,
	.verify_port = nuc980_verify_port,
};

static const struct serial_rs485 nuc980_rs485_supported = {
	.flags = SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND | SER_RS485_RTS_AFTER_SEND,
	.delay_rts_before_send = 1,
	.delay_rts_after_send = 1,
};

static int nuc980_rs485_config(struct uart_port *port, struct ktermios *termios,
			       struct serial_rs485 *rs485)
{
	struct nuc980_uart *up = to_nuc980_uart(port);
	bool enabled = rs485->flags & SER_RS485_ENABLED;
	bool by_uart = enabled && !nuc980_rts_has_delay(rs485);

	if (enabled) {
		nuc980_set_flow_control(port, false);
		if (termios)
			termios->c_cflag &= ~CRTSCTS;
		nuc980_rts_set(port, rs485, by_uart || up->rts != NUC980_RTS_OFF);
	}
	/* Else the driver moves RTS, or the core. What waits to be sent is, after its delay. */
	if (!enabled || by_uart)
		up->rts = NUC980_RTS_OFF;
	nuc980_update(port, NUC980_ALT, NUC980_ALT_AUD, by_uart ? NUC980_ALT_AUD : 0);
	nuc980_write(port, NUC980_FUNC, by_uart ? NUC980_FUNC_RS485 : NUC980_FUNC_UART);

	return 0;
}

/* Console */

static struct uart_driver nuc980_uart_driver;

#ifdef CONFIG_SERIAL_NUC980_CONSOLE

/* Longer than a full FIFO at 2400 baud takes: a CTS that never comes must not hang. */
#define NUC980_CONSOLE_WAIT_US	100000

static void nuc980_console_wait(struct uart_port *port, u32 mask, u32 value)
{
	unsigned int us = 0;

	while ((nuc980_read(port, NUC980_FSR) & mask) != value &&
	       us++ < NUC980_CONSOLE_WAIT_US)
		udelay(1);
}

static void nuc980_console_putchar(struct uart_port *port, unsigned char ch)
{
	nuc980_console_wait(port, NUC980_FSR_TX_FULL, 0);
	nuc980_write(port, NUC980_DAT, ch);
}

/* Waits where an atomic writer may break in, writes where it may not. */
static void nuc980_console_putchar_sync(struct uart_port *port, unsigned char ch)
{
	unsigned long flags;

	nuc980_console_wait(port, NUC980_FSR_TX_FULL, 0);
	printk_cpu_sync_get_irqsave(flags);
	nuc980_console_putchar(port, ch);
	printk_cpu_sync_put_irqrestore(flags);
}

static void nuc980_console_write(struct console *co, const char *s, unsigned int count)
{
	struct nuc980_uart *up = nuc980_uarts[co->index];
	struct uart_port *port = &up->port;
	unsigned long flags;
	bool locked = true;

	if (oops_in_progress)
		locked = uart_port_trylock_irqsave(port, &flags);
	else
		uart_port_lock_irqsave(port, &flags);

	atomic_inc(&up->console_printing);
	uart_console_write(port, s, count, nuc980_console_putchar_sync);
	atomic_dec(&up->console_printing);
	nuc980_console_wait(port, NUC980_FSR_TX_DONE, NUC980_FSR_TX_DONE);

	if (locked)
		uart_port_unlock_irqrestore(port, flags);
}

/* The one processor has its interrupts off, so that nobody else is at the UART. */
static void nuc980_console_write_atomic(struct console *co, const char *s,
					unsigned int count)
{
	struct nuc980_uart *up = nuc980_uarts[co->index];
	struct uart_port *port = &up->port;
	unsigned long flags;

	printk_cpu_sync_get_irqsave(flags);
	if (atomic_fetch_inc(&up->console_printing))
		uart_console_write(port, "\n", 1, nuc980_console_putchar);
	uart_console_write(port, s, count, nuc980_console_putchar);
	atomic_dec(&up->console_printing);
	nuc980_console_wait(port, NUC980_FSR_TX_DONE, NUC980_FSR_TX_DONE);
	printk_cpu_sync_put_irqrestore(flags);
}

static int nuc980_console_setup(struct console *co, char *options)
{
	int baud = 115200, bits = 8, parity = 'n', flow = 'n';

	if (co->index < 0 || co->index >= NUC980_UARTS || !nuc980_uarts[co->index])
		return -ENODEV;

	if (options)
		uart_parse_options(options, &baud, &parity, &bits, &flow);

	return uart_set_options(&nuc980_uarts[co->index]->port, co, baud, parity, bits,
				flow);
}

static struct console nuc980_console = {
	.name = "ttyS",
	.write = nuc980_console_write,
	.write_atomic = nuc980_console_write_atomic,
	.device = uart_console_device,
	.setup = nuc980_console_setup,
	.flags = CON_PRINTBUFFER,
	.index = -1,
	.data = &nuc980_uart_driver,
};

#define NUC980_CONSOLE	(&nuc980_console)

/* The speed is as the boot loader left it. */
static void nuc980_earlycon_write(struct console *co, const char *s, unsigned int count)
{
	struct earlycon_device *device = co->data;

	uart_console_write(&device->port, s, count, nuc980_console_putchar);
	nuc980_console_wait(&device->port, NUC980_FSR_TX_DONE, NUC980_FSR_TX_DONE);
}

/* The vendor's U-Boot leaves every pin a GPIO; the pin controller comes too late. */
static void __init nuc980_earlycon_route_pins(resource_size_t uart)
{
	void __iomem *mfp;

	if (uart != NUC980_UART0)
		return;

	mfp = early_ioremap(NUC980_MFP_PF_HIGH, sizeof(u32));
	writel((readl(mfp) & ~NUC980_MFP_UART0_PINS) |
	       FIELD_PREP(NUC980_MFP_UART0_PINS, NUC980_MFP_UART0), mfp);
	early_iounmap(mfp, sizeof(u32));
}

static int __init nuc980_earlycon_setup(struct earlycon_device *device,
					const char *options)
{
	if (!device->port.membase)
		return -ENODEV;

	nuc980_earlycon_route_pins(device->port.mapbase);
	nuc980_write(&device->port, NUC980_LCR, NUC980_LCR_8N1);
	device->con->write = nuc980_earlycon_write;

	return 0;
}

OF_EARLYCON_DECLARE(nuc980, "nuvoton,nuc980-uart", nuc980_earlycon_setup);

#else
#define NUC980_CONSOLE	NULL
#endif /* CONFIG_SERIAL_NUC980_CONSOLE */

static struct uart_driver nuc980_uart_driver = {
	.owner = THIS_MODULE,
	.driver_name = "nuc980_serial",
	.dev_name = "ttyS",
	.major = TTY_MAJOR,
	.minor = 64,
	.nr = NUC980_UARTS,
	.cons = NUC980_CONSOLE,
};

static int nuc980_probe_port(struct platform_device *pdev, struct nuc980_uart *up)
{
	struct uart_port *port = &up->port;
	struct resource *res;
	struct clk *clk;

	port->membase = devm_platform_get_and_ioremap_resource(pdev, 0, &res);
	if (IS_ERR(port->membase))
		return PTR_ERR(port->membase);
	port->mapbase = res->start;
	port->irq = platform_get_irq(pdev, 0);
	if ((int)port->irq < 0)
		return port->irq;
	clk = devm_clk_get_enabled(&pdev->dev, NULL);
	if (IS_ERR(clk))
		return dev_err_probe(&pdev->dev, PTR_ERR(clk), "no clock\n");
	port->uartclk = clk_get_rate(clk);

	port->dev = &pdev->dev;
	port->iotype = UPIO_MEM32;
	port->flags = UPF_BOOT_AUTOCONF;
	port->fifosize = NUC980_FIFO;
	port->ops = &nuc980_ops;
	port->has_sysrq = IS_ENABLED(CONFIG_SERIAL_NUC980_CONSOLE);
	port->rs485_config = nuc980_rs485_config;
	port->rs485_supported = nuc980_rs485_supported;
	hrtimer_init(&up->rts_timer, CLOCK_MONOTONIC, HRTIMER_MODE_REL);
	up->rts_timer.function = nuc980_rts_timeout;

	return uart_get_rs485_mode(port);
}

static int nuc980_probe(struct platform_device *pdev)
{
	struct nuc980_uart *up;
	u32 line, pdma = 0;
	int ret;

	ret = of_property_read_u32(pdev->dev.of_node, "port-number", &line);
	if (ret || line >= NUC980_UARTS || nuc980_uarts[line])
		return dev_err_probe(&pdev->dev, -EINVAL,
				     "port-number missing, taken or over 9\n");

	up = devm_kzalloc(&pdev->dev, sizeof(*up), GFP_KERNEL);
	if (!up)
		return -ENOMEM;

	of_property_read_u32(pdev->dev.of_node, "pdma-enable", &pdma);
	up->pdma = pdma;
	up->port.line = line;
	ret = nuc980_probe_port(pdev, up);
	if (ret)
		return ret;

	nuc980_write(&up->port, NUC980_IER, 0);
	nuc980_write(&up->port, NUC980_FUNC, NUC980_FUNC_UART);
	nuc980_write(&up->port, NUC980_MSR, NUC980_MSR_CTS_LOW);

	platform_set_drvdata(pdev, up);
	nuc980_uarts[line] = up;
	ret = uart_add_one_port(&nuc980_uart_driver, &up->port);
	if (ret)
		nuc980_uarts[line] = NULL;

	return ret;
}

static int nuc980_remove(struct platform_device *pdev)
{
	struct nuc980_uart *up = platform_get_drvdata(pdev);

	uart_remove_one_port(&nuc980_uart_driver, &up->port);
	nuc980_uarts[up->port.line] = NULL;

	return 0;
}

static const struct of_device_id nuc980_serial_of_match[] = {
	{ .compatible = "nuvoton,nuc980-uart" },
	{ }
};
MODULE_DEVICE_TABLE(of, nuc980_serial_of_match);

static struct platform_driver nuc980_serial_driver = {
	.probe = nuc980_probe,
	.remove = nuc980_remove,
	.driver = {
		.name = "nuc980-uart",
		.of_match_table = nuc980_serial_of_match,
	},
};

static int __init nuc980_serial_init(void)
{
	int ret = uart_register_driver(&nuc980_uart_driver);

	if (ret)
		return ret;

	ret = platform_driver_register(&nuc980_serial_driver);
	if (ret)
		uart_unregister_driver(&nuc980_uart_driver);

	return ret;
}

/* One of them is the console: the sooner the better. */
arch_initcall(nuc980_serial_init);

static void __exit nuc980_serial_exit(void)
{
	platform_driver_unregister(&nuc980_serial_driver);
	uart_unregister_driver(&nuc980_uart_driver);
}
module_exit(nuc980_serial_exit);

MODULE_DESCRIPTION("Nuvoton NUC980 UART driver");
MODULE_AUTHOR("The OpenRTU authors");
MODULE_LICENSE("GPL");
