/*
 * Nuvoton NUC980 watchdog timer, and window watchdog timer
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "hw/irq.h"
#include "hw/misc/nuc980_unimp.h"
#include "hw/qdev-clock.h"
#include "hw/registerfields.h"
#include "hw/watchdog/nuc980_wdt.h"
#include "migration/vmstate.h"
#include "sysemu/watchdog.h"
#include "trace.h"

REG32(WDT_CTL, 0x00)
    FIELD(WDT_CTL, RSTEN, 1, 1)
    FIELD(WDT_CTL, RSTF, 2, 1)      /* write 1 to clear, IF and WKF too */
    FIELD(WDT_CTL, IF, 3, 1)
    FIELD(WDT_CTL, WKEN, 4, 1)
    FIELD(WDT_CTL, WKF, 5, 1)
    FIELD(WDT_CTL, INTEN, 6, 1)
    FIELD(WDT_CTL, WDTEN, 7, 1)
    FIELD(WDT_CTL, TOUTSEL, 8, 4)
REG32(WDT_ALTCTL, 0x04)
    FIELD(WDT_ALTCTL, RSTDSEL, 0, 2)
REG32(WDT_RSTCNT, 0x08)

REG32(WWDT_RLDCNT, 0x00)
REG32(WWDT_CTL, 0x04)
    FIELD(WWDT_CTL, WWDTEN, 0, 1)
    FIELD(WWDT_CTL, INTEN, 1, 1)
    FIELD(WWDT_CTL, PSCSEL, 8, 4)
    FIELD(WWDT_CTL, CMPDAT, 16, 6)
REG32(WWDT_STATUS, 0x08)
    FIELD(WWDT_STATUS, IF, 0, 1)    /* write 1 to clear, both */
    FIELD(WWDT_STATUS, RSTF, 1, 1)
REG32(WWDT_CNT, 0x0c)

#define RESTART_KEY     0x5aa5
#define CTL_FLAGS       (R_WDT_CTL_RSTF_MASK | R_WDT_CTL_IF_MASK | \
                         R_WDT_CTL_WKF_MASK)
#define CTL_SETTINGS    (R_WDT_CTL_RSTEN_MASK | R_WDT_CTL_WKEN_MASK | \
                         R_WDT_CTL_INTEN_MASK | R_WDT_CTL_WDTEN_MASK | \
                         R_WDT_CTL_TOUTSEL_MASK)
#define CTL_RESET       0x700       /* guess: as in Nuvoton's M0 and M4 chips */
#define TOUTSEL_MAX     8

#define WWDT_CTL_BITS   (R_WWDT_CTL_WWDTEN_MASK | R_WWDT_CTL_INTEN_MASK | \
                         R_WWDT_CTL_PSCSEL_MASK | R_WWDT_CTL_CMPDAT_MASK)
#define WWDT_FULL       0x3f

/* The first nanosecond at which the clock has made so many ticks */
static int64_t ticks_to_deadline(const Clock *clk, int64_t start, int64_t ticks)
{
    uint64_t ns = clock_ticks_to_ns(clk, MAX(ticks, 0));

    if ((int64_t)clock_ns_to_ticks(clk, ns) < ticks) {
        ns++;
    }
    return start + MIN(ns, INT64_MAX - start);
}

/* The cause is only told when the action is to reset. */
static bool act(qemu_irq reset)
{
    bool resets = get_watchdog_action() == WATCHDOG_ACTION_RESET;

    if (resets) {
        qemu_irq_pulse(reset);
    }
    watchdog_perform_action();
    return resets;
}

/* WDT: counts up to an interval, then waits for a delay, and resets */

static bool wdt_runs(NUC980WDTState *s)
{
    return FIELD_EX32(s->ctl, WDT_CTL, WDTEN);
}

static int64_t wdt_count(NUC980WDTState *s)
{
    int64_t now = qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL);

    return s->base + (int64_t)clock_ns_to_ticks(s->clk, now - s->start_ns);
}

static void wdt_set_count(NUC980WDTState *s, int64_t count)
{
    s->base = count;
    s->start_ns = qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL);
}

static int64_t wdt_interval(NUC980WDTState *s)
{
    unsigned n = FIELD_EX32(s->ctl, WDT_CTL, TOUTSEL);

    /* guess: what the BSP's list does not have is the longest it has */
    return 1 << (4 + 2 * MIN(n, TOUTSEL_MAX));
}

static int64_t wdt_delay(NUC980WDTState *s)
{
    static const int delay[] = { 1026, 130, 18, 3 };

    return delay[FIELD_EX32(s->altctl, WDT_ALTCTL, RSTDSEL)];
}

static void wdt_update(NUC980WDTState *s)
{
    int64_t end = wdt_interval(s) + (s->timed_out ? wdt_delay(s) : 0);

    qemu_set_irq(s->irq, FIELD_EX32(s->ctl, WDT_CTL, IF) &&
                         FIELD_EX32(s->ctl, WDT_CTL, INTEN));
    if (wdt_runs(s) && clock_is_enabled(s->clk)) {
        timer_mod(s->timer,
                  ticks_to_deadline(s->clk, s->start_ns, end - s->base));
    } else {
        timer_del(s->timer);
    }
}

static void wdt_restart(NUC980WDTState *s)
{
    wdt_set_count(s, 0);
    s->timed_out = false;
}

static void wdt_expired(void *opaque)
{
    NUC980WDTState *s = opaque;

    trace_nuc980_wdt_expired(s->timed_out);
    if (s->timed_out) {
        wdt_restart(s);
        s->has_reset = act(s->reset);
    } else {
        s->ctl |= R_WDT_CTL_IF_MASK;
        if (FIELD_EX32(s->ctl, WDT_CTL, RSTEN)) {
            s->timed_out = true;
        } else {
            /* guess: without a reset the next interval follows at once */
            s->base -= wdt_interval(s);
        }
    }
    wdt_update(s);
}

static void wdt_clock_changes(void *opaque, ClockEvent event)
{
    NUC980WDTState *s = opaque;

    if (event == ClockPreUpdate) {
        wdt_set_count(s, wdt_count(s));
    } else {
        wdt_update(s);
    }
}

static uint64_t wdt_read(void *opaque, hwaddr addr, unsigned size)
{
    NUC980WDTState *s = opaque;

    switch (addr) {
    case A_WDT_CTL:
        return s->ctl;
    case A_WDT_ALTCTL:
        return s->altctl;
    case A_WDT_RSTCNT:
        return 0;
    default:
        nuc980_unimp_once(s->seen, TYPE_NUC980_WDT, addr);
        return 0;
    }
}

static void wdt_write_ctl(NUC980WDTState *s, uint32_t value)
{
    bool ran = wdt_runs(s);

    if (value & R_WDT_CTL_WKEN_MASK) {
        nuc980_unimp_once(s->seen, TYPE_NUC980_WDT, A_WDT_CTL);
    }
    s->ctl = (s->ctl & CTL_FLAGS & ~value) | (value & CTL_SETTINGS);
    if (!ran || !wdt_runs(s)) {
        wdt_restart(s);
    } else if (!FIELD_EX32(s->ctl, WDT_CTL, RSTEN) && s->timed_out) {
        wdt_restart(s);             /* the delay would end in nothing */
    }
}

static void wdt_write(void *opaque, hwaddr addr, uint64_t value, unsigned size)
{
    NUC980WDTState *s = opaque;

    trace_nuc980_wdt_write(addr, value);
    if (addr <= A_WDT_ALTCTL && !s->unlocked) {
        qemu_log_mask(LOG_GUEST_ERROR, "%s: 0x%" HWADDR_PRIx " = 0x%" PRIx64
                      " needs REGWPCTL's three keys first\n", TYPE_NUC980_WDT,
                      addr, value);
        return;
    }
    switch (addr) {
    case A_WDT_CTL:
        wdt_write_ctl(s, value);
        break;
    case A_WDT_ALTCTL:
        s->altctl = value & R_WDT_ALTCTL_RSTDSEL_MASK;
        break;
    case A_WDT_RSTCNT:              /* never locked: Linux does not unlock */
        if (value == RESTART_KEY) {
            wdt_restart(s);
        }
        break;
    default:
        nuc980_unimp_once(s->seen, TYPE_NUC980_WDT, addr);
        return;
    }
    wdt_update(s);
}

static const MemoryRegionOps wdt_ops = {
    .read = wdt_read,
    .write = wdt_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

static void wdt_unlocked(void *opaque, int n, int level)
{
    NUC980WDTState *s = opaque;

    s->unlocked = level;
}

static void wdt_reset(DeviceState *dev)
{
    NUC980WDTState *s = NUC980_WDT(dev);

    s->ctl = CTL_RESET | (s->has_reset ? R_WDT_CTL_RSTF_MASK : 0);
    s->altctl = 0;
    s->has_reset = false;
    wdt_restart(s);
    wdt_update(s);
}

static int wdt_post_load(void *opaque, int version_id)
{
    wdt_update(opaque);
    return 0;
}

static const VMStateDescription vmstate_nuc980_wdt = {
    .name = TYPE_NUC980_WDT,
    .version_id = 1,
    .minimum_version_id = 1,
    .post_load = wdt_post_load,
    .fields = (VMStateField[]) {
        VMSTATE_CLOCK(clk, NUC980WDTState),
        VMSTATE_BOOL(unlocked, NUC980WDTState),
        VMSTATE_UINT32(ctl, NUC980WDTState),
        VMSTATE_UINT32(altctl, NUC980WDTState),
        VMSTATE_INT64(base, NUC980WDTState),
        VMSTATE_INT64(start_ns, NUC980WDTState),
        VMSTATE_BOOL(timed_out, NUC980WDTState),
        VMSTATE_BOOL(has_reset, NUC980WDTState),
        VMSTATE_END_OF_LIST()
    }
};

static void wdt_init(Object *obj)
{
    NUC980WDTState *s = NUC980_WDT(obj);

    memory_region_init_io(&s->iomem, obj, &wdt_ops, s, TYPE_NUC980_WDT,
                          NUC980_WDT_SIZE);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq);
    qdev_init_gpio_out_named(DEVICE(obj), &s->reset, "reset", 1);
    qdev_init_gpio_in_named(DEVICE(obj), wdt_unlocked, "unlocked", 1);
    s->clk = qdev_init_clock_in(DEVICE(obj), "clk", wdt_clock_changes, s,
                                ClockPreUpdate | ClockUpdate);
    s->timer = timer_new_ns(QEMU_CLOCK_VIRTUAL, wdt_expired, s);
}

static void wdt_finalize(Object *obj)
{
    timer_free(NUC980_WDT(obj)->timer);
}

static void wdt_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->reset = wdt_reset;
    dc->vmsd = &vmstate_nuc980_wdt;
    set_bit(DEVICE_CATEGORY_WATCHDOG, dc->categories);
}

/*
 * WWDT: counts down from 63. At the compare value the window opens, and an
 * interrupt says so. A restart before it, or none until 0, resets.
 *
 * guess: all but the registers' bits is what Nuvoton's M0 and M4 chips do.
 */

static int64_t wwdt_prescaler(NUC980WWDTState *s)
{
    static const int prescaler[] = {
        1, 2, 4, 8, 16, 32, 64, 128, 192, 256, 384, 512, 768, 1024, 1536, 2048
    };

    return prescaler[FIELD_EX32(s->ctl, WWDT_CTL, PSCSEL)];
}

static bool wwdt_runs(NUC980WWDTState *s)
{
    return FIELD_EX32(s->ctl, WWDT_CTL, WWDTEN);
}

static unsigned wwdt_count(NUC980WWDTState *s)
{
    int64_t now = qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL);
    uint64_t ticks = clock_ns_to_ticks(s->clk, now - s->start_ns) /
                     wwdt_prescaler(s);

    return wwdt_runs(s) ? WWDT_FULL - MIN(ticks, WWDT_FULL) : WWDT_FULL;
}

/* Sleeps until the compare value, then, in the window, until 0. */
static void wwdt_update(NUC980WWDTState *s)
{
    unsigned next = s->in_window ? 0 : FIELD_EX32(s->ctl, WWDT_CTL, CMPDAT);

    qemu_set_irq(s->irq, FIELD_EX32(s->status, WWDT_STATUS, IF) &&
                         FIELD_EX32(s->ctl, WWDT_CTL, INTEN));
    if (wwdt_runs(s) && clock_is_enabled(s->clk)) {
        timer_mod(s->timer,
                  ticks_to_deadline(s->clk, s->start_ns,
                                    (WWDT_FULL - next) * wwdt_prescaler(s)));
    } else {
        timer_del(s->timer);
    }
}

static void wwdt_restart(NUC980WWDTState *s)
{
    s->start_ns = qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL);
    s->in_window = false;
}

static void wwdt_reset_machine(NUC980WWDTState *s)
{
    trace_nuc980_wwdt_reset(wwdt_count(s));
    wwdt_restart(s);
    s->has_reset = act(s->reset);
}

static void wwdt_expired(void *opaque)
{
    NUC980WWDTState *s = opaque;

    if (s->in_window) {
        wwdt_reset_machine(s);
    } else {
        s->in_window = true;
        s->status |= R_WWDT_STATUS_IF_MASK;
    }
    wwdt_update(s);
}

static void wwdt_reload(NUC980WWDTState *s, uint32_t value)
{
    if (value != RESTART_KEY || !wwdt_runs(s)) {
        return;
    }
    if (wwdt_count(s) > FIELD_EX32(s->ctl, WWDT_CTL, CMPDAT)) {
        wwdt_reset_machine(s);
    } else {
        wwdt_restart(s);
    }
}

/* guess: a new clock starts the counter anew; CTL forbids it when it runs */
static void wwdt_clock_changes(void *opaque, ClockEvent event)
{
    NUC980WWDTState *s = opaque;

    wwdt_restart(s);
    wwdt_update(s);
}

static uint64_t wwdt_read(void *opaque, hwaddr addr, unsigned size)
{
    NUC980WWDTState *s = opaque;

    switch (addr) {
    case A_WWDT_RLDCNT:
        return 0;
    case A_WWDT_CTL:
        return s->ctl;
    case A_WWDT_STATUS:
        return s->status;
    case A_WWDT_CNT:
        return wwdt_count(s);
    default:
        nuc980_unimp_once(s->seen, TYPE_NUC980_WWDT, addr);
        return 0;
    }
}

/* The BSP: only once after a reset */
static void wwdt_write_ctl(NUC980WWDTState *s, uint32_t value)
{
    if (wwdt_runs(s)) {
        qemu_log_mask(LOG_GUEST_ERROR, "%s: CTL is fixed while it runs\n",
                      TYPE_NUC980_WWDT);
        return;
    }
    s->ctl = value & WWDT_CTL_BITS;
    wwdt_restart(s);
}

static void wwdt_write(void *opaque, hwaddr addr, uint64_t value, unsigned size)
{
    NUC980WWDTState *s = opaque;

    trace_nuc980_wwdt_write(addr, value);
    switch (addr) {
    case A_WWDT_RLDCNT:
        wwdt_reload(s, value);
        break;
    case A_WWDT_CTL:
        wwdt_write_ctl(s, value);
        break;
    case A_WWDT_STATUS:
        s->status &= ~value;
        break;
    default:
        nuc980_unimp_once(s->seen, TYPE_NUC980_WWDT, addr);
        return;
    }
    wwdt_update(s);
}

static const MemoryRegionOps wwdt_ops = {
    .read = wwdt_read,
    .write = wwdt_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

static void wwdt_reset(DeviceState *dev)
{
    NUC980WWDTState *s = NUC980_WWDT(dev);

    s->ctl = WWDT_FULL << R_WWDT_CTL_CMPDAT_SHIFT;
    s->status = s->has_reset ? R_WWDT_STATUS_RSTF_MASK : 0;
    s->has_reset = false;
    wwdt_restart(s);
    wwdt_update(s);
}

static int wwdt_post_load(void *opaque, int version_id)
{
    wwdt_update(opaque);
    return 0;
}

static const VMStateDescription vmstate_nuc980_wwdt = {
    .name = TYPE_NUC980_WWDT,
    .version_id = 1,
    .minimum_version_id = 1,
    .post_load = wwdt_post_load,
    .fields = (VMStateField[]) {
        VMSTATE_CLOCK(clk, NUC980WWDTState),
        VMSTATE_UINT32(ctl, NUC980WWDTState),
        VMSTATE_UINT32(status, NUC980WWDTState),
        VMSTATE_INT64(start_ns, NUC980WWDTState),
        VMSTATE_BOOL(in_window, NUC980WWDTState),
        VMSTATE_BOOL(has_reset, NUC980WWDTState),
        VMSTATE_END_OF_LIST()
    }
};

static void wwdt_init(Object *obj)
{
    NUC980WWDTState *s = NUC980_WWDT(obj);

    memory_region_init_io(&s->iomem, obj, &wwdt_ops, s, TYPE_NUC980_WWDT,
                          NUC980_WDT_SIZE);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq);
    qdev_init_gpio_out_named(DEVICE(obj), &s->reset, "reset", 1);
    s->clk = qdev_init_clock_in(DEVICE(obj), "clk", wwdt_clock_changes, s,
                                ClockUpdate);
    s->timer = timer_new_ns(QEMU_CLOCK_VIRTUAL, wwdt_expired, s);
}

static void wwdt_finalize(Object *obj)
{
    timer_free(NUC980_WWDT(obj)->timer);
}

static void wwdt_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->reset = wwdt_reset;
    dc->vmsd = &vmstate_nuc980_wwdt;
    set_bit(DEVICE_CATEGORY_WATCHDOG, dc->categories);
}

static const TypeInfo wdt_types[] = {
    {
        .name = TYPE_NUC980_WDT,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980WDTState),
        .instance_init = wdt_init,
        .instance_finalize = wdt_finalize,
        .class_init = wdt_class_init,
    },
    {
        .name = TYPE_NUC980_WWDT,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980WWDTState),
        .instance_init = wwdt_init,
        .instance_finalize = wwdt_finalize,
        .class_init = wwdt_class_init,
    },
};

DEFINE_TYPES(wdt_types)
