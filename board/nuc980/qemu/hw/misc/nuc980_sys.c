/*
 * Nuvoton NUC980 system and clock registers
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 *
 * Reset and its causes, write protection, pin functions (nuc980_pins.c), and
 * the clock tree. Clock gates are kept but stop no clock: a guest that forgets
 * to open one runs here, and not on the chip.
 */

#include "qemu/osdep.h"
#include "hw/irq.h"
#include "hw/misc/nuc980_sys.h"
#include "hw/misc/nuc980_unimp.h"
#include "hw/qdev-clock.h"
#include "hw/qdev-properties.h"
#include "hw/registerfields.h"
#include "migration/vmstate.h"
#include "sysemu/runstate.h"
#include "trace.h"

#define XIN_HZ      12000000
#define X32K_HZ     32768

REG32(SYS_PDID, 0x000)
REG32(SYS_PWRON, 0x004)
REG32(SYS_MISCFCR, 0x030)
REG32(SYS_AHBIPRST, 0x060)
    FIELD(SYS_AHBIPRST, CHIP, 0, 1)
REG32(SYS_APBIPRST0, 0x064)
REG32(SYS_APBIPRST1, 0x068)
REG32(SYS_RSTSTS, 0x06c)            /* write 1 to clear */
    FIELD(SYS_RSTSTS, POR, 0, 1)    /* guess: the place of this bit */
    FIELD(SYS_RSTSTS, CHIP, 3, 1)   /* guess: the place of this bit */
    FIELD(SYS_RSTSTS, WDT, 5, 1)    /* the vendor's watchdog driver */
REG32(SYS_GPA_MFPL, 0x070)
REG32(SYS_GPG_MFPH, 0x0a4)
REG32(SYS_RSTDEBCTL, 0x10c)
REG32(SYS_REGWPCTL, 0x1fc)
REG32(CLK_HCLKEN, 0x210)
REG32(CLK_PCLKEN0, 0x218)
REG32(CLK_PCLKEN1, 0x21c)
REG32(CLK_DIV0, 0x220)
    FIELD(CLK_DIV0, SYS_SOURCE, 3, 2)
    FIELD(CLK_DIV0, SYS_DIVIDER, 8, 1)
REG32(CLK_DIV4, 0x230)              /* a byte for each UART, to DIV6 */
    FIELD(CLK_DIV4, SOURCE, 3, 2)
    FIELD(CLK_DIV4, DIVIDER, 5, 3)
REG32(CLK_DIV6, 0x238)
REG32(CLK_DIV8, 0x240)
    FIELD(CLK_DIV8, WDT, 8, 2)
    FIELD(CLK_DIV8, WWDT, 10, 2)
    FIELD(CLK_DIV8, ETIMER, 16, 12) /* two bits for each timer */
REG32(CLK_APLLCON, 0x260)
    FIELD(CLK_APLLCON, N, 0, 7)     /* UPLLCON is the same */
    FIELD(CLK_APLLCON, M, 7, 6)
    FIELD(CLK_APLLCON, P, 13, 3)
REG32(CLK_UPLLCON, 0x264)

/* The last of the three makes what is protected writable. */
static const uint8_t keys[] = { 0x59, 0x16, 0x88 };

/*
 * The two top bits of a PLL's register, its power-down and its reset, are kept
 * only: sources disagree on them, and nobody switches a PLL off.
 */
static unsigned pll_hz(uint32_t con)
{
    return (uint64_t)XIN_HZ * (FIELD_EX32(con, CLK_APLLCON, N) + 1) /
           (FIELD_EX32(con, CLK_APLLCON, M) + 1) /
           (FIELD_EX32(con, CLK_APLLCON, P) + 1);
}

/* What UARTs and the system can choose from */
static unsigned source_hz(NUC980SysState *s, unsigned source)
{
    switch (source) {
    case 0:
        return XIN_HZ;
    case 1:
        return X32K_HZ;
    case 2:
        return pll_hz(s->regs[R_CLK_APLLCON]);
    default:
        return pll_hz(s->regs[R_CLK_UPLLCON]);
    }
}

/* HCLK, and as fast: HCLK1, PCLK0, PCLK1 */
static unsigned hclk_hz(NUC980SysState *s)
{
    uint32_t div0 = s->regs[R_CLK_DIV0];

    return source_hz(s, FIELD_EX32(div0, CLK_DIV0, SYS_SOURCE)) /
           (FIELD_EX32(div0, CLK_DIV0, SYS_DIVIDER) + 1) / 2;
}

static unsigned uart_hz(NUC980SysState *s, int n)
{
    uint8_t div = s->regs[R_CLK_DIV4 + n / 4] >> (8 * (n % 4));

    return source_hz(s, FIELD_EX8(div, CLK_DIV4, SOURCE)) /
           (FIELD_EX8(div, CLK_DIV4, DIVIDER) + 1);
}

static unsigned etimer_hz(NUC980SysState *s, int n)
{
    uint32_t sources = FIELD_EX32(s->regs[R_CLK_DIV8], CLK_DIV8, ETIMER);

    switch (extract32(sources, 2 * n, 2)) {
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

/* Both watchdogs are on PCLK2, which is half of HCLK. */
static unsigned watchdog_hz(NUC980SysState *s, unsigned source)
{
    switch (source) {
    case 0:
        return XIN_HZ;
    case 1:
        return XIN_HZ / 512;
    case 2:
        return hclk_hz(s) / 2 / 4096;
    default:
        return X32K_HZ;
    }
}

static void sys_update_clocks(NUC980SysState *s)
{
    uint32_t div8 = s->regs[R_CLK_DIV8];

    for (int i = 0; i < NUC980_UARTS; i++) {
        clock_update_hz(s->uart_clk[i], uart_hz(s, i));
    }
    for (int i = 0; i < NUC980_TIMERS; i++) {
        clock_update_hz(s->etimer_clk[i], etimer_hz(s, i));
    }
    clock_update_hz(s->wdt_clk,
                    watchdog_hz(s, FIELD_EX32(div8, CLK_DIV8, WDT)));
    clock_update_hz(s->wwdt_clk,
                    watchdog_hz(s, FIELD_EX32(div8, CLK_DIV8, WWDT)));
    clock_update_hz(s->hclk, hclk_hz(s));
    trace_nuc980_sys_clocks(hclk_hz(s));
}

static bool sys_is_modelled(hwaddr addr)
{
    switch (addr) {
    case A_SYS_PDID ... A_SYS_PWRON:
    case A_SYS_AHBIPRST ... A_SYS_GPG_MFPH:
    case A_SYS_RSTDEBCTL:           /* stored: no reset pin to debounce */
    case A_SYS_REGWPCTL:
    case A_CLK_HCLKEN:
    case A_CLK_PCLKEN0 ... A_CLK_DIV0:
    case A_CLK_DIV4 ... A_CLK_DIV6:
    case A_CLK_DIV8:
    case A_CLK_APLLCON ... A_CLK_UPLLCON:
        return true;
    default:
        return false;
    }
}

/*
 * What the vendor's programs unlock before they write it; they set the reset
 * bits of single blocks with and without.
 */
static bool sys_is_protected(hwaddr addr, uint32_t value)
{
    switch (addr) {
    case A_SYS_AHBIPRST:
        return value & R_SYS_AHBIPRST_CHIP_MASK;
    case A_SYS_PWRON:
    case A_SYS_MISCFCR:
    case A_SYS_RSTDEBCTL:
        return true;
    default:
        return false;
    }
}

static uint64_t sys_read(void *opaque, hwaddr addr, unsigned size)
{
    NUC980SysState *s = opaque;

    if (!sys_is_modelled(addr)) {
        nuc980_unimp_once(s->seen, TYPE_NUC980_SYS, addr);
    }
    switch (addr) {
    case A_SYS_GPA_MFPL ... A_SYS_GPG_MFPH:
        return s->pins->mfp[(addr - A_SYS_GPA_MFPL) / 4];
    case A_SYS_REGWPCTL:
        return s->keys == ARRAY_SIZE(keys);
    default:
        return s->regs[addr / 4];
    }
}

static void sys_set_keys(NUC980SysState *s, uint32_t seen)
{
    s->keys = seen;
    qemu_set_irq(s->unlocked, s->keys == ARRAY_SIZE(keys));
}

/* Any write that is not the next key locks; the first key may come again. */
static void sys_write_key(NUC980SysState *s, uint32_t value)
{
    if (s->keys < ARRAY_SIZE(keys) && value == keys[s->keys]) {
        sys_set_keys(s, s->keys + 1);
    } else {
        sys_set_keys(s, value == keys[0]);
    }
}

static void sys_write_ahbiprst(NUC980SysState *s, uint32_t value)
{
    if (value & R_SYS_AHBIPRST_CHIP_MASK) {
        trace_nuc980_sys_chip_reset();
        s->cause = R_SYS_RSTSTS_CHIP_MASK;
        qemu_system_reset_request(SHUTDOWN_CAUSE_GUEST_RESET);
    }
}

/* A block is reset when its bit rises; that the bit holds it is not modelled */
static void sys_set_resets(NUC980SysState *s, int group, uint32_t value)
{
    uint32_t change = value ^ s->regs[R_SYS_AHBIPRST + group];

    s->regs[R_SYS_AHBIPRST + group] = value;
    for (; change; change &= change - 1) {
        int n = ctz32(change);

        qemu_set_irq(s->reset[32 * group + n], extract32(value, n, 1));
    }
}

static void sys_write(void *opaque, hwaddr addr, uint64_t value, unsigned size)
{
    NUC980SysState *s = opaque;

    trace_nuc980_sys_write(addr, value);
    if (!sys_is_modelled(addr)) {
        nuc980_unimp_once(s->seen, TYPE_NUC980_SYS, addr);
    }
    if (sys_is_protected(addr, value) && s->keys < ARRAY_SIZE(keys)) {
        qemu_log_mask(LOG_GUEST_ERROR, "%s: 0x%" HWADDR_PRIx " = 0x%" PRIx64
                      " needs REGWPCTL's three keys first\n", TYPE_NUC980_SYS,
                      addr, value);
        return;
    }
    switch (addr) {
    case A_SYS_PDID:
        qemu_log_mask(LOG_GUEST_ERROR, "%s: PDID can only be read\n",
                      TYPE_NUC980_SYS);
        return;
    case A_SYS_AHBIPRST:
        sys_write_ahbiprst(s, value);
        value &= ~R_SYS_AHBIPRST_CHIP_MASK;
        /* fallthrough */
    case A_SYS_APBIPRST0:
    case A_SYS_APBIPRST1:
        sys_set_resets(s, (addr - A_SYS_AHBIPRST) / 4, value);
        return;
    case A_SYS_RSTSTS:
        s->regs[R_SYS_RSTSTS] &= ~value;
        return;
    case A_SYS_REGWPCTL:
        sys_write_key(s, value);
        return;
    case A_SYS_GPA_MFPL ... A_SYS_GPG_MFPH:
        nuc980_pins_write(s->pins, (addr - A_SYS_GPA_MFPL) / 4, value);
        return;
    }
    s->regs[addr / 4] = value;
    if (addr >= A_CLK_DIV0) {
        sys_update_clocks(s);
    }
}

static const MemoryRegionOps sys_ops = {
    .read = sys_read,
    .write = sys_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

static void sys_watchdog(void *opaque, int n, int level)
{
    NUC980SysState *s = opaque;

    if (level) {
        s->cause = R_SYS_RSTSTS_WDT_MASK;
    }
}

/* guess: causes add up until they are cleared or the power goes */
static uint32_t sys_reset_status(NUC980SysState *s)
{
    uint32_t cause = s->cause;

    s->cause = 0;
    return cause ? s->regs[R_SYS_RSTSTS] | cause : R_SYS_RSTSTS_POR_MASK;
}

/* What the boot ROM, the SPL and U-Boot leave that a kernel relies on */
static void sys_set_booted(NUC980SysState *s)
{
    s->regs[R_CLK_HCLKEN] |= BIT(11);               /* GPIO */
    s->regs[R_CLK_PCLKEN0] |= BIT(16) | BIT(8);     /* UART0, ETIMER0 */
    s->regs[R_CLK_UPLLCON] = 0xd0000018;            /* 300 MHz */
    s->regs[R_CLK_DIV0] = 3 << R_CLK_DIV0_SYS_SOURCE_SHIFT;     /* UPLL */
}

static void sys_reset(DeviceState *dev)
{
    NUC980SysState *s = NUC980_SYS(dev);
    uint32_t status = sys_reset_status(s);

    trace_nuc980_sys_reset(status);
    for (int i = 0; i < NUC980_RESETS / 32; i++) {
        sys_set_resets(s, i, 0);
    }
    memset(s->regs, 0, sizeof(s->regs));
    sys_set_keys(s, 0);
    s->regs[R_SYS_RSTSTS] = status;
    s->regs[R_SYS_PWRON] = s->pwron;
    s->regs[R_SYS_PDID] = 0x1030d016;       /* guess: nothing reads it */
    s->regs[R_CLK_HCLKEN] = 0x00000527;     /* guess */
    s->regs[R_CLK_APLLCON] = 0x50000015;    /* guess: 264 MHz */
    s->regs[R_CLK_UPLLCON] = 0xd0000015;    /* guess: 264 MHz */
    if (s->booted) {
        sys_set_booted(s);
    }
    for (int i = 0; i < NUC980_MFP_REGS; i++) {
        nuc980_pins_write(s->pins, i, 0);   /* U-Boot, too, leaves them 0 */
    }
    sys_update_clocks(s);
}

static int sys_post_load(void *opaque, int version_id)
{
    NUC980SysState *s = opaque;

    sys_set_keys(s, s->keys);
    return 0;
}

static const VMStateDescription vmstate_nuc980_sys = {
    .name = TYPE_NUC980_SYS,
    .version_id = 1,
    .minimum_version_id = 1,
    .post_load = sys_post_load,
    .fields = (VMStateField[]) {
        VMSTATE_ARRAY_CLOCK(uart_clk, NUC980SysState, NUC980_UARTS),
        VMSTATE_ARRAY_CLOCK(etimer_clk, NUC980SysState, NUC980_TIMERS),
        VMSTATE_CLOCK(wdt_clk, NUC980SysState),
        VMSTATE_CLOCK(wwdt_clk, NUC980SysState),
        VMSTATE_CLOCK(hclk, NUC980SysState),
        VMSTATE_UINT32_ARRAY(regs, NUC980SysState, NUC980_SYS_REGS),
        VMSTATE_UINT32(keys, NUC980SysState),
        VMSTATE_UINT32(cause, NUC980SysState),
        VMSTATE_END_OF_LIST()
    }
};

static void sys_init_clocks(NUC980SysState *s)
{
    DeviceState *dev = DEVICE(s);

    for (int i = 0; i < NUC980_UARTS; i++) {
        g_autofree char *name = g_strdup_printf("uart%d", i);

        s->uart_clk[i] = qdev_init_clock_out(dev, name);
    }
    for (int i = 0; i < NUC980_TIMERS; i++) {
        g_autofree char *name = g_strdup_printf("etimer%d", i);

        s->etimer_clk[i] = qdev_init_clock_out(dev, name);
    }
    s->wdt_clk = qdev_init_clock_out(dev, "wdt");
    s->wwdt_clk = qdev_init_clock_out(dev, "wwdt");
    s->hclk = qdev_init_clock_out(dev, "hclk");
}

static void sys_init(Object *obj)
{
    NUC980SysState *s = NUC980_SYS(obj);
    DeviceState *dev = DEVICE(obj);

    memory_region_init_io(&s->iomem, obj, &sys_ops, s, TYPE_NUC980_SYS,
                          4 * NUC980_SYS_REGS);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    qdev_init_gpio_out_named(dev, &s->unlocked, "unlocked", 1);
    qdev_init_gpio_out_named(dev, s->reset, "reset", NUC980_RESETS);
    qdev_init_gpio_in_named(dev, sys_watchdog, "wdt-reset", 2);
    sys_init_clocks(s);
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
    dc->vmsd = &vmstate_nuc980_sys;
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
