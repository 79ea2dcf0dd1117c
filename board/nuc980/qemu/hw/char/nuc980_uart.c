/*
 * Nuvoton NUC980 UART
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "hw/irq.h"
#include "hw/qdev-clock.h"
#include "hw/qdev-properties.h"
#include "hw/qdev-properties-system.h"
#include "qemu/log.h"
#include "qemu/module.h"
#include "hw/char/nuc980_uart.h"

static int64_t uart_bit_ns(NUC980UARTState *u)
{
    uint32_t div = (u->baud & 0xffff) + 2;  /* mode 2 (BAUDM1|BAUDM0 = 1) */

    if (!(u->baud & (1u << 29))) {
        div = ((u->baud & 0xffff) + 2) * 16;
    }
    return muldiv64(NANOSECONDS_PER_SECOND, div, clock_get_hz(u->clk));
}

static int64_t uart_char_ns(NUC980UARTState *u)
{
    int bits = 1 + 5 + (u->lcr & 3) + 1 + !!(u->lcr & 4) + !!(u->lcr & 8);

    return bits * uart_bit_ns(u);
}

static int uart_trigger(NUC980UARTState *u)
{
    static const int lvl[] = { 1, 4, 8, 14 };

    return lvl[(u->fcr >> 4) & 3];
}

static uint32_t uart_isr(NUC980UARTState *u)
{
    uint32_t f = 0;

    f |= u->rx_n >= uart_trigger(u) ? 1 : 0;        /* RDAIF */
    f |= u->tx_n == 0 ? 2 : 0;                      /* THREIF */
    f |= u->fsr_err & 0x70 ? 4 : 0;                 /* RLSIF */
    f |= u->toif ? 0x10 : 0;                        /* RXTOIF */
    f |= u->fsr_err & ((1 << 24) | 1) ? 0x20 : 0;   /* BUFERRIF */
    return f | (f & u->ier & 0x37) << 8;
}

static void uart_update(NUC980UARTState *u)
{
    qemu_set_irq(u->irq, (uart_isr(u) >> 8) & 0x37);
    qemu_set_irq(u->tx_dma, (u->ier & (1 << 14)) && u->tx_n < NUC980_UART_FIFO);
    qemu_set_irq(u->rx_dma, (u->ier & (1 << 15)) && u->rx_n);
}

static void uart_load_shifter(NUC980UARTState *u)
{
    u->shift = u->tx[0];
    memmove(u->tx, u->tx + 1, --u->tx_n);
    u->shifting = true;
    timer_mod(u->tx_t, qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL) +
              (u->pace ? uart_char_ns(u) : 1));
}

static void uart_tx_done(void *opaque)
{
    NUC980UARTState *u = opaque;

    u->shifting = false;
    /*
     * With a transceiver fitted only RS-485 auto-direction with RTS active
     * high opens its driver; anything else never reaches the bus.
     */
    if (u->tx_pin && (!u->rs485 || ((u->fun & 7) == 3 && (u->alt & 0x400) &&
                                    !(u->mcr & 0x200)))) {
        qemu_chr_fe_write_all(&u->chr, &u->shift, 1);
    } else {
        u->dropped++;
    }
    if (u->tx_n) {
        uart_load_shifter(u);
    }
    uart_update(u);
}

static void uart_rx_free(void *opaque)
{
    NUC980UARTState *u = opaque;

    u->rx_busy = false;
    qemu_chr_fe_accept_input(&u->chr);
}

static void uart_rx_timeout(void *opaque)
{
    NUC980UARTState *u = opaque;

    if (u->rx_n) {
        u->toif = true;
        uart_update(u);
    }
}

static int uart_can_receive(void *opaque)
{
    NUC980UARTState *u = opaque;

    if (u->pace) {
        return !u->rx_busy;
    }
    return u->rx_n < NUC980_UART_FIFO;
}

static void uart_receive(void *opaque, const uint8_t *buf, int n)
{
    NUC980UARTState *u = opaque;
    int64_t now = qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL);

    if (u->pace) {
        u->rx_busy = true;
        timer_mod(u->rx_t, now + uart_char_ns(u));
    }
    if (!u->rx_pin) {
        u->dropped += n;
        return;
    }
    for (int i = 0; i < n; i++) {
        if (u->rx_n < NUC980_UART_FIFO) {
            u->rx[u->rx_n++] = buf[i];
        } else {
            u->fsr_err |= 1;                        /* RX overrun */
        }
    }
    if (u->ier & (1 << 11)) {
        timer_mod(u->to_t, now + MAX(u->tor & 0xff, 1) * uart_bit_ns(u));
    }
    uart_update(u);
}

static uint64_t uart_read(void *opaque, hwaddr a, unsigned size)
{
    NUC980UARTState *u = opaque;
    uint32_t v = 0;

    switch (a) {
    case 0x00:
        if (u->rx_n) {
            v = u->rx[0];
            memmove(u->rx, u->rx + 1, --u->rx_n);
            u->toif = false;
            if (u->rx_n && (u->ier & (1 << 11))) {
                timer_mod(u->to_t, qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL) +
                          MAX(u->tor & 0xff, 1) * uart_bit_ns(u));
            } else if (!u->rx_n) {
                timer_del(u->to_t);
            }
            uart_update(u);
            if (!u->pace) {
                qemu_chr_fe_accept_input(&u->chr);
            }
        }
        return v;
    case 0x04: return u->ier;
    case 0x08: return u->fcr;
    case 0x0c: return u->lcr;
    case 0x10: return u->mcr;
    case 0x14: return u->msr & ~0x10;               /* CTS pin asserted */
    case 0x18:
        v = u->fsr_err;
        v |= (u->rx_n & 0x3f) << 8;
        v |= u->rx_n == 0 ? 1 << 14 : 0;
        v |= u->rx_n >= NUC980_UART_FIFO ? 1 << 15 : 0;
        v |= (u->tx_n & 0x3f) << 16;
        v |= u->tx_n == 0 ? 1 << 22 : 0;
        v |= u->tx_n >= NUC980_UART_FIFO ? 1 << 23 : 0;
        v |= !u->tx_n && !u->shifting ? 1 << 28 : 0;
        return v;
    case 0x1c: return uart_isr(u);
    case 0x20: return u->tor;
    case 0x24: return u->baud;
    case 0x28: return u->ircr;
    case 0x2c: return u->alt;
    case 0x30: return u->fun;
    }
    return 0;
}

static void uart_write(void *opaque, hwaddr a, uint64_t v, unsigned size)
{
    NUC980UARTState *u = opaque;

    switch (a) {
    case 0x00:
        if (u->tx_n < NUC980_UART_FIFO) {
            u->tx[u->tx_n++] = v;
            if (!u->shifting) {
                uart_load_shifter(u);
            }
        } else {
            u->fsr_err |= 1 << 24;
        }
        break;
    case 0x04: u->ier = v; break;
    case 0x08:
        if (v & 2) {
            u->rx_n = 0;
            u->toif = false;
        }
        if (v & 4) {
            u->tx_n = 0;
        }
        u->fcr = v & ~6;
        break;
    case 0x0c: u->lcr = v; break;
    case 0x10: u->mcr = v; break;
    case 0x14: u->msr = v & ~1; break;
    case 0x18: u->fsr_err &= ~v; break;
    case 0x1c: break;
    case 0x20: u->tor = v; break;
    case 0x24: u->baud = v; break;
    case 0x28: u->ircr = v; break;
    case 0x2c: u->alt = v; break;
    case 0x30: u->fun = v; break;
    }
    uart_update(u);
}

static const MemoryRegionOps uart_ops = {
    .read = uart_read, .write = uart_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 1, .max_access_size = 4 },
    .impl = { .min_access_size = 4, .max_access_size = 4 },
};

static void uart_reset(DeviceState *dev)
{
    NUC980UARTState *u = NUC980_UART(dev);

    u->rx_n = u->tx_n = 0;
    u->shifting = u->rx_busy = u->toif = false;
    u->ier = u->fcr = u->lcr = u->tor = u->fsr_err = 0;
    u->mcr = 0x200;
    u->msr = 0x110;
    u->baud = 0x0f000000;
    u->ircr = 0x40;
    u->alt = 0xc;
    u->fun = 0;
    timer_del(u->tx_t);
    timer_del(u->rx_t);
    timer_del(u->to_t);
}

static void uart_realize(DeviceState *dev, Error **errp)
{
    NUC980UARTState *u = NUC980_UART(dev);

    qemu_chr_fe_set_handlers(&u->chr, uart_can_receive, uart_receive, NULL,
                             NULL, u, NULL, true);
}

static void uart_rxd_pin(void *opaque, int n, int level)
{
    NUC980_UART(opaque)->rx_pin = level;
}

static void uart_txd_pin(void *opaque, int n, int level)
{
    NUC980_UART(opaque)->tx_pin = level;
}

static void uart_modem_pin(void *opaque, int n, int level)
{
}

static void uart_init(Object *obj)
{
    NUC980UARTState *u = NUC980_UART(obj);

    memory_region_init_io(&u->iomem, obj, &uart_ops, u, "nuc980-uart", 0x1000);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &u->iomem);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &u->irq);
    u->clk = qdev_init_clock_in(DEVICE(obj), "clk", NULL, NULL, 0);
    qdev_init_gpio_in_named(DEVICE(obj), uart_rxd_pin, "rxd-pin", 1);
    qdev_init_gpio_in_named(DEVICE(obj), uart_txd_pin, "txd-pin", 1);
    qdev_init_gpio_in_named(DEVICE(obj), uart_modem_pin, "rts-pin", 1);
    qdev_init_gpio_in_named(DEVICE(obj), uart_modem_pin, "cts-pin", 1);
    qdev_init_gpio_out_named(DEVICE(obj), &u->tx_dma, "tx-dma", 1);
    qdev_init_gpio_out_named(DEVICE(obj), &u->rx_dma, "rx-dma", 1);
    u->tx_t = timer_new_ns(QEMU_CLOCK_VIRTUAL, uart_tx_done, u);
    u->rx_t = timer_new_ns(QEMU_CLOCK_VIRTUAL, uart_rx_free, u);
    u->to_t = timer_new_ns(QEMU_CLOCK_VIRTUAL, uart_rx_timeout, u);
}

static Property uart_props[] = {
    DEFINE_PROP_CHR("chardev", NUC980UARTState, chr),
    DEFINE_PROP_BOOL("pace", NUC980UARTState, pace, true),
    DEFINE_PROP_BOOL("rs485", NUC980UARTState, rs485, false),
    DEFINE_PROP_END_OF_LIST(),
};

static void uart_class_init(ObjectClass *k, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(k);

    dc->reset = uart_reset;
    dc->realize = uart_realize;
    device_class_set_props(dc, uart_props);
}

static const TypeInfo nuc980_uart_types[] = {
    {
        .name = TYPE_NUC980_UART,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980UARTState),
        .instance_init = uart_init,
        .class_init = uart_class_init,
    },
};

DEFINE_TYPES(nuc980_uart_types)
