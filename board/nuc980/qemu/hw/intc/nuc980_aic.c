/*
 * Nuvoton NUC980 advanced interrupt controller
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 *
 * 63 sources, each with a type and a priority: 0 goes to the processor's FIQ,
 * 1 (highest) to 7 to its IRQ. Among equals the lowest source comes first.
 *
 * A source in service does not hold back others: Linux masks a source, writes
 * EOIS at once and reads IRQNUM until it is 0; the vendor's BSP writes EOIS at
 * the handler's end with the processor's interrupts off all the while. Neither
 * can tell whether there is a stack of priorities.
 */

#include "qemu/osdep.h"
#include "hw/intc/nuc980_aic.h"
#include "hw/irq.h"
#include "hw/misc/nuc980_unimp.h"
#include "hw/registerfields.h"
#include "migration/vmstate.h"
#include "trace.h"

REG32(AIC_SRCCTL0, 0x000)           /* four sources in each register */
    FIELD(AIC_SRCCTL, PRIORITY, 0, 3)
    FIELD(AIC_SRCCTL, HIGH, 6, 1)   /* high level, or rising edge */
    FIELD(AIC_SRCCTL, EDGE, 7, 1)
REG32(AIC_SRCCTL15, 0x03c)
REG32(AIC_RAWSTS0, 0x100)
REG32(AIC_RAWSTS1, 0x104)
REG32(AIC_ACTSTS0, 0x108)
REG32(AIC_ACTSTS1, 0x10c)
REG32(AIC_INTSTS0, 0x110)
REG32(AIC_INTSTS1, 0x114)
REG32(AIC_IRQNUM, 0x120)
REG32(AIC_FIQNUM, 0x124)
REG32(AIC_INTMSK0, 0x128)
REG32(AIC_INTMSK1, 0x12c)
REG32(AIC_INTEN0, 0x130)
REG32(AIC_INTEN1, 0x134)
REG32(AIC_INTDIS0, 0x138)
REG32(AIC_INTDIS1, 0x13c)
REG32(AIC_EOIS, 0x150)
REG32(AIC_EOFS, 0x154)

/*
 * guess: high level, priority 7, as in Nuvoton's older chips with this
 * controller; Linux never writes SRCCTL, so it must be some IRQ
 */
#define AIC_SRCCTL_RESET    0x47474747
#define AIC_SRCCTL_BITS     0xc7c7c7c7

static uint8_t aic_source_control(NUC980AICState *s, int source)
{
    return s->srcctl[source / 4] >> (8 * (source % 4));
}

/* Sources that ask for service, enabled or not */
static uint64_t aic_active(NUC980AICState *s)
{
    uint64_t level = ~(s->lines ^ s->high);

    return ((s->edge & s->latched) | (~s->edge & level)) & ~1ull;
}

/* The enabled active source to serve next, 0: none */
static int aic_number(NUC980AICState *s, bool fiq)
{
    uint64_t pending = aic_active(s) & s->mask;
    int best = 0, best_priority = 8;

    for (; pending; pending &= pending - 1) {
        int source = ctz64(pending);
        int priority = FIELD_EX8(aic_source_control(s, source), AIC_SRCCTL,
                                 PRIORITY);

        if ((priority == 0) == fiq && priority < best_priority) {
            best = source;
            best_priority = priority;
        }
    }
    return best;
}

static void aic_update(NUC980AICState *s)
{
    int irq = aic_number(s, false);
    int fiq = aic_number(s, true);

    trace_nuc980_aic_update(irq, fiq);
    qemu_set_irq(s->irq, irq != 0);
    qemu_set_irq(s->fiq, fiq != 0);
}

static void aic_set_source(void *opaque, int source, int level)
{
    NUC980AICState *s = opaque;
    uint64_t bit = 1ull << source;

    if (!!level == !!(s->lines & bit)) {
        return;
    }
    trace_nuc980_aic_source(source, level);
    s->lines ^= bit;
    if (!!level == !!(s->high & bit)) {
        s->latched |= bit & s->edge;
    }
    aic_update(s);
}

static void aic_set_types(NUC980AICState *s)
{
    s->edge = s->high = 0;
    for (int i = 0; i < NUC980_AIC_SOURCES; i++) {
        uint8_t control = aic_source_control(s, i);

        s->edge |= (uint64_t)FIELD_EX8(control, AIC_SRCCTL, EDGE) << i;
        s->high |= (uint64_t)FIELD_EX8(control, AIC_SRCCTL, HIGH) << i;
    }
    s->latched &= s->edge;
}

/*
 * guess: reading the number takes an edge, as the manual of the sibling chip
 * NUC970 says of its register IPER (5.4.4.3)
 */
static int aic_take(NUC980AICState *s, bool fiq)
{
    int source = aic_number(s, fiq);

    if (s->latched & (1ull << source)) {
        s->latched &= ~(1ull << source);
        aic_update(s);
    }
    return source;
}

static uint64_t aic_read(void *opaque, hwaddr addr, unsigned size)
{
    NUC980AICState *s = opaque;
    int half = addr & 4 ? 32 : 0;

    switch (addr) {
    case A_AIC_SRCCTL0 ... A_AIC_SRCCTL15:
        return s->srcctl[addr / 4];
    case A_AIC_RAWSTS0:
    case A_AIC_RAWSTS1:
        return extract64(s->lines, half, 32);
    case A_AIC_ACTSTS0:             /* guess: whatever the mask, by its name */
    case A_AIC_ACTSTS1:
        return extract64(aic_active(s), half, 32);
    case A_AIC_INTSTS0:
    case A_AIC_INTSTS1:
        return extract64(aic_active(s) & s->mask, half, 32);
    case A_AIC_IRQNUM:
        return aic_take(s, false);
    case A_AIC_FIQNUM:
        return aic_take(s, true);
    case A_AIC_INTMSK0:
        return extract64(s->mask, 0, 32);
    case A_AIC_INTMSK1:
        return extract64(s->mask, 32, 32);
    case A_AIC_INTEN0 ... A_AIC_INTDIS1:
    case A_AIC_EOIS ... A_AIC_EOFS:
        qemu_log_mask(LOG_GUEST_ERROR, "%s: 0x%" HWADDR_PRIx
                      " can only be written\n", TYPE_NUC980_AIC, addr);
        return 0;
    default:
        nuc980_unimp_once(s->seen, TYPE_NUC980_AIC, addr);
        return 0;
    }
}

static void aic_write(void *opaque, hwaddr addr, uint64_t value, unsigned size)
{
    NUC980AICState *s = opaque;

    trace_nuc980_aic_write(addr, value);
    switch (addr) {
    case A_AIC_SRCCTL0 ... A_AIC_SRCCTL15:
        s->srcctl[addr / 4] = value & AIC_SRCCTL_BITS;
        aic_set_types(s);
        break;
    case A_AIC_INTEN0:
        s->mask |= value;
        break;
    case A_AIC_INTEN1:
        s->mask |= value << 32;
        break;
    case A_AIC_INTDIS0:
        s->mask &= ~value;
        break;
    case A_AIC_INTDIS1:
        s->mask &= ~(value << 32);
        break;
    case A_AIC_EOIS:
    case A_AIC_EOFS:
        break;                      /* nothing was held back */
    case A_AIC_RAWSTS0 ... A_AIC_INTSTS1:
    case A_AIC_IRQNUM ... A_AIC_INTMSK1:
        qemu_log_mask(LOG_GUEST_ERROR, "%s: 0x%" HWADDR_PRIx
                      " can only be read\n", TYPE_NUC980_AIC, addr);
        break;
    default:
        nuc980_unimp_once(s->seen, TYPE_NUC980_AIC, addr);
        break;
    }
    aic_update(s);
}

static const MemoryRegionOps aic_ops = {
    .read = aic_read,
    .write = aic_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

static void aic_reset(DeviceState *dev)
{
    NUC980AICState *s = NUC980_AIC(dev);

    for (int i = 0; i < ARRAY_SIZE(s->srcctl); i++) {
        s->srcctl[i] = AIC_SRCCTL_RESET;
    }
    s->mask = 0;
    aic_set_types(s);
    aic_update(s);                  /* the lines are what the devices say */
}

static int aic_post_load(void *opaque, int version_id)
{
    NUC980AICState *s = opaque;

    aic_set_types(s);
    aic_update(s);
    return 0;
}

static const VMStateDescription vmstate_nuc980_aic = {
    .name = TYPE_NUC980_AIC,
    .version_id = 1,
    .minimum_version_id = 1,
    .post_load = aic_post_load,
    .fields = (VMStateField[]) {
        VMSTATE_UINT32_ARRAY(srcctl, NUC980AICState, NUC980_AIC_SOURCES / 4),
        VMSTATE_UINT64(lines, NUC980AICState),
        VMSTATE_UINT64(latched, NUC980AICState),
        VMSTATE_UINT64(mask, NUC980AICState),
        VMSTATE_END_OF_LIST()
    }
};

static void aic_init(Object *obj)
{
    NUC980AICState *s = NUC980_AIC(obj);

    memory_region_init_io(&s->iomem, obj, &aic_ops, s, TYPE_NUC980_AIC,
                          NUC980_AIC_SIZE);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    qdev_init_gpio_in(DEVICE(obj), aic_set_source, NUC980_AIC_SOURCES);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->fiq);
}

static void aic_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->reset = aic_reset;
    dc->vmsd = &vmstate_nuc980_aic;
}

static const TypeInfo aic_types[] = {
    {
        .name = TYPE_NUC980_AIC,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980AICState),
        .instance_init = aic_init,
        .class_init = aic_class_init,
    },
};

DEFINE_TYPES(aic_types)
