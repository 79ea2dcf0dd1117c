/*
 * Nuvoton NUC980 (Q)SPI controller
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "qemu/log.h"
#include "qemu/module.h"
#include "hw/ssi/nuc980_spi.h"

static uint64_t spi_read(void *opaque, hwaddr a, unsigned size)
{
    NUC980SPIState *s = opaque;

    switch (a) {
    case 0x14:
        return 0x10000 | (s->r[0] & 1 ? 0x8000 : 0) | (s->rx_n ? 0 : 0x100);
    case 0x30:
        s->rx_n = MAX(s->rx_n - 1, 0);
        return 0xffffffff;
    }
    return a < sizeof(s->r) ? s->r[a / 4] : 0;
}

static void spi_write(void *opaque, hwaddr a, uint64_t v, unsigned size)
{
    NUC980SPIState *s = opaque;

    if (a == 0x20) {
        s->rx_n = MIN(s->rx_n + 1, 8);
    } else if (a == 0x10) {                     /* FIFOCTL: resets self-clear */
        s->rx_n = v & 3 ? 0 : s->rx_n;
        s->r[a / 4] = v & ~3;
    } else if (a < sizeof(s->r)) {
        s->r[a / 4] = v;
    }
}

static const MemoryRegionOps spi_ops = {
    .read = spi_read, .write = spi_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

static void spi_init(Object *obj)
{
    NUC980SPIState *s = NUC980_SPI(obj);

    memory_region_init_io(&s->iomem, obj, &spi_ops, s, "nuc980-spi", 0x1000);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
}

static const TypeInfo nuc980_spi_types[] = {
    {
        .name = TYPE_NUC980_SPI,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980SPIState),
        .instance_init = spi_init,

    },
};

DEFINE_TYPES(nuc980_spi_types)
