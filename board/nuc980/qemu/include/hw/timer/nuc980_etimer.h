/*
 * Nuvoton NUC980 enhanced timer (one of six)
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_TIMER_NUC980_ETIMER_H
#define HW_TIMER_NUC980_ETIMER_H

#include "hw/sysbus.h"
#include "hw/clock.h"
#include "qemu/timer.h"

#define TYPE_NUC980_ETIMER "nuc980-etimer"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980ETimerState, NUC980_ETIMER)

struct NUC980ETimerState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq;
    Clock *clk;
    QEMUTimer *t;
    uint32_t ctl, precnt, cmpr, ier, isr, ectl;
    int64_t start_ns;               /* when the counter was 'base' */
    uint32_t base;
};

#endif /* HW_TIMER_NUC980_ETIMER_H */
