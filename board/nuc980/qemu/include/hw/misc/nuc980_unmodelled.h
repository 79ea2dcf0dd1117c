/*
 * Nuvoton NUC980: the blocks that are not modelled
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_MISC_NUC980_UNMODELLED_H
#define HW_MISC_NUC980_UNMODELLED_H

#include "hw/sysbus.h"
#include "qemu/bitops.h"
#include "qemu/units.h"

#define TYPE_NUC980_UNMODELLED "nuc980-unmodelled"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980UnmodelledState, NUC980_UNMODELLED)

#define NUC980_IO_SIZE      (1 * MiB)

/* To lie below the modelled blocks, over all of the chip's registers. */
struct NUC980UnmodelledState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    DECLARE_BITMAP(seen, NUC980_IO_SIZE / 4);
};

#endif /* HW_MISC_NUC980_UNMODELLED_H */
