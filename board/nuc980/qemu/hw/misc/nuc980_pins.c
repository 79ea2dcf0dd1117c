/*
 * Nuvoton NUC980 pins: multi-function routing and the board's wiring
 *
 * Each pin has a field of four bits in the MFP registers that makes it a GPIO
 * (0) or one of up to eight signals of the peripherals. A peripheral's line
 * works while the pin that the board wires to it carries its signal. Whatever
 * cannot work on a board is warned of, and stands in `info nuc980-pins` while
 * it lasts:
 *  - a value without a function, a pin that does not exist, is not brought out
 *    or must not be used;
 *  - a pin switched straight from one peripheral to another, which takes it
 *    from the first without its driver's knowledge;
 *  - a signal on a pin that the board wires to another one: two drivers on
 *    one wire, or none;
 *  - one signal on two pins;
 *  - a device of the board that has but a part of its pins.
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "hw/irq.h"
#include "hw/misc/nuc980_pins.h"
#include "hw/misc/nuc980_pins_table.h"
#include "hw/qdev-properties.h"
#include "migration/vmstate.h"
#include "monitor/monitor.h"
#include "qapi/error.h"
#include "qapi/qmp/qdict.h"
#include "qapi/qmp/qlist.h"
#include "qapi/visitor.h"
#include "qemu/error-report.h"
#include "trace.h"

#define GPIO_VALUE          0

/*
 * Drivers switch a device's pins one by one. Only what is left of that after
 * this time is a device without some of its pins.
 */
#define SETTLE_NS           (100 * SCALE_MS)

QEMU_BUILD_BUG_ON(NUC980_PIN_COUNT != NUC980_PORTS * NUC980_PINS_A_PORT);
QEMU_BUILD_BUG_ON(ARRAY_SIZE(nuc980_pin_owner) > NUC980_PIN_OWNERS);

const char *nuc980_pin_name(unsigned n)
{
    static char names[NUC980_PIN_COUNT][5];

    g_assert(n < NUC980_PIN_COUNT);
    snprintf(names[n], sizeof(names[n]), "P%c%u",
             'A' + n / NUC980_PINS_A_PORT, n % NUC980_PINS_A_PORT);
    return names[n];
}

static const char *pin_function(unsigned n, unsigned value)
{
    return nuc980_pin_function[n / NUC980_PINS_A_PORT]
                              [n % NUC980_PINS_A_PORT][value];
}

static const char *pin_wired(NUC980PinsState *s, unsigned n)
{
    return nuc980_board[s->board].wired[n / NUC980_PINS_A_PORT]
                                       [n % NUC980_PINS_A_PORT];
}

static const char *pin_closed(NUC980PinsState *s, unsigned n)
{
    return nuc980_board[s->board].closed[n / NUC980_PINS_A_PORT]
                                        [n % NUC980_PINS_A_PORT];
}

static unsigned pin_value(NUC980PinsState *s, unsigned n)
{
    return extract32(s->mfp[n / 8], 4 * (n % 8), 4);
}

static const char *pin_signal(NUC980PinsState *s, unsigned n)
{
    return pin_function(n, pin_value(s, n));
}

/* Index of a signal's prefix in the table; -1: of no peripheral there */
static int signal_prefix(const char *signal)
{
    for (int i = 0; i < ARRAY_SIZE(nuc980_pin_owner); i++) {
        if (g_str_has_prefix(signal, nuc980_pin_owner[i].prefix)) {
            return i;
        }
    }
    return -1;
}

/* Whose signal this is; NULL: of no peripheral in the table */
static const char *signal_owner(const char *signal)
{
    int prefix = signal_prefix(signal);

    return prefix < 0 ? NULL : nuc980_pin_owner[prefix].owner;
}

static bool is_eint(const char *signal)
{
    return signal && g_str_has_prefix(signal, "EINT");
}

bool nuc980_pin_exists(unsigned n)
{
    return pin_function(n, GPIO_VALUE);
}

int nuc980_board_number(const char *name)
{
    for (int i = 0; i < ARRAY_SIZE(nuc980_board); i++) {
        if (!strcmp(nuc980_board[i].name, name)) {
            return i;
        }
    }
    return -1;
}

const char *nuc980_board_name(unsigned board)
{
    return board < ARRAY_SIZE(nuc980_board) ? nuc980_board[board].name : NULL;
}

bool nuc980_pin_wires(NUC980PinsState *s, const char *signal)
{
    for (int n = 0; n < NUC980_PIN_COUNT; n++) {
        if (!g_strcmp0(pin_wired(s, n), signal)) {
            return true;
        }
    }
    return false;
}

int nuc980_pin_eint(unsigned n)
{
    for (unsigned value = 0; value < NUC980_PIN_VALUES; value++) {
        if (is_eint(pin_function(n, value))) {
            return pin_function(n, value)[strlen("EINT")] - '0';
        }
    }
    return -1;
}

/* ---- conflicts */

/* The first other pin that is the same signal, or -1 */
static int pin_twin(NUC980PinsState *s, unsigned n)
{
    const char *signal = pin_signal(s, n);

    /* GPIO tells apart the pins of one external interrupt. */
    if (!signal || pin_value(s, n) == GPIO_VALUE || is_eint(signal)) {
        return -1;
    }
    for (int i = 0; i < NUC980_PIN_COUNT; i++) {
        if (i != n && !g_strcmp0(pin_signal(s, i), signal)) {
            return i;
        }
    }
    return -1;
}

static void G_GNUC_PRINTF(2, 3) add_reason(GString *reasons,
                                           const char *fmt, ...)
{
    va_list args;

    if (reasons->len) {
        g_string_append(reasons, "; ");
    }
    va_start(args, fmt);
    g_string_append_vprintf(reasons, fmt, args);
    va_end(args);
}

/* Why a pin cannot be what it is switched to; NULL if it can */
static char *pin_conflict(NUC980PinsState *s, unsigned n)
{
    GString *reasons = g_string_new(NULL);
    unsigned value = pin_value(s, n);
    int twin = pin_twin(s, n);

    if (value != GPIO_VALUE) {
        if (!nuc980_pin_exists(n)) {
            add_reason(reasons, "the chip has no such pin");
        } else if (!pin_function(n, value)) {
            add_reason(reasons, "it has no function %u", value);
        }
        if (pin_closed(s, n)) {
            add_reason(reasons, "%s", pin_closed(s, n));
        }
        if (s->taken[n]) {
            add_reason(reasons, "taken from %s",
                       pin_function(n, s->taken[n]));
        }
        if (pin_wired(s, n) && value != s->wanted[n]) {
            add_reason(reasons, "the board wires it to %s", pin_wired(s, n));
        }
        if (twin >= 0) {
            add_reason(reasons, "%s is the same", nuc980_pin_name(twin));
        }
    }
    return g_string_free(reasons, !reasons->len);
}

/* Once for each function of a pin: a guest may switch it to and fro. */
static void pin_warn(NUC980PinsState *s, unsigned n)
{
    const char *function = pin_signal(s, n) ?: "nothing";
    g_autofree char *why = pin_conflict(s, n);

    if (!why) {
        return;
    }
    trace_nuc980_pins_conflict(nuc980_pin_name(n), function, why);
    if (!(s->told[n] & BIT(pin_value(s, n)))) {
        s->told[n] |= BIT(pin_value(s, n));
        warn_report("pin %s is %s: %s", nuc980_pin_name(n), function, why);
    }
}

static bool is_partial(const NUC980PinOwner *owner)
{
    return owner->connected && owner->connected < owner->wired;
}

static void pins_watch(NUC980PinsState *s)
{
    for (int i = 0; i < ARRAY_SIZE(nuc980_pin_owner); i++) {
        s->owner[i].told &= is_partial(&s->owner[i]);
        if (is_partial(&s->owner[i]) && !s->owner[i].told) {
            timer_mod(&s->settled, SETTLE_NS +
                      qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL));
        }
    }
}

/* The wired pins that an owner has not got, as "UART1_RXD (PA0), ..." */
static char *owner_lacks(NUC980PinsState *s, const NUC980PinOwner *owner)
{
    GString *lacks = g_string_new(NULL);

    for (int n = 0; n < NUC980_PIN_COUNT; n++) {
        if (s->owner_of[n] == owner && pin_value(s, n) != s->wanted[n]) {
            g_string_append_printf(lacks, "%s%s (%s)", lacks->len ? ", " : "",
                                   pin_wired(s, n), nuc980_pin_name(n));
        }
    }
    return g_string_free(lacks, false);
}

static void pins_settled(void *opaque)
{
    NUC980PinsState *s = opaque;

    for (int i = 0; i < ARRAY_SIZE(nuc980_pin_owner); i++) {
        NUC980PinOwner *owner = &s->owner[i];

        if (is_partial(owner) && !owner->told) {
            const char *name = nuc980_pin_owner[i].owner;
            g_autofree char *lacks = owner_lacks(s, owner);

            owner->told = true;
            trace_nuc980_pins_partial(name, owner->connected, owner->wired,
                                      lacks);
            warn_report("%s has %u of its %u pins, it lacks %s", name,
                        owner->connected, owner->wired, lacks);
        }
    }
}

/* ---- routing */

static bool is_connected(const NUC980PinLine *line)
{
    return line->wired && line->connected == line->wired;
}

static void pin_connect(NUC980PinsState *s, unsigned n, bool on)
{
    NUC980PinLine *line = s->line_of[n];

    s->owner_of[n]->connected += on ? 1 : -1;
    if (line) {
        bool was = is_connected(line);

        line->connected += on ? 1 : -1;
        if (was != is_connected(line)) {
            trace_nuc980_pins_line(line->prefix, !was);
            qemu_set_irq(*line->out, !was);
        }
    }
}

static void pin_drive(NUC980PinsState *s, unsigned n)
{
    qemu_set_irq(s->peripheral[n], pin_value(s, n) != GPIO_VALUE);
    qemu_set_irq(s->eint[n], is_eint(pin_signal(s, n)));
}

static bool is_taken(unsigned n, unsigned from, unsigned to)
{
    const char *loser = pin_function(n, from);
    const char *winner = pin_function(n, to);

    if (from == GPIO_VALUE || to == GPIO_VALUE || !loser || !winner) {
        return false;
    }
    return !signal_owner(loser) ||
           g_strcmp0(signal_owner(loser), signal_owner(winner));
}

static void pin_switch(NUC980PinsState *s, unsigned n, unsigned from)
{
    unsigned to = pin_value(s, n);

    trace_nuc980_pins_select(nuc980_pin_name(n), to,
                             pin_function(n, to) ?: "nothing");
    s->taken[n] = is_taken(n, from, to) ? from : GPIO_VALUE;
    if (pin_wired(s, n) && (from == s->wanted[n] || to == s->wanted[n])) {
        pin_connect(s, n, to == s->wanted[n]);
    }
    pin_drive(s, n);
    pin_warn(s, n);
}

void nuc980_pins_write(NUC980PinsState *s, unsigned reg, uint32_t value)
{
    uint32_t old;

    g_assert(reg < NUC980_MFP_REGS);
    old = s->mfp[reg];
    s->mfp[reg] = value;
    for (int i = 0; i < 8; i++) {
        if (extract32(old ^ value, 4 * i, 4)) {
            pin_switch(s, 8 * reg + i, extract32(old, 4 * i, 4));
        }
    }
    pins_watch(s);
}

static int pins_post_load(void *opaque, int version_id)
{
    NUC980PinsState *s = opaque;

    for (int n = 0; n < NUC980_PIN_COUNT; n++) {
        if (s->taken[n] && (s->taken[n] >= NUC980_PIN_VALUES ||
                            !pin_function(n, s->taken[n]))) {
            return -EINVAL;
        }
    }
    for (int i = 0; i < s->lines; i++) {
        s->line[i].connected = 0;
    }
    for (int i = 0; i < ARRAY_SIZE(s->owner); i++) {
        s->owner[i].connected = 0;
    }
    /*
     * Every device has saved its own end of a line: driving them one after the
     * other would show edges that never were.
     */
    for (int n = 0; n < NUC980_PIN_COUNT; n++) {
        if (pin_wired(s, n) && pin_value(s, n) == s->wanted[n]) {
            s->owner_of[n]->connected++;
            if (s->line_of[n]) {
                s->line_of[n]->connected++;
            }
        }
    }
    pins_watch(s);
    return 0;
}

static const VMStateDescription vmstate_nuc980_pins = {
    .name = TYPE_NUC980_PINS,
    .version_id = 1,
    .minimum_version_id = 1,
    .post_load = pins_post_load,
    .fields = (VMStateField[]) {
        VMSTATE_UINT32_ARRAY(mfp, NUC980PinsState, NUC980_MFP_REGS),
        VMSTATE_UINT8_ARRAY(taken, NUC980PinsState, NUC980_PIN_COUNT),
        VMSTATE_END_OF_LIST()
    }
};

/* ---- view */

static const char *pin_state(NUC980PinsState *s, unsigned n)
{
    if (pin_value(s, n) == GPIO_VALUE) {
        return pin_wired(s, n) ? "off" : "gpio";
    }
    return pin_wired(s, n) ? "connected" : "not wired";
}

static QDict *view_pin(NUC980PinsState *s, unsigned n)
{
    QDict *pin = qdict_new();
    const char *function = pin_signal(s, n);
    const char *owner = function ? signal_owner(function) : NULL;
    g_autofree char *conflict = pin_conflict(s, n);

    qdict_put_str(pin, "pin", nuc980_pin_name(n));
    qdict_put_int(pin, "value", pin_value(s, n));
    if (function) {
        qdict_put_str(pin, "function", function);
    }
    if (owner) {
        qdict_put_str(pin, "owner", owner);
    }
    if (pin_wired(s, n)) {
        qdict_put_str(pin, "wired-to", pin_wired(s, n));
    }
    qdict_put_str(pin, "state", conflict ? "conflict" : pin_state(s, n));
    if (conflict) {
        qdict_put_str(pin, "conflict", conflict);
    }
    return pin;
}

static QDict *view_device(NUC980PinsState *s, int i)
{
    QDict *device = qdict_new();
    const NUC980PinOwner *owner = &s->owner[i];
    g_autofree char *lacks = owner_lacks(s, owner);

    qdict_put_str(device, "device", nuc980_pin_owner[i].owner);
    qdict_put_int(device, "wired", owner->wired);
    qdict_put_int(device, "connected", owner->connected);
    qdict_put_str(device, "state", is_partial(owner) ? "partial" :
                  owner->connected ? "connected" : "off");
    if (is_partial(owner)) {
        qdict_put_str(device, "lacks", lacks);
    }
    return device;
}

/* Every pin of the chip, and every device that the board wires */
static QDict *pins_view(NUC980PinsState *s)
{
    QDict *view = qdict_new();
    QList *pins = qlist_new();
    QList *devices = qlist_new();

    for (int n = 0; n < NUC980_PIN_COUNT; n++) {
        if (nuc980_pin_exists(n) || pin_value(s, n) != GPIO_VALUE) {
            qlist_append(pins, view_pin(s, n));
        }
    }
    for (int i = 0; i < ARRAY_SIZE(nuc980_pin_owner); i++) {
        if (s->owner[i].wired) {
            qlist_append(devices, view_device(s, i));
        }
    }
    qdict_put(view, "pins", pins);
    qdict_put(view, "devices", devices);
    return view;
}

static void pins_get_view(Object *obj, Visitor *v, const char *name,
                          void *opaque, Error **errp)
{
    QObject *view = QOBJECT(pins_view(NUC980_PINS(obj)));

    visit_type_any(v, name, &view, errp);
    qobject_unref(view);
}

static void print_pin(Monitor *mon, const QDict *pin)
{
    const char *conflict = qdict_get_try_str(pin, "conflict");

    monitor_printf(mon, "%-5s %3" PRId64 "  %-14s %-10s %-14s %s%s%s\n",
                   qdict_get_str(pin, "pin"), qdict_get_int(pin, "value"),
                   qdict_get_try_str(pin, "function") ?: "-",
                   qdict_get_try_str(pin, "owner") ?: "-",
                   qdict_get_try_str(pin, "wired-to") ?: "-",
                   qdict_get_str(pin, "state"), conflict ? ": " : "",
                   conflict ?: "");
}

static void print_device(Monitor *mon, const QDict *device)
{
    const char *lacks = qdict_get_try_str(device, "lacks");

    monitor_printf(mon, "%-7s %2" PRId64 " of %2" PRId64 "  %s%s%s\n",
                   qdict_get_str(device, "device"),
                   qdict_get_int(device, "connected"),
                   qdict_get_int(device, "wired"),
                   qdict_get_str(device, "state"), lacks ? ", lacks " : "",
                   lacks ?: "");
}

/* info nuc980-pins: without -a only pins that are wired or in use */
static void hmp_info_nuc980_pins(Monitor *mon, const QDict *args)
{
    Object *obj = object_resolve_path_type("", TYPE_NUC980_PINS, NULL);
    g_autoptr(QDict) view = NULL;
    const QListEntry *entry;

    if (!obj) {
        monitor_printf(mon, "This machine has no NUC980.\n");
        return;
    }
    view = pins_view(NUC980_PINS(obj));
    monitor_printf(mon, "pin   MFP  function       owner      wired to       "
                   "state\n");
    QLIST_FOREACH_ENTRY(qdict_get_qlist(view, "pins"), entry) {
        const QDict *pin = qobject_to(QDict, qlist_entry_obj(entry));

        if (qdict_get_try_bool(args, "all", false) ||
            strcmp(qdict_get_str(pin, "state"), "gpio")) {
            print_pin(mon, pin);
        }
    }
    monitor_printf(mon, "\ndevice  pins      state\n");
    QLIST_FOREACH_ENTRY(qdict_get_qlist(view, "devices"), entry) {
        print_device(mon, qobject_to(QDict, qlist_entry_obj(entry)));
    }
}

/* ---- device */

static void G_GNUC_PRINTF(3, 4) add_line(NUC980PinsState *s, qemu_irq *out,
                                         const char *prefix, ...)
{
    NUC980PinLine *line = &s->line[s->lines++];
    va_list args;

    va_start(args, prefix);
    vsnprintf(line->prefix, sizeof(line->prefix), prefix, args);
    va_end(args);
    line->out = out;
}

/* A signal belongs to the first line that it begins like. */
static void add_lines(NUC980PinsState *s)
{
    for (int i = 0; i < NUC980_UARTS; i++) {
        add_line(s, &s->uart_rxd[i], "UART%d_RXD", i);
        add_line(s, &s->uart_txd[i], "UART%d_TXD", i);
        add_line(s, &s->uart_rts[i], "UART%d_RTS", i);
        add_line(s, &s->uart_cts[i], "UART%d_CTS", i);
    }
    for (int i = 0; i < NUC980_EMACS; i++) {
        add_line(s, &s->emac_mdio[i], "RMII%d_MD", i);      /* MDC, MDIO */
        add_line(s, &s->emac_rmii[i], "RMII%d_", i);
    }
    add_line(s, &s->nand, "NAND_");
    g_assert(s->lines == NUC980_PIN_LINES);
}

static NUC980PinLine *find_line(NUC980PinsState *s, const char *signal)
{
    for (int i = 0; i < s->lines; i++) {
        if (g_str_has_prefix(signal, s->line[i].prefix)) {
            return &s->line[i];
        }
    }
    return NULL;
}

static uint8_t find_value(unsigned n, const char *signal)
{
    unsigned value = 0;

    while (g_strcmp0(pin_function(n, value), signal)) {
        value++;
        g_assert(value < NUC980_PIN_VALUES);    /* as above */
    }
    return value;
}

static void wire_pin(NUC980PinsState *s, unsigned n, const char *signal)
{
    int prefix = signal_prefix(signal);

    g_assert(prefix >= 0);                      /* the generator checks it */
    s->wanted[n] = find_value(n, signal);
    s->owner_of[n] = &s->owner[prefix];
    s->owner_of[n]->wired++;
    s->line_of[n] = find_line(s, signal);
    if (s->line_of[n]) {
        s->line_of[n]->wired++;
    }
}

static void pins_realize(DeviceState *dev, Error **errp)
{
    NUC980PinsState *s = NUC980_PINS(dev);

    if (!nuc980_board_name(s->board)) {
        error_setg(errp, "there is no board number %" PRIu32, s->board);
        return;
    }
    add_lines(s);
    for (int n = 0; n < NUC980_PIN_COUNT; n++) {
        if (pin_wired(s, n)) {
            wire_pin(s, n, pin_wired(s, n));
        }
    }
}

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
    qdev_init_gpio_out_named(dev, s->peripheral, "peripheral",
                             NUC980_PIN_COUNT);
    qdev_init_gpio_out_named(dev, s->eint, "eint", NUC980_PIN_COUNT);
    timer_init_ns(&s->settled, QEMU_CLOCK_VIRTUAL, pins_settled, s);
}

static void pins_finalize(Object *obj)
{
    timer_del(&NUC980_PINS(obj)->settled);
}

static Property pins_properties[] = {
    DEFINE_PROP_UINT32("board", NUC980PinsState, board, 0),
    DEFINE_PROP_END_OF_LIST()
};

static void pins_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->desc = "NUC980 pins";
    dc->realize = pins_realize;
    dc->vmsd = &vmstate_nuc980_pins;
    device_class_set_props(dc, pins_properties);
    /* Reason: is wired by the chip, and the board's wiring is in its table */
    dc->user_creatable = false;
    object_class_property_add(klass, "view", "any", pins_get_view, NULL, NULL,
                              NULL);
    object_class_property_set_description(klass, "view",
        "Function, owner and wiring of each pin; pins of each device");
}

static const TypeInfo pins_info = {
    .name = TYPE_NUC980_PINS,
    .parent = TYPE_DEVICE,
    .instance_size = sizeof(NUC980PinsState),
    .instance_init = pins_init,
    .instance_finalize = pins_finalize,
    .class_init = pins_class_init,
};

static void pins_register(void)
{
    type_register_static(&pins_info);
    monitor_register_hmp("nuc980-pins", true, hmp_info_nuc980_pins);
}

type_init(pins_register)
