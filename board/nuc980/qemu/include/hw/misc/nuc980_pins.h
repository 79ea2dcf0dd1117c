/*
 * Nuvoton NUC980 pins: multi-function routing and the board's wiring
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_MISC_NUC980_PINS_H
#define HW_MISC_NUC980_PINS_H

#include "hw/qdev-core.h"
#include "qom/object.h"

#define TYPE_NUC980_PINS "nuc980-pins"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980PinsState, NUC980_PINS)

#define NUC980_MFP_REGS     14      /* two for each of the ports A to G */
#define NUC980_UARTS        10
#define NUC980_EMACS        2

/*
 * Named GPIO outputs, high while the pin that the board wires to the signal
 * is switched to it:
 *   "uart-rxd", "uart-txd", "uart-rts", "uart-cts": one per UART
 *   "emac-rmii": all eight RMII data, control and clock pins of an EMAC
 *   "emac-mdio": its MDC and MDIO
 *   "nand": all pins of the NAND flash
 */
struct NUC980PinsState {
    DeviceState parent_obj;

    qemu_irq uart_rxd[NUC980_UARTS], uart_txd[NUC980_UARTS];
    qemu_irq uart_rts[NUC980_UARTS], uart_cts[NUC980_UARTS];
    qemu_irq emac_rmii[NUC980_EMACS], emac_mdio[NUC980_EMACS];
    qemu_irq nand;
    uint32_t mfp[NUC980_MFP_REGS];
};

/* The system registers' side: an MFP register, numbered from 0, was written */
void nuc980_pins_write(NUC980PinsState *s, unsigned reg, uint32_t value);

#endif /* HW_MISC_NUC980_PINS_H */
