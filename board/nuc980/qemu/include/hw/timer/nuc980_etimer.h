/*
 * Nuvoton NUC980 enhanced timer (one of six)
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_TIMER_NUC980_ETIMER_H
#define HW_TIMER_NUC980_ETIMER_H

#include "hw/clock.h"
#include "hw/sysbus.h"
#include "qemu/bitops.h"
#include "qemu/timer.h"

#define TYPE_NUC980_ETIMER "nuc980-etimer"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980ETimerState, NUC980_ETIMER)

#define NUC980_ETIMER_SIZE  0x100

/* Clock input "clk": the source that the clock registers choose. */
struct NUC980ETimerState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq;
    Clock *clk;
    QEMUTimer *timer;               /* the next match that interrupts */
    uint32_t ctl, precnt, cmpr, ier, isr;
    uint32_t base;                  /* the counter when it stopped, or ... */
    int64_t start_ns;               /* ... when its ticks began to count */
    uint64_t armed;                 /* the tick at which CMPR was set */
    uint64_t matches;               /* since then, that ISR has seen */
    DECLARE_BITMAP(seen, NUC980_ETIMER_SIZE / 4);
};

#endif /* HW_TIMER_NUC980_ETIMER_H */
