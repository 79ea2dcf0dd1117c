/*
 * Nuvoton NUC980 WDT
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_WATCHDOG_NUC980_WDT_H
#define HW_WATCHDOG_NUC980_WDT_H

#include "hw/sysbus.h"
#include "hw/clock.h"
#include "net/net.h"

#define TYPE_NUC980_WDT "nuc980-wdt"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980WDTState, NUC980_WDT)

struct NUC980WDTState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq[2];
    Clock *clk;
    NICConf conf;
    uint32_t regs[0x400];
};

#endif /* HW_WATCHDOG_NUC980_WDT_H */
