/*
 * Nuvoton NUC980 GPIO, ports A to G
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "qemu/log.h"
#include "qemu/module.h"
#include "hw/gpio/nuc980_gpio.h"

static uint64_t gpio_read(void *opaque, hwaddr a, unsigned size)
{
    NUC980GPIOState *s = opaque;

    if (a < 0x1c0 && (a & 0x3f) == 0x10) {
        return s->r[(a - 8) / 4];   /* PIN follows DOUT */
    }
    return s->r[a / 4];
}

static void gpio_write(void *opaque, hwaddr a, uint64_t v, unsigned size)
{
    NUC980GPIOState *s = opaque;

    if (a < 0x1c0 && (a & 0x3f) == 0x20) {
        s->r[a / 4] &= ~v;
        return;
    }
    s->r[a / 4] = v;
}

static const MemoryRegionOps gpio_ops = {
    .read = gpio_read, .write = gpio_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

static void gpio_init(Object *obj)
{
    NUC980GPIOState *s = NUC980_GPIO(obj);

    memory_region_init_io(&s->iomem, obj, &gpio_ops, s, "nuc980-gpio",
                          0x1000);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
}

static const TypeInfo nuc980_gpio_types[] = {
    {
        .name = TYPE_NUC980_GPIO,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980GPIOState),
        .instance_init = gpio_init,

    },
};

DEFINE_TYPES(nuc980_gpio_types)
