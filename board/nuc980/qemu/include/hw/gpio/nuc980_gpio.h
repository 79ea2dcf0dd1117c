/*
 * Nuvoton NUC980 GPIO, ports A to G
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_GPIO_NUC980_GPIO_H
#define HW_GPIO_NUC980_GPIO_H

#include "hw/misc/nuc980_pins.h"
#include "hw/sysbus.h"
#include "qemu/bitmap.h"

#define TYPE_NUC980_GPIO "nuc980-gpio"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980GPIOState, NUC980_GPIO)

#define NUC980_GPIO_SIZE        0x1000
#define NUC980_GPIO_PORTS       7
#define NUC980_GPIO_EINTS       4
#define NUC980_GPIO_REGS        13      /* of a port, from MODE to PUSEL */

typedef struct NUC980GPIOPort {
    uint32_t regs[NUC980_GPIO_REGS];
    uint16_t level;                 /* of the pins, as inputs see it */
    uint16_t driven, drive;         /* from outside: which pins, and to what */
    uint16_t peripheral;            /* pins that are no GPIO */
    uint16_t eint;                  /* pins that are external interrupts */
} NUC980GPIOPort;

/*
 * Interrupts: 0 to 6 of the ports, 7 to 10 the external ones EINT0 to EINT3.
 * Named GPIO inputs "peripheral" and "eint": from the pins, as they name them.
 * Boolean properties "PA0" to "PG15": a pin's level. Set from outside, as by a
 * key, it stays, also through a reset.
 */
struct NUC980GPIOState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq[NUC980_GPIO_PORTS], eint[NUC980_GPIO_EINTS];
    NUC980GPIOPort port[NUC980_GPIO_PORTS];
    uint32_t dbctl;
    DECLARE_BITMAP(seen, NUC980_GPIO_SIZE / 4);
};

#endif /* HW_GPIO_NUC980_GPIO_H */
