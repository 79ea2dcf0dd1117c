/*
 * Nuvoton NUC980 enhanced timer (one of six)
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 *
 * A 24-bit up counter behind an 8-bit prescaler. Its value is never stored
 * while it runs: all follows from the ticks of the input clock since the
 * start, so that no rounding adds up.
 *
 * Capture inputs, event counting, the toggled output, and triggers for other
 * blocks are not modelled.
 */

#include "qemu/osdep.h"
#include "hw/irq.h"
#include "hw/misc/nuc980_unimp.h"
#include "hw/qdev-clock.h"
#include "hw/registerfields.h"
#include "hw/timer/nuc980_etimer.h"
#include "migration/vmstate.h"
#include "trace.h"

REG32(ETMR_CTL, 0x00)
    FIELD(ETMR_CTL, CNTEN, 0, 1)
    FIELD(ETMR_CTL, SWRST, 1, 1)
    FIELD(ETMR_CTL, WKEN, 2, 1)
    FIELD(ETMR_CTL, MODE, 4, 2)
    FIELD(ETMR_CTL, ACTIVE, 7, 1)
REG32(ETMR_PRECNT, 0x04)
REG32(ETMR_CMPR, 0x08)
REG32(ETMR_IER, 0x0c)
REG32(ETMR_ISR, 0x10)               /* write 1 to clear */
    FIELD(ETMR_ISR, TIMEOUT, 0, 1)  /* IER has the same bits */
    FIELD(ETMR_ISR, CAPTURE, 1, 1)
REG32(ETMR_DR, 0x14)

enum {
    MODE_ONESHOT,
    MODE_PERIODIC,
    MODE_TOGGLE,                    /* periodic, and a pin changes */
    MODE_CONTINUOUS,                /* goes on after the match */
};

#define COUNTER_SIZE        (1u << 24)
#define COUNTER_MASK        (COUNTER_SIZE - 1)
#define PRECNT_MASK         0xff

#define CTL_MODELLED        (R_ETMR_CTL_CNTEN_MASK | R_ETMR_CTL_SWRST_MASK | \
                             R_ETMR_CTL_MODE_MASK | R_ETMR_CTL_ACTIVE_MASK)

static bool etimer_runs(NUC980ETimerState *s)
{
    return FIELD_EX32(s->ctl, ETMR_CTL, CNTEN);
}

static unsigned etimer_mode(NUC980ETimerState *s)
{
    return FIELD_EX32(s->ctl, ETMR_CTL, MODE);
}

/* Ticks of the counter since start_ns */
static uint64_t etimer_ticks(NUC980ETimerState *s)
{
    int64_t now = qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL);

    return clock_ns_to_ticks(s->clk, now - s->start_ns) / (s->precnt + 1);
}

/* The first tick after 'armed' at which the counter is CMPR */
static uint64_t etimer_first_match(NUC980ETimerState *s)
{
    return s->armed + 1 +
           ((s->cmpr - s->base - s->armed - 1) & COUNTER_MASK);
}

/* Ticks from one match to the next. */
static uint32_t etimer_period(NUC980ETimerState *s)
{
    /* guess: 0 and 1, which the BSP forbids, only match as the counter wraps */
    return etimer_mode(s) == MODE_CONTINUOUS || s->cmpr < 2 ? COUNTER_SIZE
                                                            : s->cmpr;
}

static uint64_t etimer_matches(NUC980ETimerState *s, uint64_t ticks)
{
    uint64_t first = etimer_first_match(s);

    return ticks < first ? 0 : 1 + (ticks - first) / etimer_period(s);
}

/* A running counter's value */
static uint32_t etimer_count(NUC980ETimerState *s, uint64_t ticks)
{
    uint64_t first = etimer_first_match(s);

    if (ticks < first || etimer_mode(s) == MODE_CONTINUOUS) {
        return (s->base + ticks) & COUNTER_MASK;
    }
    return (ticks - first) % etimer_period(s);
}

static void etimer_set_count(NUC980ETimerState *s, uint32_t count)
{
    s->base = count;
    s->start_ns = qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL);
    s->armed = s->matches = 0;
}

/* Brings what matches change, ISR and a one-shot's end, up to now. */
static void etimer_sync(NUC980ETimerState *s)
{
    uint64_t matches;

    if (!etimer_runs(s)) {
        return;
    }
    matches = etimer_matches(s, etimer_ticks(s));
    if (matches == s->matches) {
        return;
    }
    trace_nuc980_etimer_match(DEVICE(s)->canonical_path, matches - s->matches);
    s->matches = matches;
    s->isr |= R_ETMR_ISR_TIMEOUT_MASK;
    if (etimer_mode(s) == MODE_ONESHOT) {
        s->ctl &= ~R_ETMR_CTL_CNTEN_MASK;
        etimer_set_count(s, 0);
    }
}

static uint32_t etimer_value(NUC980ETimerState *s)
{
    return etimer_runs(s) ? etimer_count(s, etimer_ticks(s)) : s->base;
}

/* Before a change of what the ticks mean: the counter goes on from here. */
static void etimer_rebase(NUC980ETimerState *s)
{
    etimer_set_count(s, etimer_value(s));
}

/* A match that nobody would notice needs no timer: etimer_sync() finds it. */
static bool etimer_interrupts_next(NUC980ETimerState *s)
{
    return etimer_runs(s) && clock_is_enabled(s->clk) &&
           (s->ier & ~s->isr & R_ETMR_ISR_TIMEOUT_MASK);
}

static void etimer_update(NUC980ETimerState *s)
{
    uint64_t ticks, ns;

    qemu_set_irq(s->irq, (s->isr & s->ier) != 0);
    if (!etimer_interrupts_next(s)) {
        timer_del(s->timer);
        return;
    }
    ticks = etimer_first_match(s) + s->matches * etimer_period(s);
    ticks *= s->precnt + 1;
    ns = clock_ticks_to_ns(s->clk, ticks);
    if (clock_ns_to_ticks(s->clk, ns) < ticks) {
        ns++;
    }
    timer_mod(s->timer, MIN(ns, INT64_MAX - s->start_ns) + s->start_ns);
}

static void etimer_expired(void *opaque)
{
    NUC980ETimerState *s = opaque;

    etimer_sync(s);
    etimer_update(s);
}

static void etimer_clock_changes(void *opaque, ClockEvent event)
{
    NUC980ETimerState *s = opaque;

    if (event == ClockPreUpdate) {
        etimer_sync(s);
        etimer_rebase(s);
    } else {
        trace_nuc980_etimer_clock(DEVICE(s)->canonical_path,
                                  clock_get_hz(s->clk));
        etimer_update(s);
    }
}

static uint64_t etimer_read(void *opaque, hwaddr addr, unsigned size)
{
    NUC980ETimerState *s = opaque;

    etimer_sync(s);
    switch (addr) {
    case A_ETMR_CTL:
        return FIELD_DP32(s->ctl, ETMR_CTL, ACTIVE, etimer_runs(s));
    case A_ETMR_PRECNT:
        return s->precnt;
    case A_ETMR_CMPR:
        return s->cmpr;
    case A_ETMR_IER:
        return s->ier;
    case A_ETMR_ISR:
        return s->isr;
    case A_ETMR_DR:
        return etimer_value(s);
    default:                        /* TCAP, ECTL, and what has no name */
        nuc980_unimp_once(s->seen, TYPE_NUC980_ETIMER, addr);
        return 0;
    }
}

static void etimer_write_ctl(NUC980ETimerState *s, uint32_t value)
{
    uint32_t change = s->ctl ^ value;

    if (value & ~CTL_MODELLED) {
        nuc980_unimp_once(s->seen, TYPE_NUC980_ETIMER, A_ETMR_CTL);
    }
    if (value & R_ETMR_CTL_SWRST_MASK) {
        /* guess: as in Nuvoton's other timers, it also stops the counter */
        etimer_set_count(s, 0);
        value &= ~R_ETMR_CTL_CNTEN_MASK;
    } else if (change & (R_ETMR_CTL_CNTEN_MASK | R_ETMR_CTL_MODE_MASK)) {
        etimer_rebase(s);
    }
    s->ctl = value & ~(R_ETMR_CTL_SWRST_MASK | R_ETMR_CTL_ACTIVE_MASK);
}

static void etimer_write_cmpr(NUC980ETimerState *s, uint32_t value)
{
    s->cmpr = value & COUNTER_MASK;
    if (s->cmpr < 2) {
        qemu_log_mask(LOG_GUEST_ERROR, "%s: a compare value of %" PRIu32
                      " is not allowed\n", TYPE_NUC980_ETIMER, s->cmpr);
    }
    if (etimer_mode(s) != MODE_CONTINUOUS) {
        etimer_set_count(s, 0);     /* Linux waits for DR to be 0 after this */
    } else if (etimer_runs(s)) {
        s->armed = etimer_ticks(s);
        s->matches = 0;
    }
}

static void etimer_write(void *opaque, hwaddr addr, uint64_t value,
                         unsigned size)
{
    NUC980ETimerState *s = opaque;

    trace_nuc980_etimer_write(DEVICE(s)->canonical_path, addr, value);
    etimer_sync(s);
    switch (addr) {
    case A_ETMR_CTL:
        etimer_write_ctl(s, value);
        break;
    case A_ETMR_PRECNT:
        etimer_rebase(s);
        s->precnt = value & PRECNT_MASK;
        break;
    case A_ETMR_CMPR:
        etimer_write_cmpr(s, value);
        break;
    case A_ETMR_IER:
        s->ier = value & (R_ETMR_ISR_TIMEOUT_MASK | R_ETMR_ISR_CAPTURE_MASK);
        if (s->ier & R_ETMR_ISR_CAPTURE_MASK) {
            nuc980_unimp_once(s->seen, TYPE_NUC980_ETIMER, addr);
        }
        break;
    case A_ETMR_ISR:
        s->isr &= ~value;
        break;
    case A_ETMR_DR:
        qemu_log_mask(LOG_GUEST_ERROR, "%s: DR can only be read\n",
                      TYPE_NUC980_ETIMER);
        break;
    default:
        nuc980_unimp_once(s->seen, TYPE_NUC980_ETIMER, addr);
        break;
    }
    etimer_update(s);
}

static const MemoryRegionOps etimer_ops = {
    .read = etimer_read,
    .write = etimer_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

static void etimer_reset(DeviceState *dev)
{
    NUC980ETimerState *s = NUC980_ETIMER(dev);

    s->ctl = s->precnt = s->cmpr = s->ier = s->isr = 0;
    etimer_set_count(s, 0);
    etimer_update(s);
}

static int etimer_post_load(void *opaque, int version_id)
{
    NUC980ETimerState *s = opaque;

    if (s->precnt > PRECNT_MASK) {
        return -EINVAL;
    }
    etimer_update(s);
    return 0;
}

static const VMStateDescription vmstate_nuc980_etimer = {
    .name = TYPE_NUC980_ETIMER,
    .version_id = 1,
    .minimum_version_id = 1,
    .post_load = etimer_post_load,
    .fields = (VMStateField[]) {
        VMSTATE_CLOCK(clk, NUC980ETimerState),
        VMSTATE_UINT32(ctl, NUC980ETimerState),
        VMSTATE_UINT32(precnt, NUC980ETimerState),
        VMSTATE_UINT32(cmpr, NUC980ETimerState),
        VMSTATE_UINT32(ier, NUC980ETimerState),
        VMSTATE_UINT32(isr, NUC980ETimerState),
        VMSTATE_UINT32(base, NUC980ETimerState),
        VMSTATE_INT64(start_ns, NUC980ETimerState),
        VMSTATE_UINT64(armed, NUC980ETimerState),
        VMSTATE_UINT64(matches, NUC980ETimerState),
        VMSTATE_END_OF_LIST()
    }
};

static void etimer_init(Object *obj)
{
    NUC980ETimerState *s = NUC980_ETIMER(obj);

    memory_region_init_io(&s->iomem, obj, &etimer_ops, s, TYPE_NUC980_ETIMER,
                          NUC980_ETIMER_SIZE);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq);
    s->clk = qdev_init_clock_in(DEVICE(obj), "clk", etimer_clock_changes, s,
                                ClockPreUpdate | ClockUpdate);
    s->timer = timer_new_ns(QEMU_CLOCK_VIRTUAL, etimer_expired, s);
}

static void etimer_finalize(Object *obj)
{
    timer_free(NUC980_ETIMER(obj)->timer);
}

static void etimer_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->reset = etimer_reset;
    dc->vmsd = &vmstate_nuc980_etimer;
}

static const TypeInfo etimer_types[] = {
    {
        .name = TYPE_NUC980_ETIMER,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980ETimerState),
        .instance_init = etimer_init,
        .instance_finalize = etimer_finalize,
        .class_init = etimer_class_init,
    },
};

DEFINE_TYPES(etimer_types)
