# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on the pins of a device together: whether it can work with them."""

from __future__ import annotations

from collections.abc import Iterator

from nuc980.pins.chip import GPIO, Chip, SignalSet
from nuc980.pins.claims import Claim
from nuc980.pins.findings import Finding, at
from nuc980.pins.rules.context import (
    Context,
    cells_of,
    claimants,
    grouped,
    in_order,
    listed,
    places_of_signal,
    ranged,
    rule,
)
from nuc980.pins.tree import Node

# A UART's: whoever writes one of them says that RTS does something.
USES_RTS = (
    "linux,rs485-enabled-at-boot-time",
    "rs485-rts-active-high",
    "rs485-rts-active-low",
    "rs485-rts-delay",
    "uart-has-rtscts",
)
TRIGGERS = 5  # gpio-nuc980.c, trigger_type


@rule(
    "no-pins",
    "A device that needs pins is enabled without any.",
    "The device probes and seems to be there, but nothing goes in or out: U-Boot sets every pin to GPIO "
    "before Linux starts.",
)
def no_pins(context: Context) -> Iterator[Finding]:
    # The pins of a camera interface are in the group of the camera.
    lent = {claim.signal for claim in context.claims if claim.muxed and claim.node not in context.peripherals}
    for node, peripheral in context.devices.items():
        own = [claim for claim in context.working_claims(node) if claim.signal != GPIO]
        if not peripheral.needs_pins or own or not context.is_readable(node):
            continue
        if any(peripheral.owns(signal) for signal in lent if signal):
            continue
        yield Finding(
            "no-pins",
            **at(node, "pinctrl-0"),
            message=f"{peripheral.label} is enabled but has no pins",
            remedy=f'Set pinctrl-names = "default" and pinctrl-0 in {peripheral.label} to a group with its '
            f'pins ({", ".join(peripheral.signals)}…), or status = "disabled"',
        )


def _used_sets(context: Context) -> Iterator[tuple[Node, str, SignalSet, list[str]]]:
    """Device, prefix of its signals, what they must be, what they are; only of groups that can be read."""
    for node, peripheral in context.devices.items():
        if not context.is_readable(node):
            continue
        signals = [claim.signal for claim in context.working_claims(node) if claim.signal]
        for prefix, needed in peripheral.signals.items():
            used = [signal.removeprefix(prefix) for signal in signals if signal.startswith(prefix)]
            if used:
                yield node, prefix, needed, used


@rule(
    "incomplete-set",
    "A device lacks a signal that it needs.",
    "Such as a UART without TXD, or an Ethernet port without its clock. The driver cannot notice.",
)
def incomplete_set(context: Context) -> Iterator[Finding]:
    for node, prefix, needed, used in _used_sets(context):
        missing = [f"{prefix}{signal}" for signal in needed.required if signal not in used]
        choice = [
            f"{prefix}{signal}" for signal in needed.some if f"{prefix}{signal}" in context.chip.signals
        ]
        # A controller of serial buses can select its devices by GPIO lines as well.
        lacks_choice = (
            bool(needed.some) and not {*needed.some} & {*used} and "cs-gpios" not in node.properties
        )
        if not missing and not lacks_choice:
            continue
        what = missing + ([f"one of {', '.join(choice)}"] if lacks_choice else [])
        where = "; ".join(
            f"{signal} is on {places_of_signal(context.chip, signal)}"
            for signal in missing + choice * lacks_choice
        )
        yield Finding(
            "incomplete-set",
            **at(node, "pinctrl-0"),
            message=f"{context.name(node)} has no pin for {listed(what)}",
            remedy=f"Add {listed(what)} to its group: {where}",
            claimants=claimants(context.working_claims(node)),
        )


@rule(
    "half-set",
    "A device has only some of the signals that work together: RTS without CTS, or two data lines of four.",
    "With flow control, a UART without CTS waits for ever, and one without RTS loses bytes. An SD card uses "
    "one data line or four.",
)
def half_set(context: Context) -> Iterator[Finding]:
    for node, prefix, needed, used in _used_sets(context):
        for together in needed.together:
            has = [f"{prefix}{signal}" for signal in together if signal in used]
            lacks = [f"{prefix}{signal}" for signal in together if signal not in used]
            if not has or not lacks or _turns_a_driver_round(node, has):
                continue
            extra = [claim for claim in context.working_claims(node) if claim.signal in has]
            where = "; ".join(f"{signal} is on {places_of_signal(context.chip, signal)}" for signal in lacks)
            yield Finding(
                "half-set",
                **at(node, "pinctrl-0"),
                message=f"{context.name(node)} has {listed(has)} without {listed(lacks)}",
                remedy=f"Take {listed(has)} out of the group {extra[0].group.name}, or add "
                f"{listed(lacks)}: {where}{_rs485_hint(has)}",
                claimants=claimants(extra),
                pins=in_order(claim.pin for claim in extra),
            )


def _turns_a_driver_round(node: Node, has: list[str]) -> bool:
    """Whether RTS is the direction of an RS-485 driver, which has no CTS (the kernel's rs485.yaml)."""
    for_rs485 = any(name.startswith(("rs485-", "linux,rs485-")) for name in node.properties)
    return for_rs485 and _is_rts(has)


def _rs485_hint(has: list[str]) -> str:
    hint = "; if it drives an RS-485 transceiver, add rs485-rts-active-high or rs485-rts-active-low"
    return hint if _is_rts(has) else ""


def _is_rts(has: list[str]) -> bool:
    return all(signal.endswith("_RTS") for signal in has)


@rule(
    "no-rts",
    "A UART is set to use RTS, for RS-485 or for flow control, but has no pin for it.",
    "RTS changes inside the chip only. The RS-485 transceiver never changes its direction, so nothing is "
    "sent, or nothing is received. With flow control and no CTS, the port waits for ever.",
)
def no_rts(context: Context) -> Iterator[Finding]:
    for node, prefix, needed, used in _used_sets(context):
        told = next((name for name in node.properties if name in USES_RTS), None)
        wanted = ["RTS", "CTS"] if told == "uart-has-rtscts" else ["RTS"]
        lacks = [f"{prefix}{signal}" for signal in wanted if signal not in used]
        if told is None or "TXD" not in needed.required or not lacks or "rts-gpios" in node.properties:
            continue
        yield Finding(
            "no-rts",
            **at(node, told),
            message=f"{context.name(node)} has {told} but no pin for {listed(lacks)}",
            remedy=_get_rts(context.chip, lacks, told),
            claimants=claimants(context.working_claims(node)),
        )


def _get_rts(chip: Chip, lacks: list[str], told: str) -> str:
    if nowhere := [signal for signal in lacks if signal not in chip.signals]:
        return f"Delete {told}: this chip has no {listed(nowhere)}"
    where = "; ".join(f"{signal} is on {places_of_signal(chip, signal)}" for signal in lacks)
    return (
        f"Add {listed(lacks)} to its group ({where}), or delete {told}: a transceiver that "
        "switches its direction itself needs none"
    )


@rule(
    "eint",
    "The setting of an external interrupt does not match the pins.",
    "eintN-config switches an interrupt on; the pin group of the GPIO controller switches the pin. The "
    "driver does not compare the two, and takes the last pin for a number that it does not know.",
)
def eint(context: Context) -> Iterator[Finding]:
    for node, peripheral in context.devices.items():
        if peripheral.label != "gpio":
            continue
        for name, pins in context.chip.eint.items():
            yield from _eint(context, node, name, pins)
        yield from _eint_not_reached(node, [f"{name}-config" for name in context.chip.eint])


def _eint_not_reached(node: Node, settings: list[str]) -> Iterator[Finding]:
    """The driver reads the settings in their order, and stops at the first that is missing."""
    on = [number for number, name in enumerate(settings) if node.cells(name)[:1] == [1]]
    missing = [name for name in settings[: max(on, default=0)] if name not in node.properties]
    if missing:
        yield Finding(
            "eint",
            **at(node, settings[max(on)]),
            message=f"{settings[max(on)]} is never read, because {missing[0]} before it is missing",
            remedy=f"Set {missing[0]} = <0 0 0> in the GPIO controller",
        )


def _eint(context: Context, node: Node, name: str, pins: tuple[str, ...]) -> Iterator[Finding]:
    setting = f"{name}-config"
    muxed = [claim for claim in context.claims if claim.muxed and claim.signal == name.upper()]
    cells = node.cells(setting)
    if setting in node.properties and len(cells) != 3:
        yield Finding(
            "eint",
            **at(node, setting),
            message=f"{setting} has {len(cells)} cells",
            remedy=f"Write {setting} as three cells: 1 for on, the number of the pin "
            f"({_numbered(pins)}), the trigger (0 to {TRIGGERS - 1})",
        )
        return
    enabled, index, trigger = cells or (0, len(pins), 0)
    if enabled == 1 and trigger >= TRIGGERS:
        yield Finding(
            "eint",
            **at(node, setting),
            message=f"{setting} has trigger {trigger}, beyond the end of the driver's list",
            remedy=f"Set the third cell of {setting} to 0 (both edges), 1 (rising), 2 (falling), 3 (high) "
            "or 4 (low)",
        )
    chosen = pins[index] if index < len(pins) else None
    if enabled == 1 and chosen is None:
        yield Finding(
            "eint",
            **at(node, setting),
            message=f"{setting} names pin {index}; the driver knows {_numbered(pins)}, and takes {pins[-1]}",
            remedy=f"Set the second cell of {setting} to the number of its pin",
        )
    elif enabled == 1 and chosen not in {claim.pin for claim in muxed}:
        yield Finding(
            "eint",
            **at(node, setting),
            message=f"{setting} switches on the interrupt of {chosen}, but no group makes it {name.upper()}",
            remedy=f"Add {cells_of(chosen, context.chip.value(chosen, name.upper()))} to the group of the "
            f"GPIO controller, or set the first cell of {setting} to 0",
            claimants=claimants(muxed),
            pins=(chosen,),
        )
    else:
        yield from _idle_eint(context, setting, pins, [claim for claim in muxed if claim.pin != chosen])


def _idle_eint(context: Context, setting: str, pins: tuple[str, ...], idle: list[Claim]) -> Iterator[Finding]:
    """
    Pins that are switched for an interrupt of another pin. One that is chosen and off is no mistake: the
    vendor's default has PG15 ready for the board that switches it on.
    """
    for user, claims in grouped(idle, lambda claim: claim.node).items():
        taken = in_order(claim.pin for claim in claims)
        yield Finding(
            "eint",
            **at(user, claims[0].property),
            message=f"{context.name(user)} makes {ranged(taken)} {claims[0].signal}, "
            f"but {setting} does not name {ranged(taken)}",
            remedy=f"Take {ranged(taken)} out of the group {claims[0].group.name}, or set {setting} to "
            f"<1 {pins.index(taken[0])} TRIGGER>",
            claimants=claimants(claims),
            pins=taken,
        )


def _numbered(pins: tuple[str, ...]) -> str:
    return ", ".join(f"{index} {pin}" for index, pin in enumerate(pins))


def _pwms(context: Context) -> Iterator[tuple[Node, Node, int]]:
    """Who uses a channel, its controller, its number."""
    for node in context.enabled:
        cells = list(node.cells("pwms"))
        while len(cells) > 1:
            controller = context.tree.by_phandle.get(cells.pop(0))
            if controller is None or controller not in context.devices:
                break
            yield node, controller, cells[0]
            del cells[: next(iter(controller.cells("#pwm-cells")), 0)]


@rule(
    "pwm-without-pin",
    "A node uses a PWM channel that has no pin, or that does not exist.",
    "The channel runs inside the chip. The lamp stays dark, the fan stands still, and nothing is reported.",
)
def pwm_without_pin(context: Context) -> Iterator[Finding]:
    for node, controller, channel in _pwms(context):
        for prefix, needed in context.devices[controller].signals.items():
            has = [claim.signal for claim in context.working_claims(controller)]
            signal = f"{prefix}{channel}"
            if signal in has or not context.is_readable(controller):
                continue
            exists = str(channel) in needed.some
            yield Finding(
                "pwm-without-pin",
                **at(node, "pwms"),
                message=f"{context.name(node)} uses channel {channel} of {context.name(controller)}, which "
                + ("has no pin" if exists else f"has the channels {', '.join(needed.some)}"),
                remedy=f"Add {signal} to the group of {context.name(controller)}: "
                f"{places_of_signal(context.chip, signal)}"
                if exists
                else f"Use one of the channels of {context.name(controller)}",
            )


RULES = (no_pins, incomplete_set, half_set, no_rts, pwm_without_pin, eint)
