/*
 * Nuvoton NUC980 flash memory interface: raw NAND
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_BLOCK_NUC980_FMI_H
#define HW_BLOCK_NUC980_FMI_H

#include "hw/sysbus.h"

#define TYPE_NUC980_FMI "nuc980-fmi"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980FMIState, NUC980_FMI)

struct NUC980FMIState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq;
    DeviceState *nand;              /* NULL: nothing fitted */
    uint32_t r[0x1000 / 4];
};

#endif /* HW_BLOCK_NUC980_FMI_H */
