/*
 * Nuvoton NUC980 SDRAM controller: what a boot loader reads of it
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_MISC_NUC980_SDIC_H
#define HW_MISC_NUC980_SDIC_H

#include "hw/sysbus.h"
#include "qemu/bitops.h"

#define TYPE_NUC980_SDIC "nuc980-sdic"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980SDICState, NUC980_SDIC)

#define NUC980_SDIC_REGS    (0x1000 / 4)

struct NUC980SDICState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    uint32_t ram_mib;               /* 2, 4 .. 128 */
    uint32_t size[2];
    DECLARE_BITMAP(seen, NUC980_SDIC_REGS);
};

#endif /* HW_MISC_NUC980_SDIC_H */
