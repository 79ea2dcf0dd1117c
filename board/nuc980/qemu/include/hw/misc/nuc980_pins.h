/*
 * Nuvoton NUC980 pins: multi-function routing and the board's wiring
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_MISC_NUC980_PINS_H
#define HW_MISC_NUC980_PINS_H

#include "hw/qdev-core.h"
#include "qemu/timer.h"
#include "qom/object.h"

#define TYPE_NUC980_PINS "nuc980-pins"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980PinsState, NUC980_PINS)

#define NUC980_MFP_REGS     14      /* two for each of the ports A to G */
#define NUC980_PIN_COUNT    (8 * NUC980_MFP_REGS)
#define NUC980_UARTS        10
#define NUC980_EMACS        2
#define NUC980_PIN_LINES    (4 * NUC980_UARTS + 2 * NUC980_EMACS + 1)
#define NUC980_PIN_OWNERS   64      /* at most, in the generated table */

/* Pins that are of use together: the signals that begin like this */
typedef struct NUC980PinLine {
    char prefix[12];
    qemu_irq *out;
    unsigned wired, connected;      /* by the board; of these by the chip */
} NUC980PinLine;

typedef struct NUC980PinOwner {
    unsigned wired, connected;
    bool told;                      /* of the pins that it lacks */
} NUC980PinOwner;

/*
 * Named GPIO outputs, high while the pin that the board wires to the signal
 * is switched to it:
 *   "uart-rxd", "uart-txd", "uart-rts", "uart-cts": one per UART
 *   "emac-rmii": all eight RMII data, control and clock pins of an EMAC
 *   "emac-mdio": its MDC and MDIO
 *   "nand": all pins of the NAND flash
 * and one per pin, numbered from PA0 as 16 * port + pin:
 *   "peripheral": a peripheral has the pin, it is no GPIO
 *   "eint": it is the input of its external interrupt
 *
 * Property "view": what `info nuc980-pins` shows, as data.
 */
struct NUC980PinsState {
    DeviceState parent_obj;

    qemu_irq uart_rxd[NUC980_UARTS], uart_txd[NUC980_UARTS];
    qemu_irq uart_rts[NUC980_UARTS], uart_cts[NUC980_UARTS];
    qemu_irq emac_rmii[NUC980_EMACS], emac_mdio[NUC980_EMACS];
    qemu_irq nand;
    qemu_irq peripheral[NUC980_PIN_COUNT], eint[NUC980_PIN_COUNT];

    uint32_t board;                     /* whose wiring, before realize */
    uint32_t mfp[NUC980_MFP_REGS];
    uint8_t taken[NUC980_PIN_COUNT];    /* value that it was switched from */

    /* The wiring, and how much of it is connected: follows from mfp */
    NUC980PinLine line[NUC980_PIN_LINES];
    unsigned lines;
    NUC980PinOwner owner[NUC980_PIN_OWNERS];
    NUC980PinLine *line_of[NUC980_PIN_COUNT];
    NUC980PinOwner *owner_of[NUC980_PIN_COUNT];
    uint8_t wanted[NUC980_PIN_COUNT];   /* value of the wired signal */

    /* Warnings: the values of each pin that one was given for */
    uint16_t told[NUC980_PIN_COUNT];
    QEMUTimer settled;
};

/* The system registers' side: an MFP register, numbered from 0, was written */
void nuc980_pins_write(NUC980PinsState *s, unsigned reg, uint32_t value);

/* What is the same in every run: pins are numbered from PA0 */
const char *nuc980_pin_name(unsigned pin);
bool nuc980_pin_exists(unsigned pin);
int nuc980_pin_eint(unsigned pin);  /* external interrupt it can be, or -1 */
int nuc980_board_number(const char *name);      /* -1: there is none */
const char *nuc980_board_name(unsigned board);  /* NULL: there is none */

/* Whether the board wires the signal to any pin */
bool nuc980_pin_wires(NUC980PinsState *s, const char *signal);

#endif /* HW_MISC_NUC980_PINS_H */
