/*
 * Nuvoton NUC980 SDRAM controller: what a boot loader reads of it
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "hw/misc/nuc980_sdic.h"
#include "hw/qdev-properties.h"
#include "migration/vmstate.h"

enum {
    SDIC_SIZE0 = 0x10,              /* [2:0] 1: 2 MiB, 2: 4 MiB .. 7: 128 MiB */
};

static uint64_t sdic_read(void *opaque, hwaddr addr, unsigned size)
{
    NUC980SDICState *s = opaque;

    return s->regs[addr / 4];
}

static void sdic_write(void *opaque, hwaddr addr, uint64_t value, unsigned size)
{
    NUC980SDICState *s = opaque;

    s->regs[addr / 4] = value;
}

static const MemoryRegionOps sdic_ops = {
    .read = sdic_read,
    .write = sdic_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

static void sdic_reset(DeviceState *dev)
{
    NUC980SDICState *s = NUC980_SDIC(dev);

    memset(s->regs, 0, sizeof(s->regs));
    s->regs[SDIC_SIZE0 / 4] = ctz32(s->ram_mib);
}

static void sdic_init(Object *obj)
{
    NUC980SDICState *s = NUC980_SDIC(obj);

    memory_region_init_io(&s->iomem, obj, &sdic_ops, s, TYPE_NUC980_SDIC,
                          4 * NUC980_SDIC_REGS);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
}

static const VMStateDescription vmstate_nuc980_sdic = {
    .name = TYPE_NUC980_SDIC,
    .version_id = 1,
    .minimum_version_id = 1,
    .fields = (VMStateField[]) {
        VMSTATE_UINT32_ARRAY(regs, NUC980SDICState, NUC980_SDIC_REGS),
        VMSTATE_END_OF_LIST()
    }
};

static Property sdic_properties[] = {
    DEFINE_PROP_UINT32("ram-mib", NUC980SDICState, ram_mib, 64),
    DEFINE_PROP_END_OF_LIST(),
};

static void sdic_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->reset = sdic_reset;
    dc->vmsd = &vmstate_nuc980_sdic;
    device_class_set_props(dc, sdic_properties);
}

static const TypeInfo sdic_types[] = {
    {
        .name = TYPE_NUC980_SDIC,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980SDICState),
        .instance_init = sdic_init,
        .class_init = sdic_class_init,
    },
};

DEFINE_TYPES(sdic_types)
