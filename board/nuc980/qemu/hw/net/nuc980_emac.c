/*
 * Nuvoton NUC980 EMAC
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "hw/net/nuc980_emac.h"
#include "hw/qdev-clock.h"
#include "hw/qdev-properties.h"

static uint64_t emac_read(void *opaque, hwaddr addr, unsigned size)
{
    return NUC980_EMAC(opaque)->regs[addr / 4];
}

static void emac_write(void *opaque, hwaddr addr, uint64_t value, unsigned size)
{
    NUC980_EMAC(opaque)->regs[addr / 4] = value;
}

static const MemoryRegionOps emac_ops = {
    .read = emac_read,
    .write = emac_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
};

static void emac_line(void *opaque, int n, int level)
{
}

static void emac_init(Object *obj)
{
    NUC980EMACState *s = NUC980_EMAC(obj);

    memory_region_init_io(&s->iomem, obj, &emac_ops, s, TYPE_NUC980_EMAC,
                          0x1000);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq[0]);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq[1]);
    qdev_init_gpio_in_named(DEVICE(obj), emac_line, "rmii", 1);
    qdev_init_gpio_in_named(DEVICE(obj), emac_line, "mdio", 1);
    qdev_init_gpio_in_named(DEVICE(obj), emac_line, "unlocked", 1);
    s->clk = qdev_init_clock_in(DEVICE(obj), "clk", NULL, NULL, 0);
}

static Property emac_properties[] = {
    DEFINE_NIC_PROPERTIES(NUC980EMACState, conf),
    DEFINE_PROP_END_OF_LIST(),
};

static void emac_class_init(ObjectClass *klass, void *data)
{
    device_class_set_props(DEVICE_CLASS(klass), emac_properties);
}

static const TypeInfo emac_types[] = {
    {
        .name = TYPE_NUC980_EMAC,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980EMACState),
        .instance_init = emac_init,
        .class_init = emac_class_init,
    },
};

DEFINE_TYPES(emac_types)
