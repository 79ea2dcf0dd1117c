/*
 * Nuvoton NUC980 (Q)SPI controller
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_SSI_NUC980_SPI_H
#define HW_SSI_NUC980_SPI_H

#include "hw/sysbus.h"

#define TYPE_NUC980_SPI "nuc980-spi"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980SPIState, NUC980_SPI)

struct NUC980SPIState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    uint32_t r[0x20];
    int rx_n;
};

#endif /* HW_SSI_NUC980_SPI_H */
