/*
 * Nuvoton NUC980 peripheral DMA controller
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_DMA_NUC980_PDMA_H
#define HW_DMA_NUC980_PDMA_H

#include "hw/clock.h"
#include "hw/sysbus.h"
#include "qemu/bitmap.h"
#include "qemu/timer.h"

#define TYPE_NUC980_PDMA "nuc980-pdma"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980PDMAState, NUC980_PDMA)

#define NUC980_PDMA_CHANNELS    10
#define NUC980_PDMA_REQUESTS    64
#define NUC980_PDMA_REGS        (0x530 / 4)

typedef struct NUC980PDMATimeout {
    NUC980PDMAState *pdma;
    QEMUTimer *timer;
} NUC980PDMATimeout;

/*
 * QEMU interface:
 *  + sysbus IRQ 0: the interrupt
 *  + Clock input "hclk": what the request time-outs count
 *  + Named GPIO inputs "request": peripherals' requests, by REQSEL's numbers
 */
struct NUC980PDMAState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq;
    Clock *hclk;
    QEMUTimer *run;
    NUC980PDMATimeout timeout[NUC980_PDMA_CHANNELS];

    uint32_t regs[NUC980_PDMA_REGS];
    uint64_t requests;              /* level of each request line */
    uint32_t swreq;                 /* per channel: software request pending */
    uint32_t loaded;                /* per channel: task read from the chain */
    DECLARE_BITMAP(unimp_seen, NUC980_PDMA_REGS);
};

#endif /* HW_DMA_NUC980_PDMA_H */
