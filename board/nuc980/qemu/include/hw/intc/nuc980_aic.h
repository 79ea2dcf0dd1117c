/*
 * Nuvoton NUC980 advanced interrupt controller
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_INTC_NUC980_AIC_H
#define HW_INTC_NUC980_AIC_H

#include "hw/sysbus.h"

#define TYPE_NUC980_AIC "nuc980-aic"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980AICState, NUC980_AIC)

struct NUC980AICState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq, fiq;
    uint32_t srcctl[16];
    uint64_t level, mask;
};

#endif /* HW_INTC_NUC980_AIC_H */
