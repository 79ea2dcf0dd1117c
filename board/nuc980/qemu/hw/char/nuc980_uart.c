/*
 * Nuvoton NUC980 UART
 *
 * Registers and bits are named as in Nuvoton's BSP for the chip (uart.h),
 * which has no text on them; what they do is as the vendor's Linux driver and
 * BSP use them and, where "sibling" is said, as the header of Nuvoton's M480
 * describes the same names. There is no public manual.
 *
 * Not modelled: LIN, IrDA, automatic baud rate, parity by software (PSS),
 * inverted lines, wake-up.
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "chardev/char-serial.h"
#include "hw/char/nuc980_uart.h"
#include "hw/core/cpu.h"
#include "hw/irq.h"
#include "hw/misc/nuc980_unimp.h"
#include "hw/qdev-clock.h"
#include "hw/qdev-properties.h"
#include "hw/qdev-properties-system.h"
#include "hw/registerfields.h"
#include "migration/vmstate.h"
#include "qemu/log.h"
#include "qemu/main-loop.h"
#include "sysemu/cpu-timers.h"
#include "trace.h"

REG32(DAT, 0x00)
REG32(INTEN, 0x04)
    FIELD(INTEN, WKIEN, 6, 1)
    FIELD(INTEN, LINIEN, 8, 1)
    FIELD(INTEN, TOCNTEN, 11, 1)
    FIELD(INTEN, ATORTSEN, 12, 1)
    FIELD(INTEN, ATOCTSEN, 13, 1)
    FIELD(INTEN, TXPDMAEN, 14, 1)
    FIELD(INTEN, RXPDMAEN, 15, 1)
    FIELD(INTEN, ABRIEN, 18, 1)
    FIELD(INTEN, TXENDIEN, 22, 1)
REG32(FIFO, 0x08)
    FIELD(FIFO, RXRST, 1, 1)
    FIELD(FIFO, TXRST, 2, 1)
    FIELD(FIFO, RFITL, 4, 4)
    FIELD(FIFO, RXOFF, 8, 1)
    FIELD(FIFO, RTSTRGLV, 16, 4)
REG32(LINE, 0x0c)
    FIELD(LINE, WLS, 0, 2)
    FIELD(LINE, NSB, 2, 1)
    FIELD(LINE, PBE, 3, 1)
    FIELD(LINE, EPE, 4, 1)
    FIELD(LINE, BCB, 6, 1)
    FIELD(LINE, PSS, 7, 1)
    FIELD(LINE, TXDINV, 8, 1)
    FIELD(LINE, RXDINV, 9, 1)
REG32(MODEM, 0x10)
    FIELD(MODEM, RTS, 1, 1)
    FIELD(MODEM, RTSACTLV, 9, 1)
    FIELD(MODEM, RTSSTS, 13, 1)
REG32(MODEMSTS, 0x14)
    FIELD(MODEMSTS, CTSDETF, 0, 1)
    FIELD(MODEMSTS, CTSSTS, 4, 1)
    FIELD(MODEMSTS, CTSACTLV, 8, 1)
REG32(FIFOSTS, 0x18)
    FIELD(FIFOSTS, RXOVIF, 0, 1)
    FIELD(FIFOSTS, ABRDIF, 1, 1)
    FIELD(FIFOSTS, ABRDTOIF, 2, 1)
    FIELD(FIFOSTS, ADDRDETF, 3, 1)
    FIELD(FIFOSTS, PEF, 4, 1)
    FIELD(FIFOSTS, FEF, 5, 1)
    FIELD(FIFOSTS, BIF, 6, 1)
    FIELD(FIFOSTS, RXPTR, 8, 6)
    FIELD(FIFOSTS, RXEMPTY, 14, 1)
    FIELD(FIFOSTS, RXFULL, 15, 1)
    FIELD(FIFOSTS, TXPTR, 16, 6)
    FIELD(FIFOSTS, TXEMPTY, 22, 1)
    FIELD(FIFOSTS, TXFULL, 23, 1)
    FIELD(FIFOSTS, TXOVIF, 24, 1)
    FIELD(FIFOSTS, TXEMPTYF, 28, 1)
    FIELD(FIFOSTS, RXIDLE, 29, 1)
    FIELD(FIFOSTS, TXRXACT, 31, 1)
REG32(INTSTS, 0x1c)
    FIELD(INTSTS, RDAIF, 0, 1)
    FIELD(INTSTS, THREIF, 1, 1)
    FIELD(INTSTS, RLSIF, 2, 1)
    FIELD(INTSTS, MODEMIF, 3, 1)
    FIELD(INTSTS, RXTOIF, 4, 1)
    FIELD(INTSTS, BUFERRIF, 5, 1)
    FIELD(INTSTS, TXENDIF, 22, 1)
REG32(TOUT, 0x20)
    FIELD(TOUT, TOIC, 0, 8)
    FIELD(TOUT, DLY, 8, 8)
REG32(BAUD, 0x24)
    FIELD(BAUD, BRD, 0, 16)
    FIELD(BAUD, EDIVM1, 24, 4)
    FIELD(BAUD, BAUDM0, 28, 1)
    FIELD(BAUD, BAUDM1, 29, 1)
REG32(IRDA, 0x28)
REG32(ALTCTL, 0x2c)
    FIELD(ALTCTL, LINRXEN, 6, 1)
    FIELD(ALTCTL, LINTXEN, 7, 1)
    FIELD(ALTCTL, RS485NMM, 8, 1)
    FIELD(ALTCTL, RS485AAD, 9, 1)
    FIELD(ALTCTL, RS485AUD, 10, 1)
    FIELD(ALTCTL, ADDRDEN, 15, 1)
    FIELD(ALTCTL, ABRDEN, 18, 1)
    FIELD(ALTCTL, ADDRMV, 24, 8)
REG32(FUNCSEL, 0x30)
    FIELD(FUNCSEL, FUNCSEL, 0, 2)
    FIELD(FUNCSEL, TXRXDIS, 3, 1)
REG32(LINCTL, 0x34)
REG32(LINSTS, 0x38)
REG32(BRCOMP, 0x3c)
REG32(WKCTL, 0x40)
REG32(WKSTS, 0x44)
REG32(DWKCOMP, 0x48)

enum {
    FUNC_UART = 0,
    FUNC_RS485 = 3,
};

/* INTSTS: RDA, THRE, RLS, MODEM, RXTO, BUFERR; 8 bits up the same, enabled */
#define INT_FLAGS       0x3f
#define INT_SHIFT       8
/* Of these RLS, MODEM, RXTO, BUFERR again for DMA mode, 16 bits up */
#define INT_DMA_FLAGS   0x3c
#define INT_DMA_SHIFT   16

#define RX_ERRORS \
    (R_FIFOSTS_BIF_MASK | R_FIFOSTS_FEF_MASK | R_FIFOSTS_PEF_MASK)
#define OVERRUNS        (R_FIFOSTS_RXOVIF_MASK | R_FIFOSTS_TXOVIF_MASK)
#define FIFOSTS_W1C \
    (RX_ERRORS | OVERRUNS | R_FIFOSTS_ADDRDETF_MASK | R_FIFOSTS_ABRDIF_MASK | \
     R_FIFOSTS_ABRDTOIF_MASK)

#define WIRE_BREAK      0x100   /* on the wire: a break, not a character */

#define GET(s, reg, field) FIELD_EX32((s)->regs[R_##reg], reg, field)

static int64_t uart_now(void)
{
    return qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL);
}

/* Time */

static unsigned uart_divider(NUC980UARTState *s)
{
    unsigned brd = GET(s, BAUD, BRD) + 2;

    if (!GET(s, BAUD, BAUDM1)) {
        return 16 * brd;
    }
    /* guess: mode 1, which neither the driver nor the BSP uses */
    return GET(s, BAUD, BAUDM0) ? brd : (GET(s, BAUD, EDIVM1) + 1) * brd;
}

static int64_t uart_half_bits_ns(NUC980UARTState *s, unsigned half_bits)
{
    return clock_ticks_to_ns(s->clk,
                             (uint64_t)half_bits * uart_divider(s) / 2);
}

static int64_t uart_bits_ns(NUC980UARTState *s, unsigned bits)
{
    return uart_half_bits_ns(s, 2 * bits);
}

static unsigned uart_word_bits(NUC980UARTState *s)
{
    return 5 + GET(s, LINE, WLS);
}

/* Start bit, data, parity, stop bits; a word of 5 bits has 1.5, not 2 */
static int64_t uart_char_ns(NUC980UARTState *s)
{
    unsigned word = uart_word_bits(s);
    unsigned half_stops = !GET(s, LINE, NSB) ? 2 : word == 5 ? 3 : 4;

    return uart_half_bits_ns(s, 2 * (1 + word + GET(s, LINE, PBE)) +
                                half_stops);
}

/*
 * When the character after the one that was due at 'due' begins. A timer that
 * ran late does not slow the line down, but what one character's time cannot
 * make good is lost: no burst overruns a guest that had no chance to read.
 */
static int64_t uart_follow(NUC980UARTState *s, int64_t due)
{
    return MAX(due, uart_now() - uart_char_ns(s));
}

/* A stopped clock stops the line */
static void uart_begin_char(NUC980UARTState *s, QEMUTimer *timer, int64_t *due,
                            int64_t from)
{
    if (clock_is_enabled(s->clk)) {
        *due = from + uart_char_ns(s);
        timer_mod(timer, *due);
    } else {
        timer_del(timer);
    }
}

/* Outputs */

static bool uart_is_rs485(NUC980UARTState *s)
{
    return GET(s, FUNCSEL, FUNCSEL) == FUNC_RS485;
}

static unsigned uart_trigger(unsigned code)
{
    static const uint8_t level[] = { 1, 4, 8, 14 };

    return level[MIN(code, ARRAY_SIZE(level) - 1)];
}

static bool uart_sent_all(NUC980UARTState *s)
{
    return fifo8_is_empty(&s->tx) && !s->tx_busy;
}

static bool uart_auto_rts(NUC980UARTState *s)
{
    return GET(s, FUNCSEL, FUNCSEL) == FUNC_UART && GET(s, INTEN, ATORTSEN);
}

static bool uart_rx_has_room(NUC980UARTState *s)
{
    return fifo8_num_used(&s->rx) < uart_trigger(GET(s, FIFO, RTSTRGLV));
}

static bool uart_rts_level(NUC980UARTState *s)
{
    bool active;

    if (uart_is_rs485(s) && GET(s, ALTCTL, RS485AUD)) {
        active = !uart_sent_all(s);
    } else if (uart_auto_rts(s)) {
        active = uart_rx_has_room(s);
    } else {
        active = !GET(s, MODEM, RTS);
    }
    return active != GET(s, MODEM, RTSACTLV);
}

static bool uart_cts_active(NUC980UARTState *s)
{
    return GET(s, MODEMSTS, CTSSTS) != GET(s, MODEMSTS, CTSACTLV);
}

static uint32_t uart_fifosts(NUC980UARTState *s)
{
    uint32_t rx = fifo8_num_used(&s->rx), tx = fifo8_num_used(&s->tx);
    bool rx_idle = !timer_pending(s->rx_timer);
    uint32_t value = s->regs[R_FIFOSTS];

    /* Sibling: the pointers count to 15, and are 0 again when full */
    value = FIELD_DP32(value, FIFOSTS, RXPTR, rx % NUC980_UART_FIFO);
    value = FIELD_DP32(value, FIFOSTS, RXEMPTY, rx == 0);
    value = FIELD_DP32(value, FIFOSTS, RXFULL, rx == NUC980_UART_FIFO);
    value = FIELD_DP32(value, FIFOSTS, TXPTR, tx % NUC980_UART_FIFO);
    value = FIELD_DP32(value, FIFOSTS, TXEMPTY, tx == 0);
    value = FIELD_DP32(value, FIFOSTS, TXFULL, tx == NUC980_UART_FIFO);
    value = FIELD_DP32(value, FIFOSTS, TXEMPTYF, uart_sent_all(s));
    value = FIELD_DP32(value, FIFOSTS, RXIDLE, rx_idle);
    return FIELD_DP32(value, FIFOSTS, TXRXACT,
                      !(GET(s, FUNCSEL, TXRXDIS) && rx_idle && !s->tx_busy));
}

static uint32_t uart_intsts(NUC980UARTState *s)
{
    uint32_t line = RX_ERRORS, flags = 0, dma, value;

    if (uart_is_rs485(s)) {
        line |= R_FIFOSTS_ADDRDETF_MASK;
    }
    flags = FIELD_DP32(flags, INTSTS, RDAIF, fifo8_num_used(&s->rx) >=
                       uart_trigger(GET(s, FIFO, RFITL)));
    flags = FIELD_DP32(flags, INTSTS, THREIF, fifo8_is_empty(&s->tx));
    flags = FIELD_DP32(flags, INTSTS, RLSIF, !!(s->regs[R_FIFOSTS] & line));
    flags = FIELD_DP32(flags, INTSTS, MODEMIF, GET(s, MODEMSTS, CTSDETF));
    flags = FIELD_DP32(flags, INTSTS, RXTOIF, s->timed_out);
    flags = FIELD_DP32(flags, INTSTS, BUFERRIF,
                       !!(s->regs[R_FIFOSTS] & OVERRUNS));

    /* guess: in DMA mode, of either side, both sets of flags show */
    dma = GET(s, INTEN, TXPDMAEN) || GET(s, INTEN, RXPDMAEN) ?
          (flags & INT_DMA_FLAGS) << INT_DMA_SHIFT : 0;
    value = flags | dma;
    value |= ((flags & s->regs[R_INTEN]) |
              (dma & s->regs[R_INTEN] << INT_DMA_SHIFT)) << INT_SHIFT;
    value = FIELD_DP32(value, INTSTS, TXENDIF, uart_sent_all(s));
    if (uart_sent_all(s) && GET(s, INTEN, TXENDIEN)) {
        value |= R_INTSTS_TXENDIF_MASK << INT_SHIFT;
    }
    return value;
}

static void uart_update(NUC980UARTState *s)
{
    uint32_t asked = INT_FLAGS | R_INTSTS_TXENDIF_MASK;

    qemu_set_irq(s->irq, !!(uart_intsts(s) & asked << INT_SHIFT));
    qemu_set_irq(s->tx_dma,
                 GET(s, INTEN, TXPDMAEN) && !fifo8_is_full(&s->tx));
    qemu_set_irq(s->rx_dma,
                 GET(s, INTEN, RXPDMAEN) && !fifo8_is_empty(&s->rx));
}

/* Sending */

static const char *uart_off_line(NUC980UARTState *s)
{
    if (!s->txd_pin) {
        return "no pin is switched to TXD";
    }
    if (GET(s, LINE, BCB)) {
        return "a break holds the line";
    }
    if (s->de_on_rts && !(s->rts_pin && uart_rts_level(s))) {
        return "RTS does not enable the RS-485 driver";
    }
    return NULL;
}

static bool uart_may_send(NUC980UARTState *s)
{
    bool waits = GET(s, INTEN, ATOCTSEN) &&
                 GET(s, FUNCSEL, FUNCSEL) == FUNC_UART && !uart_cts_active(s);

    return !waits && !GET(s, FUNCSEL, TXRXDIS);
}

static gboolean uart_tx_room(void *do_not_use, GIOCondition cond, void *opaque)
{
    NUC980UARTState *s = opaque;

    s->tx_watch = 0;
    timer_mod(s->tx_timer, uart_now());
    return G_SOURCE_REMOVE;
}

/* Hands the character on; false if the chardev takes it only later */
static bool uart_tx_finish(NUC980UARTState *s)
{
    const char *why = uart_off_line(s);

    if (why || !s->tx_whole) {
        trace_nuc980_uart_tx_lost(s->name, s->tx_char,
                                  why ?: "its start was");
    } else if (qemu_chr_fe_write(&s->chr, &s->tx_char, 1) < 1) {
        s->tx_watch = qemu_chr_fe_add_watch(&s->chr, G_IO_OUT | G_IO_HUP,
                                            uart_tx_room, s);
        if (s->tx_watch) {
            return false;
        }
        trace_nuc980_uart_tx_lost(s->name, s->tx_char, "no chardev");
    } else {
        trace_nuc980_uart_tx(s->name, s->tx_char);
    }
    s->tx_busy = false;
    return true;
}

static void uart_tx_start(NUC980UARTState *s, int64_t from)
{
    while (!s->tx_busy && !fifo8_is_empty(&s->tx) && uart_may_send(s)) {
        s->tx_char = fifo8_pop(&s->tx) & MAKE_64BIT_MASK(0, uart_word_bits(s));
        s->tx_busy = true;
        s->tx_whole = !uart_off_line(s);
        if (s->pace) {
            uart_begin_char(s, s->tx_timer, &s->tx_due, from);
        } else {
            uart_tx_finish(s);
        }
    }
}

static void uart_tx_end(void *opaque)
{
    NUC980UARTState *s = opaque;

    if (uart_tx_finish(s)) {
        uart_tx_start(s, uart_follow(s, s->tx_due) +
                         uart_bits_ns(s, GET(s, TOUT, DLY)));
        uart_update(s);
    }
}

static void uart_drop_watch(NUC980UARTState *s)
{
    if (s->tx_watch) {
        g_source_remove(s->tx_watch);
        s->tx_watch = 0;
    }
}

/* Receiving */

static void uart_restart_timeout(NUC980UARTState *s)
{
    unsigned bits = MAX(GET(s, TOUT, TOIC), 1);     /* guess: 0 is as 1 */

    if (GET(s, INTEN, TOCNTEN) && !fifo8_is_empty(&s->rx) &&
        clock_is_enabled(s->clk)) {
        timer_mod(s->timeout, uart_now() + uart_bits_ns(s, bits));
    } else {
        timer_del(s->timeout);
    }
}

static void uart_rx_timeout(void *opaque)
{
    NUC980UARTState *s = opaque;

    trace_nuc980_uart_timeout(s->name, fifo8_num_used(&s->rx));
    s->timed_out = true;
    uart_update(s);
}

static bool uart_take(uint32_t *count)
{
    if (*count == 0) {
        return false;
    }
    --*count;
    return true;
}

/*
 * RS-485 multidrop: a set ninth bit, where else parity is, makes an address.
 * NMM: the guest switches the receiver off by RXOFF, the next address
 * switches it on again (sibling). AAD: only what follows ADDRMV is received.
 */
static bool uart_rs485_takes(NUC980UARTState *s, uint8_t c, bool address)
{
    if (address) {
        if (GET(s, ALTCTL, ADDRDEN)) {
            s->regs[R_FIFOSTS] |= R_FIFOSTS_ADDRDETF_MASK;
        }
        s->regs[R_FIFO] &= ~R_FIFO_RXOFF_MASK;
        s->addressed = c == GET(s, ALTCTL, ADDRMV);
    }
    return GET(s, ALTCTL, RS485AAD) ? s->addressed : !GET(s, FIFO, RXOFF);
}

static bool uart_is_multidrop(NUC980UARTState *s)
{
    return uart_is_rs485(s) &&
           (GET(s, ALTCTL, RS485NMM) || GET(s, ALTCTL, RS485AAD));
}

/* What a disturbed line makes of a character, and what the receiver sees */
static uint8_t uart_disturb(NUC980UARTState *s, uint16_t c)
{
    if (uart_take(&s->inject_break) || c == WIRE_BREAK) {
        /* guess: a break is no framing error besides */
        s->regs[R_FIFOSTS] |= R_FIFOSTS_BIF_MASK;
        return 0;
    }
    if (uart_take(&s->inject_parity)) {
        c ^= 1;
        if (GET(s, LINE, PBE) && !uart_is_multidrop(s)) {
            s->regs[R_FIFOSTS] |= R_FIFOSTS_PEF_MASK;
        }
    }
    if (uart_take(&s->inject_framing)) {
        c <<= 1;                /* sampled one bit early */
        s->regs[R_FIFOSTS] |= R_FIFOSTS_FEF_MASK;
    }
    return c & MAKE_64BIT_MASK(0, uart_word_bits(s));
}

static const char *uart_deaf(NUC980UARTState *s)
{
    if (!s->rxd_pin) {
        return "no pin is switched to RXD";
    }
    if (GET(s, FUNCSEL, TXRXDIS)) {
        return "TXRXDIS";
    }
    return NULL;
}

static void uart_rx_char(NUC980UARTState *s, uint16_t wire)
{
    bool address = uart_take(&s->inject_address);
    const char *why = uart_deaf(s);
    uint8_t c;

    if (why) {
        trace_nuc980_uart_rx_lost(s->name, wire, why);
        return;
    }
    c = uart_disturb(s, wire);
    if (uart_is_multidrop(s) ? !uart_rs485_takes(s, c, address) :
                               GET(s, FIFO, RXOFF)) {
        trace_nuc980_uart_rx_lost(s->name, c, "receiver off");
    } else if (fifo8_is_full(&s->rx)) {
        trace_nuc980_uart_rx_lost(s->name, c, "overrun");
        s->regs[R_FIFOSTS] |= R_FIFOSTS_RXOVIF_MASK;
    } else {
        fifo8_push(&s->rx, c);
        trace_nuc980_uart_rx(s->name, c, fifo8_num_used(&s->rx));
        s->timed_out = false;
        uart_restart_timeout(s);
    }
    uart_update(s);
}

/* Automatic RTS, and a far end that has the wire and heeds it */
static bool uart_holds_far_end(NUC980UARTState *s)
{
    return s->rts_pin && uart_auto_rts(s) && !uart_rx_has_room(s);
}

static void uart_rx_start(NUC980UARTState *s, int64_t from)
{
    if (s->wire_used && !timer_pending(s->rx_timer) &&
        !uart_holds_far_end(s)) {
        uart_begin_char(s, s->rx_timer, &s->rx_due, from);
    }
}

static void uart_rx_end(void *opaque)
{
    NUC980UARTState *s = opaque;
    uint16_t c = s->wire[s->wire_head];

    s->wire_head = (s->wire_head + 1) % NUC980_UART_WIRE;
    s->wire_used--;
    uart_rx_char(s, c);
    uart_rx_start(s, uart_follow(s, s->rx_due));
    qemu_chr_fe_accept_input(&s->chr);
}

static void uart_from_far_end(NUC980UARTState *s, uint16_t c)
{
    if (!s->pace) {
        uart_rx_char(s, c);
    } else if (s->wire_used < NUC980_UART_WIRE) {
        s->wire[(s->wire_head + s->wire_used++) % NUC980_UART_WIRE] = c;
        uart_rx_start(s, uart_now());
    }
}

static int uart_can_receive(void *opaque)
{
    NUC980UARTState *s = opaque;

    if (uart_holds_far_end(s)) {
        return 0;
    }
    return s->pace ? NUC980_UART_WIRE - s->wire_used : fifo8_num_free(&s->rx);
}

static void uart_receive(void *opaque, const uint8_t *buf, int size)
{
    NUC980UARTState *s = opaque;

    for (int i = 0; i < size; i++) {
        uart_from_far_end(opaque, buf[i]);
    }
    if (s->resting) {
        qemu_cpu_kick(s->resting);
    }
}

static void uart_event(void *opaque, QEMUChrEvent event)
{
    if (event == CHR_EVENT_BREAK) {
        uart_from_far_end(opaque, WIRE_BREAK);
    }
}

static uint8_t uart_read_data(NUC980UARTState *s)
{
    uint8_t c;

    if (fifo8_is_empty(&s->rx)) {
        qemu_log_mask(LOG_GUEST_ERROR, "%s: read of an empty receive FIFO\n",
                      s->name);
        return 0;
    }
    c = fifo8_pop(&s->rx);
    s->timed_out = false;
    uart_restart_timeout(s);
    uart_update(s);
    uart_rx_start(s, uart_now());
    qemu_chr_fe_accept_input(&s->chr);
    return c;
}

/* Registers */

static void uart_unimp(NUC980UARTState *s, hwaddr offset)
{
    nuc980_unimp_once(s->unimp_seen, s->name, offset);
}

static uint64_t uart_read_reg(NUC980UARTState *s, hwaddr offset)
{
    switch (offset) {
    case A_DAT:
        return uart_read_data(s);
    case A_MODEM:
        return FIELD_DP32(s->regs[R_MODEM], MODEM, RTSSTS, uart_rts_level(s));
    case A_FIFOSTS:
        return uart_fifosts(s);
    case A_INTSTS:
        return uart_intsts(s);
    case A_INTEN:
    case A_FIFO:
    case A_LINE:
    case A_MODEMSTS:
    case A_TOUT:
    case A_BAUD:
    case A_ALTCTL:
    case A_FUNCSEL:
        return s->regs[offset / 4];
    case A_IRDA:
    case A_LINCTL:
    case A_LINSTS:
    case A_BRCOMP:
    case A_WKCTL:
    case A_WKSTS:
    case A_DWKCOMP:
        uart_unimp(s, offset);
        return s->regs[offset / 4];
    default:
        qemu_log_mask(LOG_GUEST_ERROR, "%s: read of 0x%" HWADDR_PRIx
                      ", no register\n", s->name, offset);
        return 0;
    }
}

/*
 * A boot loader at its prompt reads the state of an idle line again and again.
 * The host need not work for that: the processor rests, until something comes
 * or for a moment. Not with -icount: the guest's time would stand still.
 */
#define POLLS_TO_REST   100
#define REST_MS         1

static bool uart_is_idle(NUC980UARTState *s)
{
    return fifo8_is_empty(&s->rx) && !s->wire_used && uart_sent_all(s);
}

static void uart_rest(CPUState *cpu, run_on_cpu_data data)
{
    NUC980UARTState *s = data.host_ptr;

    if (uart_is_idle(s)) {
        s->resting = cpu;
        qemu_cond_timedwait_iothread(cpu->halt_cond, REST_MS);
        s->resting = NULL;
    }
}

static void uart_count_poll(NUC980UARTState *s, hwaddr offset)
{
    if (offset != A_FIFOSTS || !uart_is_idle(s)) {
        s->polls = 0;
    } else if (++s->polls >= POLLS_TO_REST) {
        s->polls = 0;
        if (current_cpu && !icount_enabled()) {
            async_run_on_cpu(current_cpu, uart_rest, RUN_ON_CPU_HOST_PTR(s));
        }
    }
}

static uint64_t uart_read(void *opaque, hwaddr offset, unsigned size)
{
    NUC980UARTState *s = opaque;
    uint64_t value = uart_read_reg(s, offset);

    uart_count_poll(s, offset);
    trace_nuc980_uart_read(s->name, offset, value);
    return value;
}

static void uart_write_data(NUC980UARTState *s, uint8_t c)
{
    if (fifo8_is_full(&s->tx)) {
        trace_nuc980_uart_tx_lost(s->name, c, "overrun");
        s->regs[R_FIFOSTS] |= R_FIFOSTS_TXOVIF_MASK;
    } else {
        fifo8_push(&s->tx, c);
    }
}

/* guess: a character on its way in or out is not touched */
static void uart_write_fifo(NUC980UARTState *s, uint32_t value)
{
    if (value & R_FIFO_RXRST_MASK) {
        fifo8_reset(&s->rx);
        s->timed_out = false;
    }
    if (value & R_FIFO_TXRST_MASK) {
        fifo8_reset(&s->tx);
    }
    s->regs[R_FIFO] = value & (R_FIFO_RFITL_MASK | R_FIFO_RXOFF_MASK |
                               R_FIFO_RTSTRGLV_MASK);
    uart_restart_timeout(s);
}

/* A chardev that is a serial line follows in speed, format and break */
static void uart_set_line(NUC980UARTState *s)
{
    int on = GET(s, LINE, BCB);
    QEMUSerialSetParams line = {
        .speed = clock_get_hz(s->clk) / uart_divider(s),
        .parity = !GET(s, LINE, PBE) ? 'N' : GET(s, LINE, EPE) ? 'E' : 'O',
        .data_bits = uart_word_bits(s),
        .stop_bits = 1 + GET(s, LINE, NSB),
    };

    trace_nuc980_uart_line(s->name, line.speed, line.data_bits,
                           line.parity, line.stop_bits);
    qemu_chr_fe_ioctl(&s->chr, CHR_IOCTL_SERIAL_SET_PARAMS, &line);
    qemu_chr_fe_ioctl(&s->chr, CHR_IOCTL_SERIAL_SET_BREAK, &on);
}

/* Bits that ask for what is not modelled */
static const uint32_t uart_unimp_bits[NUC980_UART_REGS] = {
    [R_INTEN] = R_INTEN_WKIEN_MASK | R_INTEN_LINIEN_MASK |
                R_INTEN_ABRIEN_MASK,
    [R_LINE] = R_LINE_PSS_MASK | R_LINE_TXDINV_MASK | R_LINE_RXDINV_MASK,
    [R_ALTCTL] = R_ALTCTL_LINRXEN_MASK | R_ALTCTL_LINTXEN_MASK |
                 R_ALTCTL_ABRDEN_MASK,
};

static void uart_write_reg(NUC980UARTState *s, hwaddr offset, uint32_t value)
{
    uint32_t *reg = &s->regs[offset / 4];

    switch (offset) {
    case A_DAT:
        uart_write_data(s, value);
        break;
    case A_INTEN:
        *reg = value;
        uart_restart_timeout(s);
        break;
    case A_FIFO:
        uart_write_fifo(s, value);
        break;
    case A_LINE:
    case A_BAUD:
        *reg = value;
        uart_set_line(s);
        break;
    case A_MODEM:
        *reg = value & (R_MODEM_RTS_MASK | R_MODEM_RTSACTLV_MASK);
        break;
    case A_MODEMSTS:
        *reg &= ~(R_MODEMSTS_CTSACTLV_MASK | (value & R_MODEMSTS_CTSDETF_MASK));
        *reg |= value & R_MODEMSTS_CTSACTLV_MASK;
        break;
    case A_FIFOSTS:
        *reg &= ~(value & FIFOSTS_W1C);
        break;
    case A_INTSTS:              /* only LIN's flag could be written */
        break;
    case A_TOUT:
        *reg = value;
        break;
    case A_ALTCTL:
        *reg = value;
        if (!GET(s, ALTCTL, RS485AAD)) {
            s->addressed = false;
        }
        break;
    case A_FUNCSEL:
        *reg = value & (R_FUNCSEL_FUNCSEL_MASK | R_FUNCSEL_TXRXDIS_MASK);
        if (GET(s, FUNCSEL, FUNCSEL) != FUNC_UART && !uart_is_rs485(s)) {
            uart_unimp(s, offset);
        }
        break;
    case A_IRDA:
    case A_LINCTL:
    case A_LINSTS:
    case A_BRCOMP:
    case A_WKCTL:
    case A_WKSTS:
    case A_DWKCOMP:
        uart_unimp(s, offset);
        *reg = value;
        break;
    default:
        qemu_log_mask(LOG_GUEST_ERROR, "%s: write of 0x%" PRIx32 " to 0x%"
                      HWADDR_PRIx ", no register\n", s->name, value,
                      offset);
        return;
    }
    if (value & uart_unimp_bits[offset / 4]) {
        uart_unimp(s, offset);
    }
}

static void uart_write(void *opaque, hwaddr offset, uint64_t value,
                       unsigned size)
{
    NUC980UARTState *s = opaque;

    trace_nuc980_uart_write(s->name, offset, value);
    s->polls = 0;
    uart_write_reg(s, offset, value);
    uart_tx_start(s, uart_now());
    uart_rx_start(s, uart_now());
    uart_update(s);
}

static const MemoryRegionOps uart_ops = {
    .read = uart_read,
    .write = uart_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 1, .max_access_size = 4 },
    .impl = { .min_access_size = 4, .max_access_size = 4 },
};

/* Inputs */

static void uart_set_pin(NUC980UARTState *s, bool *pin, const char *name,
                         bool routed)
{
    if (*pin != routed) {
        trace_nuc980_uart_pin(s->name, name, routed);
        *pin = routed;
    }
}

static void uart_rxd_pin(void *opaque, int n, int level)
{
    NUC980UARTState *s = opaque;

    uart_set_pin(s, &s->rxd_pin, "RXD", level);
}

static void uart_txd_pin(void *opaque, int n, int level)
{
    NUC980UARTState *s = opaque;

    uart_set_pin(s, &s->txd_pin, "TXD", level);
}

static void uart_rts_pin(void *opaque, int n, int level)
{
    NUC980UARTState *s = opaque;

    uart_set_pin(s, &s->rts_pin, "RTS", level);
    qemu_chr_fe_accept_input(&s->chr);
}

/* guess: without a pin it reads high, as MODEMSTS's reset value has it */
static void uart_update_cts(NUC980UARTState *s)
{
    bool level = !s->cts_pin || s->cts;

    if (level != GET(s, MODEMSTS, CTSSTS)) {
        s->regs[R_MODEMSTS] ^= R_MODEMSTS_CTSSTS_MASK;
        s->regs[R_MODEMSTS] |= R_MODEMSTS_CTSDETF_MASK;
        uart_tx_start(s, uart_now());
        uart_update(s);
    }
}

static void uart_cts_pin(void *opaque, int n, int level)
{
    NUC980UARTState *s = opaque;

    uart_set_pin(s, &s->cts_pin, "CTS", level);
    uart_update_cts(s);
}

static void uart_cts(void *opaque, int n, int level)
{
    NUC980UARTState *s = opaque;

    s->cts = level;
    uart_update_cts(s);
}

/* Characters on their way begin again, at the new speed */
static void uart_clock_update(void *opaque, ClockEvent event)
{
    NUC980UARTState *s = opaque;

    uart_set_line(s);
    if (s->pace && s->tx_busy && !s->tx_watch) {
        uart_begin_char(s, s->tx_timer, &s->tx_due, uart_now());
    }
    timer_del(s->rx_timer);
    uart_rx_start(s, uart_now());
    uart_restart_timeout(s);
}

/* Device */

static void uart_reset(DeviceState *dev)
{
    NUC980UARTState *s = NUC980_UART(dev);

    /* guess: the values of the sibling */
    memset(s->regs, 0, sizeof(s->regs));
    s->regs[R_MODEM] = R_MODEM_RTSACTLV_MASK;
    s->regs[R_MODEMSTS] = R_MODEMSTS_CTSACTLV_MASK;
    s->regs[R_BAUD] = R_BAUD_EDIVM1_MASK;
    s->regs[R_IRDA] = 0x40;
    s->regs[R_ALTCTL] = 0x0c;
    s->regs[R_LINCTL] = 0x000c0000;

    s->regs[R_MODEMSTS] |= !s->cts_pin || s->cts ? R_MODEMSTS_CTSSTS_MASK : 0;
    fifo8_reset(&s->rx);
    fifo8_reset(&s->tx);
    s->timed_out = s->addressed = s->tx_busy = false;
    timer_del(s->tx_timer);
    timer_del(s->rx_timer);
    timer_del(s->timeout);
    uart_drop_watch(s);
    uart_rx_start(s, uart_now());
    uart_update(s);
}

static int uart_post_load(void *opaque, int version_id)
{
    NUC980UARTState *s = opaque;

    if (s->wire_head >= NUC980_UART_WIRE || s->wire_used > NUC980_UART_WIRE ||
        (timer_pending(s->rx_timer) && !s->wire_used)) {
        return -EINVAL;
    }
    /* A character that waited for its chardev tries this one's */
    if (s->tx_busy && !timer_pending(s->tx_timer) &&
        clock_is_enabled(s->clk)) {
        timer_mod(s->tx_timer, uart_now());
    }
    uart_set_line(s);
    uart_update(s);
    return 0;
}

static const VMStateDescription vmstate_nuc980_uart = {
    .name = TYPE_NUC980_UART,
    .version_id = 1,
    .minimum_version_id = 1,
    .post_load = uart_post_load,
    .fields = (VMStateField[]) {
        VMSTATE_CLOCK(clk, NUC980UARTState),
        VMSTATE_UINT32_ARRAY(regs, NUC980UARTState, NUC980_UART_REGS),
        VMSTATE_FIFO8(rx, NUC980UARTState),
        VMSTATE_FIFO8(tx, NUC980UARTState),
        VMSTATE_BOOL(rxd_pin, NUC980UARTState),
        VMSTATE_BOOL(txd_pin, NUC980UARTState),
        VMSTATE_BOOL(rts_pin, NUC980UARTState),
        VMSTATE_BOOL(cts_pin, NUC980UARTState),
        VMSTATE_BOOL(cts, NUC980UARTState),
        VMSTATE_BOOL(timed_out, NUC980UARTState),
        VMSTATE_BOOL(addressed, NUC980UARTState),
        VMSTATE_TIMER_PTR(tx_timer, NUC980UARTState),
        VMSTATE_INT64(tx_due, NUC980UARTState),
        VMSTATE_UINT8(tx_char, NUC980UARTState),
        VMSTATE_BOOL(tx_busy, NUC980UARTState),
        VMSTATE_BOOL(tx_whole, NUC980UARTState),
        VMSTATE_TIMER_PTR(rx_timer, NUC980UARTState),
        VMSTATE_INT64(rx_due, NUC980UARTState),
        VMSTATE_TIMER_PTR(timeout, NUC980UARTState),
        VMSTATE_UINT16_ARRAY(wire, NUC980UARTState, NUC980_UART_WIRE),
        VMSTATE_UINT32(wire_head, NUC980UARTState),
        VMSTATE_UINT32(wire_used, NUC980UARTState),
        VMSTATE_UINT32(inject_parity, NUC980UARTState),
        VMSTATE_UINT32(inject_framing, NUC980UARTState),
        VMSTATE_UINT32(inject_break, NUC980UARTState),
        VMSTATE_UINT32(inject_address, NUC980UARTState),
        VMSTATE_END_OF_LIST()
    }
};

static void uart_realize(DeviceState *dev, Error **errp)
{
    NUC980UARTState *s = NUC980_UART(dev);

    s->name = object_get_canonical_path_component(OBJECT(dev));
    qemu_chr_fe_set_handlers(&s->chr, uart_can_receive, uart_receive,
                             uart_event, NULL, s, NULL, true);
}

static void uart_unrealize(DeviceState *dev)
{
    NUC980UARTState *s = NUC980_UART(dev);

    uart_drop_watch(s);
    timer_del(s->tx_timer);
    timer_del(s->rx_timer);
    timer_del(s->timeout);
}

static void uart_init(Object *obj)
{
    NUC980UARTState *s = NUC980_UART(obj);
    DeviceState *dev = DEVICE(obj);

    memory_region_init_io(&s->iomem, obj, &uart_ops, s, TYPE_NUC980_UART,
                          4 * NUC980_UART_REGS);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq);
    s->clk = qdev_init_clock_in(dev, "clk", uart_clock_update, s, ClockUpdate);
    qdev_init_gpio_in_named(dev, uart_rxd_pin, "rxd-pin", 1);
    qdev_init_gpio_in_named(dev, uart_txd_pin, "txd-pin", 1);
    qdev_init_gpio_in_named(dev, uart_rts_pin, "rts-pin", 1);
    qdev_init_gpio_in_named(dev, uart_cts_pin, "cts-pin", 1);
    qdev_init_gpio_in_named(dev, uart_cts, "cts", 1);
    qdev_init_gpio_out_named(dev, &s->tx_dma, "tx-dma", 1);
    qdev_init_gpio_out_named(dev, &s->rx_dma, "rx-dma", 1);

    object_property_add_uint32_ptr(obj, "inject-parity-errors",
                                   &s->inject_parity, OBJ_PROP_FLAG_READWRITE);
    object_property_add_uint32_ptr(obj, "inject-framing-errors",
                                   &s->inject_framing,
                                   OBJ_PROP_FLAG_READWRITE);
    object_property_add_uint32_ptr(obj, "inject-breaks",
                                   &s->inject_break, OBJ_PROP_FLAG_READWRITE);
    object_property_add_uint32_ptr(obj, "inject-addresses",
                                   &s->inject_address,
                                   OBJ_PROP_FLAG_READWRITE);

    fifo8_create(&s->rx, NUC980_UART_FIFO);
    fifo8_create(&s->tx, NUC980_UART_FIFO);
    s->tx_timer = timer_new_ns(QEMU_CLOCK_VIRTUAL, uart_tx_end, s);
    s->rx_timer = timer_new_ns(QEMU_CLOCK_VIRTUAL, uart_rx_end, s);
    s->timeout = timer_new_ns(QEMU_CLOCK_VIRTUAL, uart_rx_timeout, s);
}

static void uart_finalize(Object *obj)
{
    NUC980UARTState *s = NUC980_UART(obj);

    timer_free(s->tx_timer);
    timer_free(s->rx_timer);
    timer_free(s->timeout);
    fifo8_destroy(&s->rx);
    fifo8_destroy(&s->tx);
}

static Property uart_properties[] = {
    DEFINE_PROP_CHR("chardev", NUC980UARTState, chr),
    DEFINE_PROP_BOOL("pace", NUC980UARTState, pace, true),
    DEFINE_PROP_BOOL("de-on-rts", NUC980UARTState, de_on_rts, false),
    DEFINE_PROP_END_OF_LIST(),
};

static void uart_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->realize = uart_realize;
    dc->unrealize = uart_unrealize;
    dc->reset = uart_reset;
    dc->vmsd = &vmstate_nuc980_uart;
    device_class_set_props(dc, uart_properties);
    set_bit(DEVICE_CATEGORY_INPUT, dc->categories);
}

static const TypeInfo nuc980_uart_types[] = {
    {
        .name = TYPE_NUC980_UART,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980UARTState),
        .instance_init = uart_init,
        .instance_finalize = uart_finalize,
        .class_init = uart_class_init,
    },
};

DEFINE_TYPES(nuc980_uart_types)
