/*
 * Nuvoton NUC980 UART
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_CHAR_NUC980_UART_H
#define HW_CHAR_NUC980_UART_H

#include "hw/sysbus.h"
#include "chardev/char-fe.h"
#include "hw/clock.h"
#include "qemu/timer.h"

#define TYPE_NUC980_UART "nuc980-uart"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980UARTState, NUC980_UART)

#define NUC980_UART_FIFO 16

struct NUC980UARTState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq, tx_dma, rx_dma;
    Clock *clk;
    CharBackend chr;
    bool pace;
    bool rx_pin, tx_pin;            /* routed to a pad by the MFP registers */
    bool rs485;                     /* an RS-485 transceiver hangs on RTS = DE */
    uint8_t rx[NUC980_UART_FIFO], tx[NUC980_UART_FIFO];
    int rx_n, tx_n;
    QEMUTimer *tx_t, *rx_t, *to_t;
    bool rx_busy;                   /* the line is busy until rx_t fires */
    bool shifting;                  /* a character is in the shift register */
    uint8_t shift;
    uint32_t ier, fcr, lcr, mcr, msr, tor, baud, ircr, alt, fun, fsr_err;
    bool toif;
    uint64_t dropped;
};

#endif /* HW_CHAR_NUC980_UART_H */
