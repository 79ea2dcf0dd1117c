/*
 * Nuvoton NUC980 UART
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_CHAR_NUC980_UART_H
#define HW_CHAR_NUC980_UART_H

#include "chardev/char-fe.h"
#include "hw/clock.h"
#include "hw/sysbus.h"
#include "qemu/bitmap.h"
#include "qemu/fifo8.h"
#include "qemu/timer.h"

#define TYPE_NUC980_UART "nuc980-uart"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980UARTState, NUC980_UART)

#define NUC980_UART_FIFO    16
#define NUC980_UART_REGS    (0x4c / 4)
#define NUC980_UART_WIRE    1024

/*
 * QEMU interface:
 *  + sysbus IRQ 0: the interrupt
 *  + Clock input "clk": what BAUD divides
 *  + Named GPIO outputs "tx-dma", "rx-dma": requests to the DMA controllers
 *  + Named GPIO inputs "rxd-pin", "txd-pin", "rts-pin", "cts-pin": high while
 *    a pin is switched to the signal. What is sent or received without is lost
 *  + Named GPIO input "cts": the level at the CTS pin
 *  + Property "chardev"
 *  + Property "pace": characters take their time on the wire, both ways, and
 *    what the guest does not read in time overruns. If off, they take none,
 *    and the far end waits for the guest
 *  + Property "de-on-rts": the RS-485 transceiver drives the bus only while
 *    RTS is high; what is sent otherwise is lost
 *  + QOM properties "inject-parity-errors", "inject-framing-errors",
 *    "inject-breaks", "inject-addresses", to be set at any time: how many of
 *    the next characters received have a wrong bit, have a wrong stop bit,
 *    are a break, have their ninth bit set (RS-485 multidrop)
 */
struct NUC980UARTState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq, tx_dma, rx_dma;
    Clock *clk;
    CharBackend chr;
    const char *name;               /* in messages; to search it takes time */
    bool pace;
    bool de_on_rts;

    uint32_t regs[NUC980_UART_REGS];
    Fifo8 rx, tx;
    bool rxd_pin, txd_pin, rts_pin, cts_pin;
    bool cts;
    bool timed_out;                 /* INTSTS.RXTOIF */
    bool addressed;                 /* RS-485 AAD: the last address was ours */

    QEMUTimer *tx_timer;            /* the character being sent ends */
    int64_t tx_due;
    uint8_t tx_char;
    bool tx_busy;
    bool tx_whole;                  /* its start bit was on the line, too */
    guint tx_watch;                 /* chardev full: sent when it has room */

    QEMUTimer *rx_timer;            /* the character being received ends */
    int64_t rx_due;
    QEMUTimer *timeout;             /* RX time-out counter reaches TOIC */
    uint16_t wire[NUC980_UART_WIRE]; /* sent by the far end, not yet here */
    uint32_t wire_head, wire_used;

    unsigned polls;                 /* of an idle line's state, in a row */
    CPUState *resting;              /* the processor that waits between them */

    uint32_t inject_parity, inject_framing, inject_break, inject_address;
    DECLARE_BITMAP(unimp_seen, NUC980_UART_REGS);
};

#endif /* HW_CHAR_NUC980_UART_H */
