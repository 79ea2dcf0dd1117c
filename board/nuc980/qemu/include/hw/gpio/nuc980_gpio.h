/*
 * Nuvoton NUC980 GPIO, ports A to G
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_GPIO_NUC980_GPIO_H
#define HW_GPIO_NUC980_GPIO_H

#include "hw/sysbus.h"

#define TYPE_NUC980_GPIO "nuc980-gpio"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980GPIOState, NUC980_GPIO)

struct NUC980GPIOState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    uint32_t r[0x400];
};

#endif /* HW_GPIO_NUC980_GPIO_H */
