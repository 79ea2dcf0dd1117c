/*
 * Nuvoton NUC980 peripheral DMA controller
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_DMA_NUC980_PDMA_H
#define HW_DMA_NUC980_PDMA_H

#include "hw/sysbus.h"
#include "hw/clock.h"
#include "qemu/timer.h"

#define TYPE_NUC980_PDMA "nuc980-pdma"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980PDMAState, NUC980_PDMA)

#define NUC980_PDMA_CHANNELS 10

typedef struct NUC980PDMAChannel {
    NUC980PDMAState *p;
    uint32_t ctl, sa, da, next, cur;
    bool loaded;                    /* ctl/sa/da hold a task, not a pointer */
    bool swreq;
    QEMUTimer *to;
} NUC980PDMAChannel;

struct NUC980PDMAState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq;
    Clock *hclk;
    QEMUTimer *run;
    uint64_t requests;              /* level of each request line */
    NUC980PDMAChannel ch[NUC980_PDMA_CHANNELS];
    uint32_t chctl, inten, intsts, tdsts, psc, psc2, touten, toutien, scatba;
    uint32_t toc[5], reqsel[4];
};

#endif /* HW_DMA_NUC980_PDMA_H */
