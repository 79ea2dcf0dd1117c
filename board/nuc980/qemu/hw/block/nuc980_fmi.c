/*
 * Nuvoton NUC980 flash memory interface: raw NAND
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "exec/address-spaces.h"
#include "hw/irq.h"
#include "hw/block/flash.h"
#include "qemu/log.h"
#include "qemu/module.h"
#include "sysemu/dma.h"
#include "hw/block/nuc980_fmi.h"

#define F(off) s->r[(off) / 4]

static void fmi_pins(NUC980FMIState *s, int cle, int ale)
{
    nand_setpins(s->nand, cle, ale, 0, F(0x8c0) & 1, 1);
}

static void fmi_irq(NUC980FMIState *s)
{
    qemu_set_irq(s->irq, F(0x8ac) & F(0x8a8) & 5);
}

static void fmi_dma(NUC980FMIState *s, bool write)
{
    static const int psz[] = { 512, 2048, 4096, 8192 };
    int n = psz[(F(0x8a0) >> 16) & 3];
    int ra = F(0x8bc) & 0x1ff;
    hwaddr a = F(0x408);
    uint8_t b;

    fmi_pins(s, 0, 0);
    for (int i = 0; i < n; i++) {
        if (write) {
            dma_memory_read(&address_space_memory, a + i, &b, 1,
                            MEMTXATTRS_UNSPECIFIED);
            nand_setio(s->nand, b);
        } else {
            b = nand_getio(s->nand);
            dma_memory_write(&address_space_memory, a + i, &b, 1,
                             MEMTXATTRS_UNSPECIFIED);
        }
    }
    if (write && (F(0x8a0) & 0x10)) {
        /* parity is not computed: the spare bytes go out as they stand */
        for (int i = 0; i < ra; i++) {
            nand_setio(s->nand, F(0xa00 + (i & ~3)) >> (8 * (i & 3)));
        }
    }
    F(0x8ac) |= 1;
}

static uint64_t fmi_read(void *opaque, hwaddr a, unsigned size)
{
    NUC980FMIState *s = opaque;

    if (a == 0x8b8) {
        if (!s->nand) {
            return 0xff;
        }
        fmi_pins(s, 0, 0);
        return nand_getio(s->nand);
    }
    if (a == 0x8ac) {
        return F(a) | 1 << 18;          /* R/B pin is pulled up */
    }
    return F(a);
}

static void fmi_write(void *opaque, hwaddr a, uint64_t v, unsigned size)
{
    NUC980FMIState *s = opaque;

    switch (a) {
    case 0x400:
        F(a) = v & ~2;
        break;
    case 0x800:
        F(a) = v & ~1;
        break;
    case 0x8a0:
        F(a) = v & ~7;
        if (s->nand && (v & 6)) {
            fmi_dma(s, v & 4);
        }
        break;
    case 0x8ac:
        F(a) &= ~v;
        break;
    case 0x8b0: case 0x8b4: case 0x8b8:
        if (s->nand) {
            fmi_pins(s, a == 0x8b0, a == 0x8b4);
            nand_setio(s->nand, v & 0xff);
            fmi_pins(s, 0, 0);
        }
        if (a != 0x8b8) {
            F(0x8ac) |= 0x400;
        }
        break;
    default:
        F(a) = v;
        break;
    }
    fmi_irq(s);
}

static const MemoryRegionOps fmi_ops = {
    .read = fmi_read, .write = fmi_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

/* the redundant-area buffer is byte addressable */
static uint64_t smra_read(void *opaque, hwaddr a, unsigned size)
{
    NUC980FMIState *s = opaque;

    return ((uint8_t *)&F(0xa00))[a];
}

static void smra_write(void *opaque, hwaddr a, uint64_t v, unsigned size)
{
    NUC980FMIState *s = opaque;

    ((uint8_t *)&F(0xa00))[a] = v;
}

static const MemoryRegionOps smra_ops = {
    .read = smra_read, .write = smra_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 1, .max_access_size = 4 },
    .impl = { .min_access_size = 1, .max_access_size = 1 },
};

static void fmi_set_pins(void *opaque, int n, int level)
{
}

static void fmi_init(Object *obj)
{
    NUC980FMIState *s = NUC980_FMI(obj);
    MemoryRegion *ra = g_new0(MemoryRegion, 1);

    memory_region_init_io(&s->iomem, obj, &fmi_ops, s, "nuc980-fmi", 0x1000);
    memory_region_init_io(ra, obj, &smra_ops, s, "nuc980-fmi.ra", 0x200);
    memory_region_add_subregion(&s->iomem, 0xa00, ra);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq);
    qdev_init_gpio_in_named(DEVICE(obj), fmi_set_pins, "pins", 1);
}

static const TypeInfo nuc980_fmi_types[] = {
    {
        .name = TYPE_NUC980_FMI,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980FMIState),
        .instance_init = fmi_init,

    },
};

DEFINE_TYPES(nuc980_fmi_types)
