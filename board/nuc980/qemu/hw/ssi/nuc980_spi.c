/*
 * Nuvoton NUC980 (Q)SPI controller
 *
 * Master of an SSI bus. A unit goes over the bus in the moment it can; how
 * many data lines it takes (single, dual, quad) makes no difference to that.
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "hw/irq.h"
#include "hw/misc/nuc980_unimp.h"
#include "hw/registerfields.h"
#include "hw/ssi/nuc980_spi.h"
#include "migration/vmstate.h"
#include "qemu/log.h"
#include "trace.h"

REG32(CTL, 0x00)
    FIELD(CTL, SPIEN, 0, 1)
    FIELD(CTL, DWIDTH, 8, 5)
    FIELD(CTL, LSB, 13, 1)
    FIELD(CTL, HALFDPX, 14, 1)
    FIELD(CTL, RXONLY, 15, 1)
    FIELD(CTL, TWOBIT, 16, 1)
    FIELD(CTL, UNITIEN, 17, 1)
    FIELD(CTL, SLAVE, 18, 1)
    FIELD(CTL, REORDER, 19, 1)
    FIELD(CTL, DATDIR, 20, 1)
    FIELD(CTL, DUALIOEN, 21, 1)
    FIELD(CTL, QUADIOEN, 22, 1)
REG32(CLKDIV, 0x04)
    FIELD(CLKDIV, DIVIDER, 0, 9)
REG32(SSCTL, 0x08)
    FIELD(SSCTL, SS, 0, 2)      /* bit 1, SS1: by the vendor's Linux driver */
    FIELD(SSCTL, SSACTPOL, 2, 1)
    FIELD(SSCTL, AUTOSS, 3, 1)
REG32(PDMACTL, 0x0c)
    FIELD(PDMACTL, TXPDMAEN, 0, 1)
    FIELD(PDMACTL, RXPDMAEN, 1, 1)
REG32(FIFOCTL, 0x10)
    FIELD(FIFOCTL, RXRST, 0, 1)
    FIELD(FIFOCTL, TXRST, 1, 1)
    FIELD(FIFOCTL, RXTHIEN, 2, 1)
    FIELD(FIFOCTL, TXTHIEN, 3, 1)
    FIELD(FIFOCTL, RXTOIEN, 4, 1)
    FIELD(FIFOCTL, RXOVIEN, 5, 1)
    FIELD(FIFOCTL, RXFBCLR, 8, 1)
    FIELD(FIFOCTL, TXFBCLR, 9, 1)
    FIELD(FIFOCTL, RXTH, 24, 3)
    FIELD(FIFOCTL, TXTH, 28, 3)
REG32(STATUS, 0x14)
    FIELD(STATUS, BUSY, 0, 1)
    FIELD(STATUS, UNITIF, 1, 1)
    FIELD(STATUS, RXEMPTY, 8, 1)
    FIELD(STATUS, RXFULL, 9, 1)
    FIELD(STATUS, RXTHIF, 10, 1)
    FIELD(STATUS, RXOVIF, 11, 1)
    FIELD(STATUS, SPIENSTS, 15, 1)
    FIELD(STATUS, TXEMPTY, 16, 1)
    FIELD(STATUS, TXFULL, 17, 1)
    FIELD(STATUS, TXTHIF, 18, 1)
    FIELD(STATUS, RXCNT, 24, 4)
    FIELD(STATUS, TXCNT, 28, 4)
REG32(TX, 0x20)
REG32(RX, 0x30)

/*
 * guess: the BSP's header says 4, but the vendor's Linux driver lets TXCNT
 * grow to 6
 */
#define FIFO_DEPTH      8

#define CTL_NOT_MODELLED    (R_CTL_LSB_MASK | R_CTL_RXONLY_MASK | \
                             R_CTL_TWOBIT_MASK | R_CTL_SLAVE_MASK)

static const char *spi_name(NUC980SPIState *s)
{
    return BUS(s->bus)->name;
}

static bool is_enabled(NUC980SPIState *s)
{
    return FIELD_EX32(s->ctl, CTL, SPIEN);
}

static uint32_t spi_status(NUC980SPIState *s)
{
    uint32_t rx = fifo32_num_used(&s->rx);
    uint32_t tx = fifo32_num_used(&s->tx);
    uint32_t status = s->flags;

    status = FIELD_DP32(status, STATUS, BUSY, is_enabled(s) && tx);
    status = FIELD_DP32(status, STATUS, RXEMPTY, !rx);
    status = FIELD_DP32(status, STATUS, RXFULL, rx == FIFO_DEPTH);
    status = FIELD_DP32(status, STATUS, RXTHIF,
                        rx > FIELD_EX32(s->fifoctl, FIFOCTL, RXTH));
    status = FIELD_DP32(status, STATUS, SPIENSTS, is_enabled(s));
    status = FIELD_DP32(status, STATUS, TXEMPTY, !tx);
    status = FIELD_DP32(status, STATUS, TXFULL, tx == FIFO_DEPTH);
    status = FIELD_DP32(status, STATUS, TXTHIF,
                        tx <= FIELD_EX32(s->fifoctl, FIFOCTL, TXTH));
    status = FIELD_DP32(status, STATUS, RXCNT, rx);
    return FIELD_DP32(status, STATUS, TXCNT, tx);
}

static void spi_update_irq(NUC980SPIState *s)
{
    uint32_t status = spi_status(s);

    qemu_set_irq(s->irq,
                 (FIELD_EX32(status, STATUS, UNITIF) &&
                  FIELD_EX32(s->ctl, CTL, UNITIEN)) ||
                 (FIELD_EX32(status, STATUS, RXTHIF) &&
                  FIELD_EX32(s->fifoctl, FIFOCTL, RXTHIEN)) ||
                 (FIELD_EX32(status, STATUS, TXTHIF) &&
                  FIELD_EX32(s->fifoctl, FIFOCTL, TXTHIEN)) ||
                 (FIELD_EX32(status, STATUS, RXOVIF) &&
                  FIELD_EX32(s->fifoctl, FIFOCTL, RXOVIEN)));
}

/* Slave selects to their devices; 'active' are the bits of SSCTL.SS */
static void spi_select(NUC980SPIState *s, unsigned active)
{
    bool high = FIELD_EX32(s->ssctl, SSCTL, SSACTPOL);
    BusChild *kid;

    QTAILQ_FOREACH(kid, &BUS(s->bus)->children, sibling) {
        bool on = extract32(active, kid->index & 1, 1);

        trace_nuc980_spi_select(spi_name(s), kid->index & 1, on);
        qemu_set_irq(qdev_get_gpio_in_named(kid->child, SSI_GPIO_CS, 0),
                     on == high);
    }
}

/* SS as SSCTL says; by AUTOSS only 'during' a transfer */
static void spi_update_select(NUC980SPIState *s, bool during)
{
    bool on = during || !FIELD_EX32(s->ssctl, SSCTL, AUTOSS);

    spi_select(s, on ? FIELD_EX32(s->ssctl, SSCTL, SS) : 0);
}

/* One unit over the bus, by bytes if it has whole ones */
static uint32_t spi_exchange(NUC980SPIState *s, uint32_t tx)
{
    unsigned bits = FIELD_EX32(s->ctl, CTL, DWIDTH) ?: 32;
    bool low_first = FIELD_EX32(s->ctl, CTL, REORDER);
    uint32_t rx = 0;

    if (QTAILQ_EMPTY(&BUS(s->bus)->children)) {
        return MAKE_64BIT_MASK(0, bits);    /* nobody pulls MISO down */
    }
    if (bits % 8) {
        return ssi_transfer(s->bus, extract32(tx, 0, bits));
    }
    for (int i = 0; i < bits; i += 8) {
        int shift = low_first ? i : bits - 8 - i;

        rx = deposit32(rx, shift, 8,
                       ssi_transfer(s->bus, extract32(tx, shift, 8)));
    }
    return rx;
}

/* With one direction at a time, nothing comes in while data go out. */
static bool receives(NUC980SPIState *s)
{
    bool one_way = s->ctl & (R_CTL_HALFDPX_MASK | R_CTL_DUALIOEN_MASK |
                             R_CTL_QUADIOEN_MASK);

    return !(one_way && FIELD_EX32(s->ctl, CTL, DATDIR));
}

static void spi_transfer(NUC980SPIState *s)
{
    uint32_t tx = fifo32_pop(&s->tx);
    uint32_t rx = spi_exchange(s, tx);

    trace_nuc980_spi_transfer(spi_name(s),
                              FIELD_EX32(s->ctl, CTL, DWIDTH) ?: 32, tx, rx);
    s->flags |= R_STATUS_UNITIF_MASK;
    if (!receives(s)) {
        return;
    }
    if (fifo32_is_full(&s->rx)) {
        s->flags |= R_STATUS_RXOVIF_MASK;
    } else {
        fifo32_push(&s->rx, rx);
    }
}

static void spi_run(NUC980SPIState *s)
{
    if (is_enabled(s) && !FIELD_EX32(s->ctl, CTL, SLAVE) &&
        !fifo32_is_empty(&s->tx)) {
        bool by_itself = FIELD_EX32(s->ssctl, SSCTL, AUTOSS);

        if (by_itself) {
            spi_update_select(s, true);
        }
        while (!fifo32_is_empty(&s->tx)) {
            spi_transfer(s);
        }
        if (by_itself) {
            spi_update_select(s, false);
        }
    }
    spi_update_irq(s);
}

static uint32_t spi_receive(NUC980SPIState *s)
{
    uint32_t value;

    if (fifo32_is_empty(&s->rx)) {
        qemu_log_mask(LOG_GUEST_ERROR, "%s: RX read while empty\n",
                      spi_name(s));
        return 0;
    }
    value = fifo32_pop(&s->rx);
    spi_update_irq(s);
    return value;
}

static void spi_send(NUC980SPIState *s, uint32_t value)
{
    if (fifo32_is_full(&s->tx)) {
        qemu_log_mask(LOG_GUEST_ERROR, "%s: TX written while full\n",
                      spi_name(s));
        return;
    }
    fifo32_push(&s->tx, value);
    spi_run(s);
}

static void spi_write_fifoctl(NUC980SPIState *s, uint32_t value)
{
    const uint32_t rx = R_FIFOCTL_RXRST_MASK | R_FIFOCTL_RXFBCLR_MASK;
    const uint32_t tx = R_FIFOCTL_TXRST_MASK | R_FIFOCTL_TXFBCLR_MASK;

    if (value & rx) {
        fifo32_reset(&s->rx);
    }
    if (value & tx) {
        fifo32_reset(&s->tx);
    }
    if (value & R_FIFOCTL_RXTOIEN_MASK) {
        nuc980_unimp_once(s->seen, spi_name(s), A_FIFOCTL);
    }
    s->fifoctl = value & ~(rx | tx);
    spi_update_irq(s);
}

static void spi_write_ctl(NUC980SPIState *s, uint32_t value)
{
    if (value & CTL_NOT_MODELLED) {
        nuc980_unimp_once(s->seen, spi_name(s), A_CTL);
    }
    s->ctl = value;
    spi_run(s);
}

static uint64_t spi_read(void *opaque, hwaddr addr, unsigned size)
{
    NUC980SPIState *s = opaque;

    switch (addr) {
    case A_CTL:
        return s->ctl;
    case A_CLKDIV:
        return s->clkdiv;
    case A_SSCTL:
        return s->ssctl;
    case A_PDMACTL:
        return s->pdmactl;
    case A_FIFOCTL:
        return s->fifoctl;
    case A_STATUS:
        return spi_status(s);
    case A_TX:
        qemu_log_mask(LOG_GUEST_ERROR, "%s: TX is read\n", spi_name(s));
        return 0;
    case A_RX:
        return spi_receive(s);
    default:
        nuc980_unimp_once(s->seen, spi_name(s), addr);
        return 0;
    }
}

static void spi_write(void *opaque, hwaddr addr, uint64_t value, unsigned size)
{
    NUC980SPIState *s = opaque;

    trace_nuc980_spi_write(spi_name(s), addr, value);
    switch (addr) {
    case A_CTL:
        spi_write_ctl(s, value);
        break;
    case A_CLKDIV:
        s->clkdiv = value & R_CLKDIV_DIVIDER_MASK;
        break;
    case A_SSCTL:
        s->ssctl = value;
        spi_update_select(s, false);
        break;
    case A_PDMACTL:
        s->pdmactl = value & (R_PDMACTL_TXPDMAEN_MASK |
                              R_PDMACTL_RXPDMAEN_MASK);
        if (s->pdmactl) {
            nuc980_unimp_once(s->seen, spi_name(s), A_PDMACTL);
        }
        break;
    case A_FIFOCTL:
        spi_write_fifoctl(s, value);
        break;
    case A_STATUS:
        s->flags &= ~value;
        spi_update_irq(s);
        break;
    case A_TX:
        spi_send(s, value);
        break;
    case A_RX:
        qemu_log_mask(LOG_GUEST_ERROR, "%s: RX is written\n", spi_name(s));
        break;
    default:
        nuc980_unimp_once(s->seen, spi_name(s), addr);
        break;
    }
}

static const MemoryRegionOps spi_ops = {
    .read = spi_read,
    .write = spi_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 1, .max_access_size = 4 },
    .impl = { .min_access_size = 4, .max_access_size = 4 },
};

static void spi_reset(DeviceState *dev)
{
    NUC980SPIState *s = NUC980_SPI(dev);

    s->ctl = 0x34;              /* SUSPITV 3; guess: TXNEG, as in the M480 */
    s->fifoctl = 0x44000000;    /* guess: thresholds of 4, as in the M480 */
    s->clkdiv = s->ssctl = s->pdmactl = s->flags = 0;
    fifo32_reset(&s->tx);
    fifo32_reset(&s->rx);
    spi_update_select(s, false);
    spi_update_irq(s);
}

/* A Fifo32 counts bytes: whole words of them are saved. */
static bool holds_words(const Fifo32 *fifo)
{
    return !((fifo->fifo.head | fifo->fifo.num) % sizeof(uint32_t));
}

static int spi_post_load(void *opaque, int version_id)
{
    NUC980SPIState *s = opaque;

    if (!holds_words(&s->tx) || !holds_words(&s->rx)) {
        return -EINVAL;
    }
    spi_update_select(s, false);
    spi_update_irq(s);
    return 0;
}

static const VMStateDescription vmstate_spi = {
    .name = TYPE_NUC980_SPI,
    .version_id = 1,
    .minimum_version_id = 1,
    .post_load = spi_post_load,
    .fields = (VMStateField[]) {
        VMSTATE_UINT32(ctl, NUC980SPIState),
        VMSTATE_UINT32(clkdiv, NUC980SPIState),
        VMSTATE_UINT32(ssctl, NUC980SPIState),
        VMSTATE_UINT32(pdmactl, NUC980SPIState),
        VMSTATE_UINT32(fifoctl, NUC980SPIState),
        VMSTATE_UINT32(flags, NUC980SPIState),
        VMSTATE_FIFO32(tx, NUC980SPIState),
        VMSTATE_FIFO32(rx, NUC980SPIState),
        VMSTATE_END_OF_LIST()
    }
};

static void spi_realize(DeviceState *dev, Error **errp)
{
    NUC980_SPI(dev)->bus = ssi_create_bus(dev, NULL);
}

static void spi_init(Object *obj)
{
    NUC980SPIState *s = NUC980_SPI(obj);

    memory_region_init_io(&s->iomem, obj, &spi_ops, s, TYPE_NUC980_SPI,
                          NUC980_SPI_SIZE);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq);
    fifo32_create(&s->tx, FIFO_DEPTH);
    fifo32_create(&s->rx, FIFO_DEPTH);
}

static void spi_finalize(Object *obj)
{
    NUC980SPIState *s = NUC980_SPI(obj);

    fifo32_destroy(&s->tx);
    fifo32_destroy(&s->rx);
}

static void spi_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->desc = "NUC980 (Q)SPI controller";
    dc->realize = spi_realize;
    dc->reset = spi_reset;
    dc->vmsd = &vmstate_spi;
}

static const TypeInfo nuc980_spi_types[] = {
    {
        .name = TYPE_NUC980_SPI,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980SPIState),
        .instance_init = spi_init,
        .instance_finalize = spi_finalize,
        .class_init = spi_class_init,
    },
};

DEFINE_TYPES(nuc980_spi_types)
