/*
 * Nuvoton NUC980 GPIO, ports A to G
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "hw/gpio/nuc980_gpio.h"
#include "hw/irq.h"
#include "hw/misc/nuc980_unimp.h"
#include "hw/registerfields.h"
#include "migration/vmstate.h"
#include "qapi/visitor.h"
#include "qemu/log.h"
#include "trace.h"

/* Of a port; the next one's are 0x40 further. */
REG32(MODE, 0x00)       /* two bits a pin */
REG32(DINOFF, 0x04)     /* bit 16 + n */
REG32(DOUT, 0x08)
REG32(DATMSK, 0x0c)
REG32(PIN, 0x10)
REG32(DBEN, 0x14)
REG32(INTTYPE, 0x18)    /* 1: level */
REG32(INTEN, 0x1c)
    FIELD(INTEN, FLIEN, 0, 16)
    FIELD(INTEN, RHIEN, 16, 16)
REG32(INTSRC, 0x20)
REG32(SMTEN, 0x24)
REG32(SLEWCTL, 0x28)
REG32(PUSEL, 0x30)      /* two bits a pin */

#define PORT_SIZE       0x40
#define PORTS_SIZE      (NUC980_GPIO_PORTS * PORT_SIZE)
#define PINS_A_PORT     16

/* Of all ports */
REG32(DBCTL, 0x440)
    FIELD(DBCTL, DBCLKSEL, 0, 4)
    FIELD(DBCTL, DBCLKSRC, 4, 1)
    FIELD(DBCTL, ICLKON, 5, 1)

/* A word for each pin: 0x40 a port, 4 a pin */
#define PDIO            0x800

QEMU_BUILD_BUG_ON(R_PUSEL + 1 != NUC980_GPIO_REGS);
QEMU_BUILD_BUG_ON(NUC980_GPIO_PORTS * PINS_A_PORT != NUC980_PIN_COUNT);

enum { MODE_INPUT, MODE_OUTPUT, MODE_OPEN_DRAIN, MODE_QUASI };
enum { PULL_NONE, PULL_UP, PULL_DOWN };

static const char *const reg_name[NUC980_GPIO_REGS] = {
    [R_MODE] = "MODE", [R_DINOFF] = "DINOFF", [R_DOUT] = "DOUT",
    [R_DATMSK] = "DATMSK", [R_PIN] = "PIN", [R_DBEN] = "DBEN",
    [R_INTTYPE] = "INTTYPE", [R_INTEN] = "INTEN", [R_INTSRC] = "INTSRC",
    [R_SMTEN] = "SMTEN", [R_SLEWCTL] = "SLEWCTL", [R_PUSEL] = "PUSEL",
};

static unsigned pin_mode(const NUC980GPIOPort *p, int n)
{
    return extract32(p->regs[R_MODE], 2 * n, 2);
}

/* The level of the wire. A pin that a peripheral has does not follow DOUT. */
static bool pin_level(const NUC980GPIOPort *p, int n)
{
    unsigned mode = p->peripheral & BIT(n) ? MODE_INPUT : pin_mode(p, n);
    bool out = p->regs[R_DOUT] & BIT(n);

    if (mode == MODE_OUTPUT || (mode != MODE_INPUT && !out)) {
        return out;
    }
    if (p->driven & BIT(n)) {
        return p->drive & BIT(n);
    }
    /* guess: what neither anybody nor a pull-up drives reads 0 */
    return mode == MODE_QUASI ||
           extract32(p->regs[R_PUSEL], 2 * n, 2) == PULL_UP;
}

static uint16_t port_level(const NUC980GPIOPort *p)
{
    uint16_t level = 0;

    for (int n = 0; n < PINS_A_PORT; n++) {
        level |= pin_level(p, n) << n;
    }
    return level & ~(p->regs[R_DINOFF] >> 16);
}

static void gpio_drive_irqs(NUC980GPIOState *s)
{
    bool eint[NUC980_GPIO_EINTS] = {};

    for (int i = 0; i < NUC980_GPIO_PORTS; i++) {
        const NUC980GPIOPort *p = &s->port[i];
        uint16_t external = p->regs[R_INTSRC] & p->eint;

        /* guess: an external interrupt is none of its port besides */
        qemu_set_irq(s->irq[i], p->regs[R_INTSRC] & ~p->eint);
        while (external) {
            int n = ctz32(external);

            eint[nuc980_pin_eint(PINS_A_PORT * i + n)] = true;
            external &= external - 1;
        }
    }
    for (int i = 0; i < NUC980_GPIO_EINTS; i++) {
        qemu_set_irq(s->eint[i], eint[i]);
    }
}

/* The pins whose interrupt condition is met, when they were 'old' before */
static uint16_t port_hits(const NUC980GPIOPort *p, uint16_t old)
{
    uint16_t by_level = p->regs[R_INTTYPE];
    uint16_t low = FIELD_EX32(p->regs[R_INTEN], INTEN, FLIEN);
    uint16_t high = FIELD_EX32(p->regs[R_INTEN], INTEN, RHIEN);
    uint16_t edges = (p->level & ~old & high) | (~p->level & old & low);
    /* Both levels of a pin: the setting is ignored. */
    uint16_t levels = (p->level & high & ~low) | (~p->level & low & ~high);

    return (edges & ~by_level) | (levels & by_level);
}

static void port_update(NUC980GPIOState *s, int i)
{
    NUC980GPIOPort *p = &s->port[i];
    uint16_t old = p->level;
    uint16_t changed;

    p->level = port_level(p);
    for (changed = p->level ^ old; changed; changed &= changed - 1) {
        int n = ctz32(changed);

        trace_nuc980_gpio_level(nuc980_pin_name(PINS_A_PORT * i + n),
                                p->level & BIT(n));
    }
    /* guess: also while a peripheral has the pin; INTSRC alone interrupts */
    p->regs[R_INTSRC] |= port_hits(p, old);
    gpio_drive_irqs(s);
}

/* What a guest wants to put out on a pin that it has given to a peripheral */
static void check_output(NUC980GPIOPort *p, int i, uint16_t pins)
{
    for (pins &= p->peripheral; pins; pins &= pins - 1) {
        int n = ctz32(pins);

        if (pin_mode(p, n) != MODE_INPUT) {
            qemu_log_mask(LOG_GUEST_ERROR,
                          TYPE_NUC980_GPIO ": output on %s, which a peripheral "
                          "has\n", nuc980_pin_name(PINS_A_PORT * i + n));
        }
    }
}

static uint16_t changed_modes(uint32_t a, uint32_t b)
{
    uint16_t changed = 0;

    for (int n = 0; n < PINS_A_PORT; n++) {
        changed |= !!extract32(a ^ b, 2 * n, 2) << n;
    }
    return changed;
}

static void port_write(NUC980GPIOState *s, int i, hwaddr reg, uint32_t value)
{
    NUC980GPIOPort *p = &s->port[i];
    uint32_t old = p->regs[reg];
    uint32_t mask = p->regs[R_DATMSK];

    trace_nuc980_gpio_write(reg_name[reg], 'A' + i, value);
    switch (reg) {
    case R_MODE:
        p->regs[R_MODE] = value;
        check_output(p, i, changed_modes(old, value));
        break;
    case R_DOUT:
        p->regs[R_DOUT] = (old & mask) | (value & ~mask & 0xffff);
        check_output(p, i, old ^ p->regs[R_DOUT]);
        break;
    case R_PIN:
        qemu_log_mask(LOG_GUEST_ERROR,
                      TYPE_NUC980_GPIO ": write to PIN of port %c\n", 'A' + i);
        break;
    case R_INTSRC:
        p->regs[R_INTSRC] &= ~value;
        break;
    case R_DINOFF:
        p->regs[R_DINOFF] = value & 0xffff0000;
        break;
    case R_DBEN:
        if (value & 0xffff) {
            nuc980_unimp_once(s->seen, TYPE_NUC980_GPIO,
                              i * PORT_SIZE + A_DBEN);
        }
        p->regs[R_DBEN] = value & 0xffff;
        break;
    case R_DATMSK:
    case R_INTTYPE:
    case R_SMTEN:               /* electrical: nothing to see in a model */
        p->regs[reg] = value & 0xffff;
        break;
    case R_SLEWCTL:             /* electrical */
    case R_INTEN:
    case R_PUSEL:
        p->regs[reg] = value;
        break;
    }
    port_update(s, i);
}

/* A pin's own word sets its bit of DOUT, DATMSK or not. */
static void pdio_write(NUC980GPIOState *s, unsigned pin, bool value)
{
    int i = pin / PINS_A_PORT;
    int n = pin % PINS_A_PORT;
    NUC980GPIOPort *p = &s->port[i];

    p->regs[R_DOUT] = deposit32(p->regs[R_DOUT], n, 1, value);
    trace_nuc980_gpio_write("PDIO", 'A' + i, p->regs[R_DOUT]);
    check_output(p, i, BIT(n));
    port_update(s, i);
}

static bool is_pdio(hwaddr addr)
{
    return addr >= PDIO && addr < PDIO + 4 * NUC980_PIN_COUNT;
}

static bool is_port(hwaddr addr)
{
    hwaddr reg = addr % PORT_SIZE / 4;

    return addr < PORTS_SIZE && reg < NUC980_GPIO_REGS && reg_name[reg];
}

static uint64_t gpio_read(void *opaque, hwaddr addr, unsigned size)
{
    NUC980GPIOState *s = opaque;

    if (is_port(addr)) {
        const NUC980GPIOPort *p = &s->port[addr / PORT_SIZE];
        hwaddr reg = addr % PORT_SIZE / 4;

        return reg == R_PIN ? p->level : p->regs[reg];
    }
    if (is_pdio(addr)) {
        unsigned pin = (addr - PDIO) / 4;

        return extract32(s->port[pin / PINS_A_PORT].level, pin % PINS_A_PORT,
                         1);
    }
    if (addr == A_DBCTL) {
        return s->dbctl;
    }
    nuc980_unimp_once(s->seen, TYPE_NUC980_GPIO, addr);
    return 0;
}

static void gpio_write(void *opaque, hwaddr addr, uint64_t value,
                       unsigned size)
{
    NUC980GPIOState *s = opaque;

    if (is_port(addr)) {
        port_write(s, addr / PORT_SIZE, addr % PORT_SIZE / 4, value);
    } else if (is_pdio(addr)) {
        pdio_write(s, (addr - PDIO) / 4, value & 1);
    } else if (addr == A_DBCTL) {
        s->dbctl = value & (R_DBCTL_DBCLKSEL_MASK | R_DBCTL_DBCLKSRC_MASK |
                            R_DBCTL_ICLKON_MASK);
    } else {
        nuc980_unimp_once(s->seen, TYPE_NUC980_GPIO, addr);
    }
}

static const MemoryRegionOps gpio_ops = {
    .read = gpio_read,
    .write = gpio_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

static void gpio_peripheral(void *opaque, int pin, int level)
{
    NUC980GPIOState *s = opaque;
    NUC980GPIOPort *p = &s->port[pin / PINS_A_PORT];

    p->peripheral = deposit32(p->peripheral, pin % PINS_A_PORT, 1, level);
    port_update(s, pin / PINS_A_PORT);
}

static void gpio_eint(void *opaque, int pin, int level)
{
    NUC980GPIOState *s = opaque;
    NUC980GPIOPort *p = &s->port[pin / PINS_A_PORT];

    p->eint = deposit32(p->eint, pin % PINS_A_PORT, 1, level);
    gpio_drive_irqs(s);
}

static void gpio_get_level(Object *obj, Visitor *v, const char *name,
                           void *opaque, Error **errp)
{
    unsigned pin = GPOINTER_TO_UINT(opaque);
    NUC980GPIOState *s = NUC980_GPIO(obj);
    bool level = pin_level(&s->port[pin / PINS_A_PORT], pin % PINS_A_PORT);

    visit_type_bool(v, name, &level, errp);
}

static void gpio_set_level(Object *obj, Visitor *v, const char *name,
                           void *opaque, Error **errp)
{
    unsigned pin = GPOINTER_TO_UINT(opaque);
    NUC980GPIOState *s = NUC980_GPIO(obj);
    NUC980GPIOPort *p = &s->port[pin / PINS_A_PORT];
    bool level;

    if (visit_type_bool(v, name, &level, errp)) {
        p->driven |= BIT(pin % PINS_A_PORT);
        p->drive = deposit32(p->drive, pin % PINS_A_PORT, 1, level);
        port_update(s, pin / PINS_A_PORT);
    }
}

static void gpio_reset(DeviceState *dev)
{
    NUC980GPIOState *s = NUC980_GPIO(dev);

    s->dbctl = 0;
    for (int i = 0; i < NUC980_GPIO_PORTS; i++) {
        NUC980GPIOPort *p = &s->port[i];

        /* guess: all pins are inputs, without pulls */
        memset(p->regs, 0, sizeof(p->regs));
        /* guess: as in the M480, which has this block */
        p->regs[R_DOUT] = 0xffff;
        port_update(s, i);
    }
}

static int gpio_post_load(void *opaque, int version_id)
{
    NUC980GPIOState *s = opaque;

    for (int pin = 0; pin < NUC980_PIN_COUNT; pin++) {
        if (s->port[pin / PINS_A_PORT].eint & BIT(pin % PINS_A_PORT) &&
            nuc980_pin_eint(pin) < 0) {
            return -EINVAL;
        }
    }
    gpio_drive_irqs(s);
    return 0;
}

static const VMStateDescription vmstate_port = {
    .name = TYPE_NUC980_GPIO "-port",
    .version_id = 1,
    .minimum_version_id = 1,
    .fields = (VMStateField[]) {
        VMSTATE_UINT32_ARRAY(regs, NUC980GPIOPort, NUC980_GPIO_REGS),
        VMSTATE_UINT16(level, NUC980GPIOPort),
        VMSTATE_UINT16(driven, NUC980GPIOPort),
        VMSTATE_UINT16(drive, NUC980GPIOPort),
        VMSTATE_UINT16(peripheral, NUC980GPIOPort),
        VMSTATE_UINT16(eint, NUC980GPIOPort),
        VMSTATE_END_OF_LIST()
    }
};

static const VMStateDescription vmstate_gpio = {
    .name = TYPE_NUC980_GPIO,
    .version_id = 1,
    .minimum_version_id = 1,
    .post_load = gpio_post_load,
    .fields = (VMStateField[]) {
        VMSTATE_STRUCT_ARRAY(port, NUC980GPIOState, NUC980_GPIO_PORTS, 1,
                             vmstate_port, NUC980GPIOPort),
        VMSTATE_UINT32(dbctl, NUC980GPIOState),
        VMSTATE_END_OF_LIST()
    }
};

static void gpio_init(Object *obj)
{
    NUC980GPIOState *s = NUC980_GPIO(obj);
    DeviceState *dev = DEVICE(obj);
    SysBusDevice *sbd = SYS_BUS_DEVICE(obj);

    memory_region_init_io(&s->iomem, obj, &gpio_ops, s, TYPE_NUC980_GPIO,
                          NUC980_GPIO_SIZE);
    sysbus_init_mmio(sbd, &s->iomem);
    for (int i = 0; i < NUC980_GPIO_PORTS; i++) {
        sysbus_init_irq(sbd, &s->irq[i]);
    }
    for (int i = 0; i < NUC980_GPIO_EINTS; i++) {
        sysbus_init_irq(sbd, &s->eint[i]);
    }
    qdev_init_gpio_in_named(dev, gpio_peripheral, "peripheral",
                            NUC980_PIN_COUNT);
    qdev_init_gpio_in_named(dev, gpio_eint, "eint", NUC980_PIN_COUNT);
    for (unsigned pin = 0; pin < NUC980_PIN_COUNT; pin++) {
        if (nuc980_pin_exists(pin)) {
            object_property_add(obj, nuc980_pin_name(pin), "bool",
                                gpio_get_level, gpio_set_level, NULL,
                                GUINT_TO_POINTER(pin));
        }
    }
}

static void gpio_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->desc = "NUC980 GPIO";
    dc->reset = gpio_reset;
    dc->vmsd = &vmstate_gpio;
}

static const TypeInfo nuc980_gpio_types[] = {
    {
        .name = TYPE_NUC980_GPIO,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980GPIOState),
        .instance_init = gpio_init,
        .class_init = gpio_class_init,
    },
};

DEFINE_TYPES(nuc980_gpio_types)
