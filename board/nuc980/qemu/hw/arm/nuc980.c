/*
 * Nuvoton NUC980 system on chip
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "exec/address-spaces.h"
#include "hw/arm/nuc980.h"
#include "hw/core/split-irq.h"
#include "hw/irq.h"
#include "hw/qdev-clock.h"
#include "hw/qdev-properties.h"
#include "qapi/error.h"
#include "qemu/units.h"

#define NUC980_SRAM         0xbc000000
#define NUC980_IO           0xb0000000

static const struct {
    hwaddr addr;
    int irq;
} uart_map[NUC980_UARTS] = {
    { 0xb0070000, 36 }, { 0xb0071000, 37 }, { 0xb0072000, 38 },
    { 0xb0073000, 43 }, { 0xb0074000, 39 }, { 0xb0075000, 44 },
    { 0xb0076000, 40 }, { 0xb0077000, 45 }, { 0xb0078000, 41 },
    { 0xb0079000, 46 },
}, etimer_map[NUC980_TIMERS] = {
    { 0xb0050000, 16 }, { 0xb0050100, 17 }, { 0xb0051000, 30 },
    { 0xb0051100, 31 }, { 0xb0052000, 32 }, { 0xb0052100, 34 },
}, pdma_map[NUC980_PDMAS] = {
    { 0xb0008000, 25 }, { 0xb0009000, 26 },
}, spi_map[NUC980_SPIS] = {
    { 0xb0060000, 51 }, { 0xb0061000, 52 }, { 0xb0062000, 50 },
};

/* Request numbers of the UARTs' transmit side; receive is the next number */
static const int uart_request[NUC980_UARTS] = {
    4, 6, 8, 10, 12, 14, 16, 18, 26, 28
};

static const struct {
    hwaddr addr;
    int tx_irq, rx_irq;
} emac_map[NUC980_EMACS] = {
    { 0xb0012000, 21, 19 }, { 0xb0022000, 22, 20 },
};

static void nuc980_init(Object *obj)
{
    NUC980State *s = NUC980(obj);

    object_initialize_child(obj, "cpu", &s->cpu, ARM_CPU_TYPE_NAME("arm926"));
    object_initialize_child(obj, "unmodelled", &s->unmodelled,
                            TYPE_NUC980_UNMODELLED);
    object_initialize_child(obj, "aic", &s->aic, TYPE_NUC980_AIC);
    object_initialize_child(obj, "pins", &s->pins, TYPE_NUC980_PINS);
    object_initialize_child(obj, "sys", &s->sys, TYPE_NUC980_SYS);
    object_property_add_alias(obj, "booted", OBJECT(&s->sys), "booted");
    object_initialize_child(obj, "sdic", &s->sdic, TYPE_NUC980_SDIC);
    object_property_add_alias(obj, "ram-mib", OBJECT(&s->sdic), "ram-mib");
    for (int i = 0; i < NUC980_TIMERS; i++) {
        object_initialize_child(obj, "etimer[*]", &s->etimer[i],
                                TYPE_NUC980_ETIMER);
    }
    object_initialize_child(obj, "wdt", &s->wdt, TYPE_NUC980_WDT);
    object_initialize_child(obj, "wwdt", &s->wwdt, TYPE_NUC980_WWDT);
    object_initialize_child(obj, "rtc", &s->rtc, TYPE_NUC980_RTC);
    for (int i = 0; i < NUC980_PDMAS; i++) {
        object_initialize_child(obj, "pdma[*]", &s->pdma[i], TYPE_NUC980_PDMA);
    }
    for (int i = 0; i < NUC980_UARTS; i++) {
        object_initialize_child(obj, "uart[*]", &s->uart[i], TYPE_NUC980_UART);
    }
    object_initialize_child(obj, "gpio", &s->gpio, TYPE_NUC980_GPIO);
    object_initialize_child(obj, "fmi", &s->fmi, TYPE_NUC980_FMI);
    for (int i = 0; i < NUC980_SPIS; i++) {
        object_initialize_child(obj, "spi[*]", &s->spi[i], TYPE_NUC980_SPI);
    }
    for (int i = 0; i < NUC980_EMACS; i++) {
        object_initialize_child(obj, "emac[*]", &s->emac[i], TYPE_NUC980_EMAC);
    }
}

static void nuc980_place(void *dev, hwaddr addr)
{
    sysbus_realize(SYS_BUS_DEVICE(dev), &error_fatal);
    sysbus_mmio_map(SYS_BUS_DEVICE(dev), 0, addr);
}

static void nuc980_interrupt(NUC980State *s, void *dev, int line, int source)
{
    sysbus_connect_irq(SYS_BUS_DEVICE(dev), line,
                       qdev_get_gpio_in(DEVICE(&s->aic), source));
}

static void nuc980_clock(NUC980State *s, void *dev, const char *in,
                         const char *out)
{
    qdev_connect_clock_in(DEVICE(dev), in,
                          qdev_get_clock_out(DEVICE(&s->sys), out));
}

static void nuc980_clock_n(NUC980State *s, void *dev, const char *out, int n)
{
    g_autofree char *name = g_strdup_printf("%s%d", out, n);

    nuc980_clock(s, dev, "clk", name);
}

/* Pins' output n of this name to the device's only input of that name */
static void nuc980_route(NUC980State *s, const char *out, int n,
                         void *dev, const char *in)
{
    qdev_connect_gpio_out_named(DEVICE(&s->pins), out, n,
                                qdev_get_gpio_in_named(DEVICE(dev), in, 0));
}

static void nuc980_realize_uart(NUC980State *s, int i)
{
    NUC980UARTState *uart = &s->uart[i];

    nuc980_clock_n(s, uart, "uart", i);
    nuc980_place(uart, uart_map[i].addr);
    nuc980_interrupt(s, uart, 0, uart_map[i].irq);
    nuc980_route(s, "uart-rxd", i, uart, "rxd-pin");
    nuc980_route(s, "uart-txd", i, uart, "txd-pin");
    nuc980_route(s, "uart-rts", i, uart, "rts-pin");
    nuc980_route(s, "uart-cts", i, uart, "cts-pin");
}

static void nuc980_realize_pdma(NUC980State *s)
{
    for (int i = 0; i < NUC980_PDMAS; i++) {
        nuc980_clock(s, &s->pdma[i], "hclk", "hclk");
        nuc980_place(&s->pdma[i], pdma_map[i].addr);
        nuc980_interrupt(s, &s->pdma[i], 0, pdma_map[i].irq);
    }
    /* Either controller can serve any UART. */
    for (int i = 0; i < NUC980_UARTS; i++) {
        for (int rx = 0; rx < 2; rx++) {
            DeviceState *both = qdev_new(TYPE_SPLIT_IRQ);

            object_property_add_child(OBJECT(s), "request[*]", OBJECT(both));
            qdev_prop_set_uint16(both, "num-lines", NUC980_PDMAS);
            qdev_realize_and_unref(both, NULL, &error_fatal);
            qdev_connect_gpio_out_named(DEVICE(&s->uart[i]),
                                        rx ? "rx-dma" : "tx-dma", 0,
                                        qdev_get_gpio_in(both, 0));
            for (int k = 0; k < NUC980_PDMAS; k++) {
                qdev_connect_gpio_out(both, k,
                    qdev_get_gpio_in_named(DEVICE(&s->pdma[k]), "request",
                                           uart_request[i] + rx));
            }
        }
    }
}

static void nuc980_realize_emac(NUC980State *s, int i)
{
    NUC980EMACState *emac = &s->emac[i];

    nuc980_place(emac, emac_map[i].addr);
    nuc980_interrupt(s, emac, 0, emac_map[i].tx_irq);
    nuc980_interrupt(s, emac, 1, emac_map[i].rx_irq);
    nuc980_route(s, "emac-rmii", i, emac, "rmii");
    nuc980_route(s, "emac-mdio", i, emac, "mdio");
}

static void nuc980_realize_gpio(NUC980State *s)
{
    static const int sources[NUC980_GPIO_PORTS + NUC980_GPIO_EINTS] = {
        8, 9, 10, 11, 49, 57, 63,       /* ports A to G */
        4, 5, 6, 7,                     /* EINT0 to EINT3 */
    };
    DeviceState *gpio = DEVICE(&s->gpio);

    nuc980_place(gpio, 0xb0004000);
    for (int i = 0; i < ARRAY_SIZE(sources); i++) {
        nuc980_interrupt(s, gpio, i, sources[i]);
    }
    for (int n = 0; n < NUC980_PIN_COUNT; n++) {
        qdev_connect_gpio_out_named(DEVICE(&s->pins), "peripheral", n,
                                    qdev_get_gpio_in_named(gpio, "peripheral",
                                                           n));
        qdev_connect_gpio_out_named(DEVICE(&s->pins), "eint", n,
                                    qdev_get_gpio_in_named(gpio, "eint", n));
    }
}

static void nuc980_realize_watchdogs(NUC980State *s)
{
    DeviceState *sys = DEVICE(&s->sys);

    nuc980_clock(s, &s->wdt, "clk", "wdt");
    nuc980_place(&s->wdt, 0xb0040000);
    nuc980_interrupt(s, &s->wdt, 0, 1);
    qdev_connect_gpio_out_named(sys, "unlocked", 0,
                                qdev_get_gpio_in_named(DEVICE(&s->wdt),
                                                       "unlocked", 0));
    qdev_connect_gpio_out_named(DEVICE(&s->wdt), "reset", 0,
                                qdev_get_gpio_in_named(sys, "wdt-reset", 0));

    nuc980_clock(s, &s->wwdt, "clk", "wwdt");
    nuc980_place(&s->wwdt, 0xb0040100);
    nuc980_interrupt(s, &s->wwdt, 0, 2);
    qdev_connect_gpio_out_named(DEVICE(&s->wwdt), "reset", 0,
                                qdev_get_gpio_in_named(sys, "wdt-reset", 1));
}

static void nuc980_reset_block(void *opaque, int n, int level)
{
    if (level) {
        device_cold_reset(opaque);
    }
}

/* The system registers' reset bit n resets this device. */
static void nuc980_reset_line(NUC980State *s, int n, void *dev)
{
    qdev_connect_gpio_out_named(DEVICE(&s->sys), "reset", n,
        qemu_allocate_irq(nuc980_reset_block, DEVICE(dev), n));
}

static void nuc980_realize_resets(NUC980State *s)
{
    nuc980_reset_line(s, NUC980_RESET_SDIC, &s->sdic);
    nuc980_reset_line(s, NUC980_RESET_GPIO, &s->gpio);
    nuc980_reset_line(s, NUC980_RESET_FMI, &s->fmi);
    nuc980_reset_line(s, NUC980_RESET_AIC, &s->aic);
    for (int i = 0; i < NUC980_PDMAS; i++) {
        nuc980_reset_line(s, NUC980_RESET_PDMA0 + i, &s->pdma[i]);
    }
    for (int i = 0; i < NUC980_EMACS; i++) {
        nuc980_reset_line(s, NUC980_RESET_EMAC0 + i, &s->emac[i]);
    }
    for (int i = 0; i < NUC980_TIMERS; i++) {
        nuc980_reset_line(s, NUC980_RESET_ETIMER0 + i, &s->etimer[i]);
    }
    for (int i = 0; i < NUC980_UARTS; i++) {
        nuc980_reset_line(s, NUC980_RESET_UART0 + i, &s->uart[i]);
    }
    for (int i = 0; i < NUC980_SPIS; i++) {
        nuc980_reset_line(s, NUC980_RESET_QSPI0 + i, &s->spi[i]);
    }
}

static void nuc980_realize(DeviceState *dev, Error **errp)
{
    NUC980State *s = NUC980(dev);
    MemoryRegion *memory = get_system_memory();

    if (!qdev_realize(DEVICE(&s->cpu), NULL, errp)) {
        return;
    }
    memory_region_init_ram(&s->sram, OBJECT(dev), "nuc980.sram", 16 * KiB,
                           &error_fatal);
    memory_region_add_subregion(memory, NUC980_SRAM, &s->sram);
    sysbus_realize(SYS_BUS_DEVICE(&s->unmodelled), &error_fatal);
    sysbus_mmio_map_overlap(SYS_BUS_DEVICE(&s->unmodelled), 0, NUC980_IO, -1);

    nuc980_place(&s->aic, 0xb0042000);
    sysbus_connect_irq(SYS_BUS_DEVICE(&s->aic), 0,
                       qdev_get_gpio_in(DEVICE(&s->cpu), ARM_CPU_IRQ));
    sysbus_connect_irq(SYS_BUS_DEVICE(&s->aic), 1,
                       qdev_get_gpio_in(DEVICE(&s->cpu), ARM_CPU_FIQ));

    qdev_realize(DEVICE(&s->pins), NULL, &error_fatal);
    object_property_set_link(OBJECT(&s->sys), "pins", OBJECT(&s->pins),
                             &error_abort);
    nuc980_place(&s->sys, NUC980_IO);
    nuc980_place(&s->sdic, 0xb0002000);

    for (int i = 0; i < NUC980_TIMERS; i++) {
        nuc980_clock_n(s, &s->etimer[i], "etimer", i);
        nuc980_place(&s->etimer[i], etimer_map[i].addr);
        nuc980_interrupt(s, &s->etimer[i], 0, etimer_map[i].irq);
    }
    nuc980_realize_watchdogs(s);
    nuc980_place(&s->rtc, 0xb0041000);
    nuc980_interrupt(s, &s->rtc, 0, 15);

    for (int i = 0; i < NUC980_UARTS; i++) {
        nuc980_realize_uart(s, i);
    }
    nuc980_realize_pdma(s);

    nuc980_realize_gpio(s);
    nuc980_place(&s->fmi, 0xb0019000);
    nuc980_interrupt(s, &s->fmi, 0, 28);
    nuc980_route(s, "nand", 0, &s->fmi, "pins");
    for (int i = 0; i < NUC980_SPIS; i++) {
        nuc980_place(&s->spi[i], spi_map[i].addr);
        nuc980_interrupt(s, &s->spi[i], 0, spi_map[i].irq);
    }
    for (int i = 0; i < NUC980_EMACS; i++) {
        nuc980_realize_emac(s, i);
    }
    nuc980_realize_resets(s);
}

static void nuc980_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->realize = nuc980_realize;
    /* Reason: the board's memory and block devices are wired in code */
    dc->user_creatable = false;
}

static const TypeInfo nuc980_types[] = {
    {
        .name = TYPE_NUC980,
        .parent = TYPE_DEVICE,
        .instance_size = sizeof(NUC980State),
        .instance_init = nuc980_init,
        .class_init = nuc980_class_init,
    },
};

DEFINE_TYPES(nuc980_types)
