/*
 * Nuvoton NUC980 EMAC
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_NET_NUC980_EMAC_H
#define HW_NET_NUC980_EMAC_H

#include "hw/sysbus.h"
#include "hw/clock.h"
#include "net/net.h"

#define TYPE_NUC980_EMAC "nuc980-emac"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980EMACState, NUC980_EMAC)

struct NUC980EMACState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq[2];
    Clock *clk;
    NICConf conf;
    uint32_t regs[0x400];
};

#endif /* HW_NET_NUC980_EMAC_H */
