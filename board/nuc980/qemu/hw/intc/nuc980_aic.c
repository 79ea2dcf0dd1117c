/*
 * Nuvoton NUC980 advanced interrupt controller
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "hw/irq.h"
#include "qemu/log.h"
#include "qemu/module.h"
#include "hw/intc/nuc980_aic.h"

static int aic_best(NUC980AICState *s, bool fiq)
{
    uint64_t p = s->level & s->mask;
    int best = 0, bestprio = 8;

    while (p) {
        int n = ctz64(p);
        int prio = (s->srcctl[n / 4] >> (8 * (n % 4))) & 7;
        p &= p - 1;
        if ((prio == 0) == fiq && prio < bestprio) {
            best = n;
            bestprio = prio;
        }
    }
    return best;
}

static void aic_update(NUC980AICState *s)
{
    qemu_set_irq(s->irq, aic_best(s, false) != 0);
    qemu_set_irq(s->fiq, aic_best(s, true) != 0);
}

static void aic_set(void *opaque, int n, int level)
{
    NUC980AICState *s = opaque;

    s->level = deposit64(s->level, n, 1, !!level);
    aic_update(s);
}

static uint64_t aic_read(void *opaque, hwaddr a, unsigned size)
{
    NUC980AICState *s = opaque;

    switch (a) {
    case 0x00 ... 0x3c:
        return s->srcctl[a / 4];
    case 0x100: case 0x104:         /* RAWSTS */
        return s->level >> (a == 0x104 ? 32 : 0);
    case 0x108: case 0x10c:         /* ACTSTS */
    case 0x110: case 0x114:         /* INTSTS */
        return (s->level & s->mask) >> ((a & 4) ? 32 : 0);
    case 0x120:                     /* IRQNUM */
        return aic_best(s, false);
    case 0x124:                     /* FIQNUM */
        return aic_best(s, true);
    case 0x128: case 0x12c:         /* INTMSK */
        return s->mask >> (a == 0x12c ? 32 : 0);
    }
    return 0;
}

static void aic_write(void *opaque, hwaddr a, uint64_t v, unsigned size)
{
    NUC980AICState *s = opaque;

    switch (a) {
    case 0x00 ... 0x3c:
        s->srcctl[a / 4] = v;
        break;
    case 0x130:
        s->mask |= v;
        break;
    case 0x134:
        s->mask |= v << 32;
        break;
    case 0x138:
        s->mask &= ~v;
        break;
    case 0x13c:
        s->mask &= ~(v << 32);
        break;
    case 0x150: case 0x154:         /* EOIS/EOFS: no in-service stack modelled */
        break;
    }
    aic_update(s);
}

static const MemoryRegionOps aic_ops = {
    .read = aic_read, .write = aic_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

static void aic_reset(DeviceState *dev)
{
    NUC980AICState *s = NUC980_AIC(dev);

    s->mask = 0;
    for (int i = 0; i < 16; i++) {
        s->srcctl[i] = 0x47474747;
    }
}

static void aic_init(Object *obj)
{
    NUC980AICState *s = NUC980_AIC(obj);

    memory_region_init_io(&s->iomem, obj, &aic_ops, s, "nuc980-aic", 0x1000);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    qdev_init_gpio_in(DEVICE(obj), aic_set, 64);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->fiq);
}

static void aic_class_init(ObjectClass *k, void *data)
{
    DEVICE_CLASS(k)->reset = aic_reset;
}

static const TypeInfo nuc980_aic_types[] = {
    {
        .name = TYPE_NUC980_AIC,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980AICState),
        .instance_init = aic_init,
        .class_init = aic_class_init,
    },
};

DEFINE_TYPES(nuc980_aic_types)
