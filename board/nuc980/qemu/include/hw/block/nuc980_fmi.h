/*
 * Nuvoton NUC980 flash memory interface: raw NAND
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_BLOCK_NUC980_FMI_H
#define HW_BLOCK_NUC980_FMI_H

#include "hw/sysbus.h"
#include "qemu/bitmap.h"
#include "qemu/timer.h"

#define TYPE_NUC980_FMI "nuc980-fmi"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980FMIState, NUC980_FMI)

#define NUC980_FMI_SIZE     0x1000
#define NUC980_FMI_REGS     (0xa00 / 4)
#define NUC980_FMI_SPARE    472         /* bytes of the redundant-area buffer */

/*
 * Property "nand": link to the NAND flash on chip select 0, if one is fitted
 * Named GPIO input "pins": high while the NAND's pins are switched to it
 * sysbus IRQ 0, sysbus MMIO 0: the registers
 */
struct NUC980FMIState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    MemoryRegion spare_iomem;
    qemu_irq irq;
    DeviceState *nand;

    uint32_t regs[NUC980_FMI_REGS];
    uint8_t spare[NUC980_FMI_SPARE];
    bool pins;
    uint8_t command;                    /* the last one the flash has seen */
    bool busy;                          /* the flash's R/-B is low */
    QEMUTimer ready;
    uint8_t field;                      /* of the page that is being read */
    DECLARE_BITMAP(unimplemented, NUC980_FMI_SIZE / 4);
};

#endif /* HW_BLOCK_NUC980_FMI_H */
