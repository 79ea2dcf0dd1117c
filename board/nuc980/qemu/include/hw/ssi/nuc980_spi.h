/*
 * Nuvoton NUC980 (Q)SPI controller
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_SSI_NUC980_SPI_H
#define HW_SSI_NUC980_SPI_H

#include "hw/ssi/ssi.h"
#include "hw/sysbus.h"
#include "qemu/bitmap.h"
#include "qemu/fifo32.h"

#define TYPE_NUC980_SPI "nuc980-spi"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980SPIState, NUC980_SPI)

#define NUC980_SPI_SIZE     0x1000

/*
 * The bus takes -device ...,bus=ssi.0 (QSPI0), ssi.1 (SPI0) or ssi.2 (SPI1);
 * the first device of a bus is on SS0, the second one on SS1.
 */
struct NUC980SPIState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq;
    SSIBus *bus;
    uint32_t ctl, clkdiv, ssctl, pdmactl, fifoctl;
    uint32_t flags;             /* of STATUS: what only a 1 clears */
    Fifo32 tx, rx;
    DECLARE_BITMAP(seen, NUC980_SPI_SIZE / 4);
};

#endif /* HW_SSI_NUC980_SPI_H */
