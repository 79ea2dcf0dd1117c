/*
 * Nuvoton NUC980 Ethernet MAC, and the PHY on its MII management lines
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_NET_NUC980_EMAC_H
#define HW_NET_NUC980_EMAC_H

#include "hw/sysbus.h"
#include "net/net.h"
#include "qemu/bitmap.h"
#include "qemu/timer.h"

#define TYPE_NUC980_EMAC "nuc980-emac"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980EMACState, NUC980_EMAC)

#define NUC980_EMAC_SIZE        0x1000
#define NUC980_EMAC_REGS        (0x130 / 4)
#define NUC980_EMAC_PHY_REGS    32

/* What the DMA of one direction does while that direction is switched on */
typedef enum NUC980EMACDma {
    NUC980_EMAC_DMA_HALTED,     /* out of descriptors, until a start demand */
    NUC980_EMAC_DMA_RUNNING,
    NUC980_EMAC_DMA_FAILED,     /* bus error, until switched on again */
} NUC980EMACDma;

/*
 * sysbus IRQ 0: transmit; 1: receive.
 * Named GPIO inputs, high while the pins that the board wires are selected:
 *   "rmii": RMII data, control and clock; low, there is no link
 *   "mdio": MDC and MDIO; low, no PHY answers
 * Properties: those of a NIC, and "phy-addr", the PHY's MII address.
 */
struct NUC980EMACState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq tx_irq, rx_irq;
    NICState *nic;
    NICConf conf;
    QEMUTimer *tx_timer;            /* goes on after a long burst */
    uint8_t phy_addr;
    DECLARE_BITMAP(seen, NUC980_EMAC_SIZE / 4);
    DECLARE_BITMAP(phy_seen, NUC980_EMAC_PHY_REGS);

    bool rmii, mdio;
    uint32_t regs[NUC980_EMAC_REGS];
    uint32_t tx_dma, rx_dma;        /* NUC980EMACDma */
    uint16_t phy[NUC980_EMAC_PHY_REGS];
    bool link;
    bool link_failed;               /* since BMSR was last read */
};

#endif /* HW_NET_NUC980_EMAC_H */
