/*
 * Nuvoton NUC980 system and clock registers
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "hw/irq.h"
#include "hw/misc/nuc980_sys.h"
#include "hw/qdev-clock.h"
#include "hw/qdev-properties.h"
#include "migration/vmstate.h"
#include "qemu/log.h"
#include "sysemu/runstate.h"

#define XIN_HZ      12000000
#define X32K_HZ     32768

#define REG(s, offset) ((s)->regs[(offset) / 4])

enum {
    SYS_PDID = 0x000,
    SYS_PWRON = 0x004,
    SYS_AHBIPRST = 0x060,
    SYS_RSTSTS = 0x06c,
    SYS_MFP = 0x070,
    SYS_MFP_END = SYS_MFP + 4 * NUC980_MFP_REGS,
    SYS_REGWPCTL = 0x1fc,
    CLK_HCLKEN = 0x210,
    CLK_PCLKEN0 = 0x218,
    CLK_DIV0 = 0x220,
    CLK_DIV4 = 0x230,
    CLK_DIV8 = 0x240,
    CLK_APLLCON = 0x260,
    CLK_UPLLCON = 0x264,
};

static unsigned pll_hz(uint32_t con)
{
    unsigned n = extract32(con, 0, 7) + 1;
    unsigned m = extract32(con, 7, 6) + 1;
    unsigned p = extract32(con, 13, 3) + 1;

    return XIN_HZ / (m * p) * n;
}

static unsigned source_hz(NUC980SysState *s, unsigned mux)
{
    switch (mux & 3) {
    case 0:
        return XIN_HZ;
    case 1:
        return X32K_HZ;
    case 2:
        return pll_hz(REG(s, CLK_APLLCON));
    default:
        return pll_hz(REG(s, CLK_UPLLCON));
    }
}

static unsigned hclk_hz(NUC980SysState *s)
{
    uint32_t div0 = REG(s, CLK_DIV0);

    return source_hz(s, div0 >> 3) / (extract32(div0, 8, 1) + 1) / 2;
}

static unsigned etimer_hz(NUC980SysState *s, int n)
{
    switch (extract32(REG(s, CLK_DIV8), 16 + 2 * n, 2)) {
    case 0:
        return XIN_HZ;
    case 1:
        return hclk_hz(s);
    case 2:
        return hclk_hz(s) / 4096;
    default:
        return X32K_HZ;
    }
}

static void sys_update_clocks(NUC980SysState *s)
{
    for (int i = 0; i < NUC980_UARTS; i++) {
        uint32_t div = REG(s, CLK_DIV4 + 4 * (i / 4)) >> (8 * (i % 4));

        clock_update_hz(s->uart_clk[i],
                        source_hz(s, div >> 3) / (extract32(div, 5, 3) + 1));
    }
    for (int i = 0; i < NUC980_TIMERS; i++) {
        clock_update_hz(s->etimer_clk[i], etimer_hz(s, i));
    }
    clock_update_hz(s->wdt_clk, X32K_HZ);
    clock_update_hz(s->hclk, hclk_hz(s));
}

static uint64_t sys_read(void *opaque, hwaddr addr, unsigned size)
{
    NUC980SysState *s = opaque;

    return addr == SYS_REGWPCTL ? s->unlock == 3 : REG(s, addr);
}

static void sys_unlock(NUC980SysState *s, uint32_t value)
{
    static const uint8_t key[] = { 0x59, 0x16, 0x88 };

    if (s->unlock < 3 && value == key[s->unlock]) {
        s->unlock++;
    } else {
        s->unlock = value == key[0];
    }
    qemu_set_irq(s->unlocked, s->unlock == 3);
}

static void sys_write(void *opaque, hwaddr addr, uint64_t value, unsigned size)
{
    NUC980SysState *s = opaque;

    switch (addr) {
    case SYS_PDID:
        return;
    case SYS_AHBIPRST:
        if (value & 1) {
            qemu_system_reset_request(SHUTDOWN_CAUSE_GUEST_RESET);
            return;
        }
        break;
    case SYS_RSTSTS:
        REG(s, addr) &= ~value;
        return;
    case SYS_REGWPCTL:
        sys_unlock(s, value);
        return;
    case SYS_MFP ... SYS_MFP_END - 4:
        nuc980_pins_write(s->pins, (addr - SYS_MFP) / 4, value);
        break;
    }
    REG(s, addr) = value;
    if (addr >= CLK_DIV0) {
        sys_update_clocks(s);
    }
}

static const MemoryRegionOps sys_ops = {
    .read = sys_read,
    .write = sys_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

static void sys_reset(DeviceState *dev)
{
    NUC980SysState *s = NUC980_SYS(dev);

    memset(s->regs, 0, sizeof(s->regs));
    s->unlock = 0;
    REG(s, SYS_PDID) = 0x1030d016;      /* guess: nothing reads it */
    REG(s, SYS_PWRON) = s->pwron;
    REG(s, SYS_RSTSTS) = 1;
    REG(s, CLK_HCLKEN) = 0x00000527;
    REG(s, CLK_APLLCON) = 0x50000015;
    REG(s, CLK_UPLLCON) = 0xd0000015;
    if (s->booted) {
        REG(s, CLK_PCLKEN0) = 0x00010000;
        REG(s, CLK_DIV0) = 0x00000018;
        REG(s, CLK_UPLLCON) = 0xd0000018;
    }
    for (int i = 0; i < NUC980_MFP_REGS; i++) {
        nuc980_pins_write(s->pins, i, 0);
    }
    sys_update_clocks(s);
}

static void sys_init(Object *obj)
{
    NUC980SysState *s = NUC980_SYS(obj);
    DeviceState *dev = DEVICE(obj);

    memory_region_init_io(&s->iomem, obj, &sys_ops, s, TYPE_NUC980_SYS,
                          4 * NUC980_SYS_REGS);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    qdev_init_gpio_out_named(dev, &s->unlocked, "unlocked", 1);
    for (int i = 0; i < NUC980_UARTS; i++) {
        g_autofree char *name = g_strdup_printf("uart%d", i);

        s->uart_clk[i] = qdev_init_clock_out(dev, name);
    }
    for (int i = 0; i < NUC980_TIMERS; i++) {
        g_autofree char *name = g_strdup_printf("etimer%d", i);

        s->etimer_clk[i] = qdev_init_clock_out(dev, name);
    }
    s->wdt_clk = qdev_init_clock_out(dev, "wdt");
    s->hclk = qdev_init_clock_out(dev, "hclk");
}

static Property sys_properties[] = {
    DEFINE_PROP_LINK("pins", NUC980SysState, pins, TYPE_NUC980_PINS,
                     NUC980PinsState *),
    /* guess: NAND page size and ECC "auto", seen to work with U-Boot */
    DEFINE_PROP_UINT32("pwron", NUC980SysState, pwron, 0x3d0),
    DEFINE_PROP_BOOL("booted", NUC980SysState, booted, false),
    DEFINE_PROP_END_OF_LIST(),
};

static void sys_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->reset = sys_reset;
    device_class_set_props(dc, sys_properties);
}

static const TypeInfo sys_types[] = {
    {
        .name = TYPE_NUC980_SYS,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980SysState),
        .instance_init = sys_init,
        .class_init = sys_class_init,
    },
};

DEFINE_TYPES(sys_types)
