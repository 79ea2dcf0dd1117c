/*
 * Nuvoton NUC980 SDRAM controller: what a boot loader reads of it
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 *
 * The RAM is there from the start, at address 0; timing and calibration are
 * not modelled.
 */

#include "qemu/osdep.h"
#include "hw/misc/nuc980_sdic.h"
#include "hw/misc/nuc980_unimp.h"
#include "hw/qdev-properties.h"
#include "hw/registerfields.h"
#include "migration/vmstate.h"

REG32(SDIC_SIZE0, 0x10)             /* 0: no bank, 1: 2 MiB .. 7: 128 MiB */
REG32(SDIC_SIZE1, 0x14)

static uint64_t sdic_read(void *opaque, hwaddr addr, unsigned size)
{
    NUC980SDICState *s = opaque;

    switch (addr) {
    case A_SDIC_SIZE0 ... A_SDIC_SIZE1:
        return s->size[(addr - A_SDIC_SIZE0) / 4];
    default:
        nuc980_unimp_once(s->seen, TYPE_NUC980_SDIC, addr);
        return 0;
    }
}

static void sdic_write(void *opaque, hwaddr addr, uint64_t value, unsigned size)
{
    NUC980SDICState *s = opaque;

    nuc980_unimp_once(s->seen, TYPE_NUC980_SDIC, addr);
    if (addr == A_SDIC_SIZE0 || addr == A_SDIC_SIZE1) {
        s->size[(addr - A_SDIC_SIZE0) / 4] = value;     /* moves no RAM */
    }
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

    s->size[0] = ctz32(s->ram_mib);
    s->size[1] = 0;
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
        VMSTATE_UINT32_ARRAY(size, NUC980SDICState, 2),
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
