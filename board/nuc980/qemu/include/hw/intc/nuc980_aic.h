/*
 * Nuvoton NUC980 advanced interrupt controller
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_INTC_NUC980_AIC_H
#define HW_INTC_NUC980_AIC_H

#include "hw/sysbus.h"
#include "qemu/bitops.h"

#define TYPE_NUC980_AIC "nuc980-aic"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980AICState, NUC980_AIC)

#define NUC980_AIC_SOURCES  64      /* source 0 does not exist: "none" */
#define NUC980_AIC_SIZE     0x1000

/*
 * GPIO inputs 0 to 63: the sources.
 * Sysbus interrupts 0 and 1: the processor's IRQ and FIQ.
 */
struct NUC980AICState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq, fiq;
    uint32_t srcctl[NUC980_AIC_SOURCES / 4];
    /* one bit for each source */
    uint64_t lines;                 /* levels of the inputs */
    uint64_t latched;               /* edges not yet taken */
    uint64_t mask;                  /* 1: enabled */
    uint64_t edge, high;            /* what SRCCTL's types say */
    DECLARE_BITMAP(seen, NUC980_AIC_SIZE / 4);
};

#endif /* HW_INTC_NUC980_AIC_H */
