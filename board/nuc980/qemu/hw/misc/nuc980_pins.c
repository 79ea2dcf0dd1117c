/*
 * Nuvoton NUC980 pins: multi-function routing and the board's wiring
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "hw/irq.h"
#include "hw/misc/nuc980_pins.h"
#include "hw/misc/nuc980_pins_table.h"
#include "migration/vmstate.h"

static const char *pins_function(NUC980PinsState *s, int port, int pin)
{
    uint32_t value = extract32(s->mfp[2 * port + pin / 8], 4 * (pin % 8), 4);

    return nuc980_pin_function[port][pin][value];
}

/* All pins that the board wires to a signal of this prefix carry it. */
static bool pins_routed(NUC980PinsState *s, const char *prefix)
{
    bool any = false;

    for (int port = 0; port < NUC980_PORTS; port++) {
        for (int pin = 0; pin < NUC980_PINS_A_PORT; pin++) {
            const char *wired = nuc980_pin_wired[port][pin];

            if (wired && g_str_has_prefix(wired, prefix)) {
                if (g_strcmp0(pins_function(s, port, pin), wired)) {
                    return false;
                }
                any = true;
            }
        }
    }
    return any;
}

static void pins_set(NUC980PinsState *s, qemu_irq line, const char *fmt, int n)
{
    g_autofree char *prefix = g_strdup_printf(fmt, n);

    qemu_set_irq(line, pins_routed(s, prefix));
}

static bool pins_all(NUC980PinsState *s, int n, const char *const *names)
{
    bool all = true;

    for (; *names; names++) {
        g_autofree char *name = g_strdup_printf("RMII%d_%s", n, *names);

        all &= pins_routed(s, name);
    }
    return all;
}

static void pins_update(NUC980PinsState *s)
{
    static const char *const rmii[] = {
        "RXERR", "CRSDV", "RXD1", "RXD0", "REFCLK", "TXEN", "TXD1", "TXD0", NULL
    };
    static const char *const mdio[] = { "MDIO", "MDC", NULL };

    for (int i = 0; i < NUC980_UARTS; i++) {
        pins_set(s, s->uart_rxd[i], "UART%d_RXD", i);
        pins_set(s, s->uart_txd[i], "UART%d_TXD", i);
        pins_set(s, s->uart_rts[i], "UART%d_RTS", i);
        pins_set(s, s->uart_cts[i], "UART%d_CTS", i);
    }
    for (int i = 0; i < NUC980_EMACS; i++) {
        qemu_set_irq(s->emac_rmii[i], pins_all(s, i, rmii));
        qemu_set_irq(s->emac_mdio[i], pins_all(s, i, mdio));
    }
    qemu_set_irq(s->nand, pins_routed(s, "NAND_"));
}

void nuc980_pins_write(NUC980PinsState *s, unsigned reg, uint32_t value)
{
    g_assert(reg < NUC980_MFP_REGS);
    s->mfp[reg] = value;
    pins_update(s);
}

static int pins_post_load(void *opaque, int version_id)
{
    pins_update(opaque);
    return 0;
}

static const VMStateDescription vmstate_nuc980_pins = {
    .name = TYPE_NUC980_PINS,
    .version_id = 1,
    .minimum_version_id = 1,
    .post_load = pins_post_load,
    .fields = (VMStateField[]) {
        VMSTATE_UINT32_ARRAY(mfp, NUC980PinsState, NUC980_MFP_REGS),
        VMSTATE_END_OF_LIST()
    }
};

static void pins_init(Object *obj)
{
    NUC980PinsState *s = NUC980_PINS(obj);
    DeviceState *dev = DEVICE(obj);

    qdev_init_gpio_out_named(dev, s->uart_rxd, "uart-rxd", NUC980_UARTS);
    qdev_init_gpio_out_named(dev, s->uart_txd, "uart-txd", NUC980_UARTS);
    qdev_init_gpio_out_named(dev, s->uart_rts, "uart-rts", NUC980_UARTS);
    qdev_init_gpio_out_named(dev, s->uart_cts, "uart-cts", NUC980_UARTS);
    qdev_init_gpio_out_named(dev, s->emac_rmii, "emac-rmii", NUC980_EMACS);
    qdev_init_gpio_out_named(dev, s->emac_mdio, "emac-mdio", NUC980_EMACS);
    qdev_init_gpio_out_named(dev, &s->nand, "nand", 1);
}

static void pins_class_init(ObjectClass *klass, void *data)
{
    DEVICE_CLASS(klass)->vmsd = &vmstate_nuc980_pins;
}

static const TypeInfo pins_types[] = {
    {
        .name = TYPE_NUC980_PINS,
        .parent = TYPE_DEVICE,
        .instance_size = sizeof(NUC980PinsState),
        .instance_init = pins_init,
        .class_init = pins_class_init,
    },
};

DEFINE_TYPES(pins_types)
