/*
 * Nuvoton NUC980 enhanced timer (one of six)
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "hw/irq.h"
#include "hw/qdev-clock.h"
#include "qemu/log.h"
#include "qemu/module.h"
#include "hw/timer/nuc980_etimer.h"

#define TMR_EN      1
#define TMR_MODE(c) (((c) >> 4) & 3)

static uint64_t etimer_ticks(NUC980ETimerState *s, int64_t now)
{
    return muldiv64(now - s->start_ns, clock_get_hz(s->clk), NANOSECONDS_PER_SECOND) /
           ((s->precnt & 0xff) + 1);
}

static uint32_t etimer_period(NUC980ETimerState *s)
{
    return TMR_MODE(s->ctl) == 3 || s->cmpr < 2 ? 1 << 24 : s->cmpr;
}

static uint32_t etimer_count(NUC980ETimerState *s)
{
    uint64_t c = s->base;

    if (s->ctl & TMR_EN) {
        c += etimer_ticks(s, qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL));
        c %= etimer_period(s);
    }
    return c & 0xffffff;
}

static void etimer_irq(NUC980ETimerState *s)
{
    qemu_set_irq(s->irq, s->isr & s->ier & 3);
}

static void etimer_rearm(NUC980ETimerState *s)
{
    uint64_t tick_ns_num = NANOSECONDS_PER_SECOND * ((s->precnt & 0xff) + 1ull);
    uint32_t c = etimer_count(s);
    uint32_t left = c < s->cmpr ? s->cmpr - c : s->cmpr + (1 << 24) - c;

    if (!(s->ctl & TMR_EN) || !(s->ier & 1)) {
        timer_del(s->t);            /* nobody to tell: no need to run */
        return;
    }
    timer_mod(s->t, qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL) +
              DIV_ROUND_UP(left * tick_ns_num, clock_get_hz(s->clk)));
}

static void etimer_freeze(NUC980ETimerState *s)
{
    s->base = etimer_count(s);
    s->start_ns = qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL);
}

static void etimer_hit(void *opaque)
{
    NUC980ETimerState *s = opaque;

    s->isr |= 1;
    if (TMR_MODE(s->ctl) == 0) {
        s->ctl &= ~TMR_EN;
        s->base = 0;
    } else {
        etimer_rearm(s);
    }
    etimer_irq(s);
}

static uint64_t etimer_read(void *opaque, hwaddr a, unsigned size)
{
    NUC980ETimerState *s = opaque;

    switch (a) {
    case 0x00: return s->ctl;
    case 0x04: return s->precnt;
    case 0x08: return s->cmpr;
    case 0x0c: return s->ier;
    case 0x10: return s->isr;
    case 0x14: return etimer_count(s);
    case 0x20: return s->ectl;
    }
    return 0;
}

static void etimer_write(void *opaque, hwaddr a, uint64_t v, unsigned size)
{
    NUC980ETimerState *s = opaque;

    switch (a) {
    case 0x00:
        etimer_freeze(s);
        s->ctl = v;
        if (v & 2) {                /* software reset of the counter */
            s->base = 0;
            s->ctl &= ~2;
        }
        break;
    case 0x04:
        etimer_freeze(s);
        s->precnt = v & 0xff;
        break;
    case 0x08:
        etimer_freeze(s);
        s->cmpr = v & 0xffffff;
        if (TMR_MODE(s->ctl) != 3) {
            s->base = 0;            /* a new compare value restarts counting */
        }
        break;
    case 0x0c:
        s->ier = v & 3;
        break;
    case 0x10:
        s->isr &= ~v;
        break;
    case 0x20:
        s->ectl = v;
        break;
    }
    etimer_rearm(s);
    etimer_irq(s);
}

static const MemoryRegionOps etimer_ops = {
    .read = etimer_read, .write = etimer_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

static void etimer_reset(DeviceState *dev)
{
    NUC980ETimerState *s = NUC980_ETIMER(dev);

    s->ctl = s->precnt = s->cmpr = s->ier = s->isr = s->ectl = s->base = 0;
    timer_del(s->t);
}

static void etimer_init(Object *obj)
{
    NUC980ETimerState *s = NUC980_ETIMER(obj);

    memory_region_init_io(&s->iomem, obj, &etimer_ops, s, "nuc980-etimer",
                          0x100);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq);
    s->clk = qdev_init_clock_in(DEVICE(obj), "clk", NULL, NULL, 0);
    s->t = timer_new_ns(QEMU_CLOCK_VIRTUAL, etimer_hit, s);
}

static void etimer_class_init(ObjectClass *k, void *data)
{
    DEVICE_CLASS(k)->reset = etimer_reset;
}

static const TypeInfo nuc980_etimer_types[] = {
    {
        .name = TYPE_NUC980_ETIMER,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980ETimerState),
        .instance_init = etimer_init,
        .class_init = etimer_class_init,
    },
};

DEFINE_TYPES(nuc980_etimer_types)
