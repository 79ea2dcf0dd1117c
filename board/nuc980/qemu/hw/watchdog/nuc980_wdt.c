/*
 * Nuvoton NUC980 WDT
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "hw/watchdog/nuc980_wdt.h"
#include "hw/qdev-clock.h"
#include "hw/qdev-properties.h"

static uint64_t wdt_read(void *opaque, hwaddr addr, unsigned size)
{
    return NUC980_WDT(opaque)->regs[addr / 4];
}

static void wdt_write(void *opaque, hwaddr addr, uint64_t value, unsigned size)
{
    NUC980_WDT(opaque)->regs[addr / 4] = value;
}

static const MemoryRegionOps wdt_ops = {
    .read = wdt_read,
    .write = wdt_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
};

static void wdt_line(void *opaque, int n, int level)
{
}

static void wdt_init(Object *obj)
{
    NUC980WDTState *s = NUC980_WDT(obj);

    memory_region_init_io(&s->iomem, obj, &wdt_ops, s, TYPE_NUC980_WDT,
                          0x1000);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq[0]);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq[1]);
    qdev_init_gpio_in_named(DEVICE(obj), wdt_line, "rmii", 1);
    qdev_init_gpio_in_named(DEVICE(obj), wdt_line, "mdio", 1);
    qdev_init_gpio_in_named(DEVICE(obj), wdt_line, "unlocked", 1);
    s->clk = qdev_init_clock_in(DEVICE(obj), "clk", NULL, NULL, 0);
}

static Property wdt_properties[] = {
    DEFINE_NIC_PROPERTIES(NUC980WDTState, conf),
    DEFINE_PROP_END_OF_LIST(),
};

static void wdt_class_init(ObjectClass *klass, void *data)
{
    device_class_set_props(DEVICE_CLASS(klass), wdt_properties);
}

static const TypeInfo wdt_types[] = {
    {
        .name = TYPE_NUC980_WDT,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980WDTState),
        .instance_init = wdt_init,
        .class_init = wdt_class_init,
    },
};

DEFINE_TYPES(wdt_types)
