/*
 * Nuvoton NUC980: the blocks that are not modelled
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 *
 * Registers read as 0 and forget what is written. The first access to each is
 * logged (-d unimp) with its block's name.
 */

#include "qemu/osdep.h"
#include "hw/misc/nuc980_unimp.h"
#include "hw/misc/nuc980_unmodelled.h"

static const struct {
    hwaddr base;
    const char *name;
} blocks[] = {
    { 0x10000, "nuc980-ebi" },
    { 0x14000, "nuc980-ccap1" },
    { 0x15000, "nuc980-ehci" },
    { 0x16000, "nuc980-usbd" },
    { 0x17000, "nuc980-ohci" },
    { 0x18000, "nuc980-sdh" },
    { 0x1c000, "nuc980-crypto" },
    { 0x20000, "nuc980-i2s" },
    { 0x24000, "nuc980-ccap0" },
    { 0x43000, "nuc980-adc" },
    { 0x58000, "nuc980-pwm0" },
    { 0x59000, "nuc980-pwm1" },
    { 0x80000, "nuc980-i2c0" },
    { 0x81000, "nuc980-i2c1" },
    { 0x82000, "nuc980-i2c2" },
    { 0x83000, "nuc980-i2c3" },
    { 0x90000, "nuc980-sc0" },
    { 0x91000, "nuc980-sc1" },
    { 0xa0000, "nuc980-can0" },
    { 0xa1000, "nuc980-can1" },
    { 0xa2000, "nuc980-can2" },
    { 0xa3000, "nuc980-can3" },
};

#define BLOCK_SIZE   0x1000

static void unmodelled_log(NUC980UnmodelledState *s, hwaddr addr)
{
    hwaddr base = addr & ~(hwaddr)(BLOCK_SIZE - 1);

    for (int i = 0; i < ARRAY_SIZE(blocks); i++) {
        if (blocks[i].base == base) {
            nuc980_unimp_once(s->seen + BIT_WORD(base / 4), blocks[i].name,
                              addr - base);
            return;
        }
    }
    /* beside the blocks: counted from the chip's first register */
    nuc980_unimp_once(s->seen, "nuc980", addr);
}

static uint64_t unmodelled_read(void *opaque, hwaddr addr, unsigned size)
{
    unmodelled_log(opaque, addr);
    return 0;
}

static void unmodelled_write(void *opaque, hwaddr addr, uint64_t value,
                             unsigned size)
{
    unmodelled_log(opaque, addr);
}

static const MemoryRegionOps unmodelled_ops = {
    .read = unmodelled_read,
    .write = unmodelled_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .impl = { .min_access_size = 1, .max_access_size = 4 },
};

static void unmodelled_init(Object *obj)
{
    NUC980UnmodelledState *s = NUC980_UNMODELLED(obj);

    memory_region_init_io(&s->iomem, obj, &unmodelled_ops, s,
                          TYPE_NUC980_UNMODELLED, NUC980_IO_SIZE);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
}

static const TypeInfo unmodelled_types[] = {
    {
        .name = TYPE_NUC980_UNMODELLED,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980UnmodelledState),
        .instance_init = unmodelled_init,
    },
};

DEFINE_TYPES(unmodelled_types)
