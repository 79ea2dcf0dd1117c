# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on device nodes against the chip: status, drivers, numbers, and what several devices share."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Iterator, Sequence

from nuc980.pins.chip import Peripheral
from nuc980.pins.findings import Claimant, Finding, Fix, added, at, valued
from nuc980.pins.rules.context import Context, grouped, listed, rule
from nuc980.pins.rules.identity import NUMBERS, has_driver_name
from nuc980.pins.rules.properties import is_one_off
from nuc980.pins.tree import Node

DIRECTIONS = ("input", "output-low", "output-high")
STATUS_WORDS = dict.fromkeys(
    ("enabled", "enable", "okay", "ok", "on", "true", "yes"), "okay"
) | dict.fromkeys(("disable", "disabled", "off", "false", "no"), "disabled")
STATUS = re.compile(r"okay|ok|disabled|reserved|fail(-.*)?")
# Compatible string: what the driver gives up without, or, port-number of a smart card and bus_freq of an
# I2C bus, what it goes on without: with an index that nobody set, and a division by zero.
NEEDED = {
    "nuvoton,nuc980-uart": ("port-number", "map-addr", "pdma-enable"),
    "nuvoton,nuc980-scuart": ("port-number",),
    "nuvoton,nuc980-sc": ("port-number",),
    "nuvoton,nuc980-timer": ("port-number",),
    "nuvoton,nuc980-ehci": ("ov_active",),
    **{f"nuvoton,nuc980-i2c{number}": ("bus_freq",) for number in range(4)},
}


# Compatible string: of what each child needs one.
PARTS = {
    "gpio-leds": (("gpios", "gpio"),),
    "gpio-keys": (("linux,code",), ("gpios", "gpio", "interrupts", "interrupts-extended")),
}


# Compatible string: of which properties the node itself needs one each.
WHOLES = {
    "i2c-gpio": (("sda-gpios", "gpios"), ("scl-gpios", "gpios")),
    "spi-gpio": (("sck-gpios", "gpio-sck"),),
    "gpio-keys-polled": (("poll-interval",),),
    "fixed-clock": (("clock-frequency",),),
    "regulator-fixed": (("regulator-name",),),
    "regulator-gpio": (("gpios",), ("states",)),
    **dict.fromkeys(
        ("w1-gpio", "gpio-poweroff", "gpio-restart", "pps-gpio", "rotary-encoder"), (("gpios",),)
    ),
    "iio-hwmon": (("io-channels",),),
    "fixed-partitions": (("#address-cells",), ("#size-cells",)),
}


GENERIC = frozenset(WHOLES) | {
    *PARTS,
    *(
        "pwm-leds",
        "simple-bus",
        "simple-mfd",
        "syscon",
        "gpio-fan",
        "gpio-mux",
        "gpio-matrix-keypad",
        "mdio-gpio",
    ),
    *("jedec,spi-nor", "spi-nand", "ramoops", "shared-dma-pool", "usb-nop-xceiv", "fixed-factor-clock"),
}


@rule(
    "unknown-status",
    "The specification does not define the status of a node.",
    'The kernel treats every status but "okay" and "ok" as disabled. With "enabled" or "Okay" the device is '
    "missing, and nothing is logged.",
)
def unknown_status(context: Context) -> Iterator[Finding]:
    for node in context.tree.root.walk():
        values = node.strings("status")
        if "status" not in node.properties or (len(values) == 1 and STATUS.fullmatch(values[0])):
            continue
        shown = ", ".join(f'"{value}"' for value in values) or "no string"
        yield Finding(
            "unknown-status",
            **at(node, "status"),
            message=f"status of {context.name(node)} is {shown}",
            remedy='Write "okay" or "disabled"',
            fix=_status(values),
        )


def _status(values: list[str]) -> Fix | None:
    """What somebody meant who wrote a status as in other languages."""
    meant = STATUS_WORDS.get(values[0].strip().casefold()) if len(values) == 1 else None
    return valued("status", f'"{meant}"') if meant else None


@rule(
    "wrong-number",
    "The number that tells a driver which device it has belongs to another device.",
    "port-number selects the clock and the port of a UART, map-addr its registers, id the channels of a "
    "PWM. With another device's number, the driver works on the wrong block, and the second port with a "
    "number overwrites the first.",
)
def wrong_number(context: Context) -> Iterator[Finding]:
    for node, peripheral in context.devices.items():
        for name in NUMBERS:
            own = peripheral.properties.get(name)
            if own is None or node.cells(name)[:1] in ([], [own]):  # none: missing-property
                continue
            told = " ".join(map(_number, node.cells(name)))
            yield Finding(
                "wrong-number",
                **at(node, name),
                message=f"{peripheral.label} has {name} = <{told}>; it must be {_number(own)}",
                remedy=f"Set {name} = <{_number(own)}> in {peripheral.label}",
                fix=valued(name, f"<{_number(own)}>"),
            )


@rule(
    "wrong-compatible",
    "No driver matches the compatible string of a device.",
    "The device is in the tree, but never in the system, and nothing is logged.",
)
def wrong_compatible(context: Context) -> Iterator[Finding]:
    yield from _generic(context)
    for node, peripheral in context.peripherals.items():
        if not has_driver_name(node, peripheral):
            yield Finding(
                "wrong-compatible",
                **at(node, "compatible"),
                message=f"{node.path} has the address of {peripheral.label}, but its compatible is "
                f"{', '.join(map(repr, node.strings('compatible'))) or 'empty'}",
                remedy=f"Set compatible = {_quoted(peripheral.compatible)} in {node.path}",
            )
        elif not peripheral.has_driver and node in context.devices:
            yield Finding(
                "wrong-compatible",
                **at(node, "compatible"),
                message=f"{peripheral.label} is enabled, but no kernel of the vendor has a driver for "
                f"{peripheral.compatible[0]}",
                remedy=f'Set status = "disabled" in {peripheral.label}, or delete the node',
            )


@functools.cache
def _near_generic(written: str) -> tuple[str, ...]:
    return tuple(sorted(name for name in GENERIC if is_one_off(written, name)))


def _generic(context: Context) -> Iterator[Finding]:
    """Of nodes that are no blocks of the chip: what is one letter off what the kernel knows."""
    for node in context.enabled:
        strings = node.strings("compatible")
        nearest = [(has, name) for has in strings for name in _near_generic(has)]
        if node not in context.peripherals and nearest and not GENERIC.intersection(strings):
            has, name = nearest[0]
            yield Finding(
                "wrong-compatible",
                **at(node, "compatible"),
                message=f"{node.path} is {has!r}; it probably means {name!r}",
                remedy=f'Set compatible = "{name}" in {node.path}',
                fix=valued("compatible", f'"{name}"') if len(strings) == 1 else None,
            )


def _quoted(strings: tuple[str, ...]) -> str:
    return ", ".join(f'"{string}"' for string in strings)


@rule(
    "bus-num-twice",
    "Two enabled controllers of the same kind have the same bus_num.",
    "The kernel does not register the second bus, so its devices are missing. The vendor's 6.6 tree gives 0 "
    "to all three SPI controllers.",
)
def bus_num_twice(context: Context) -> Iterator[Finding]:
    numbered = [
        (node, peripheral.label.rstrip("0123").removeprefix("q"), (node.cells("bus_num") or [0])[0])
        for node, peripheral in context.devices.items()
        if "bus_num" in peripheral.properties  # the drivers take 0 where the node has none
    ]
    for (kind, number), same in grouped(numbered, lambda entry: entry[1:]).items():
        nodes = [node for node, _, _ in same]
        if len(nodes) < 2:
            continue
        yield Finding(
            "bus-num-twice",
            **at(nodes[-1], "bus_num"),
            message=f"{listed(context.name(node) for node in nodes)} are {kind} bus {number}",
            remedy=f"Give {listed(context.name(node) for node in nodes[1:])} a bus_num that no other "
            f"{kind} bus has",
            claimants=tuple(
                Claimant(node.path, f"{kind} bus {number}", node.place_of("bus_num")) for node in nodes
            ),
        )


@rule(
    "pdma-without-dma",
    "A UART is set to use PDMA, but the PDMA controller is disabled.",
    "Opening the port fails: the driver asks for a channel, and there is none.",
)
def pdma_without_dma(context: Context) -> Iterator[Finding]:
    if any(peripheral.label == "dma" for peripheral in context.devices.values()):
        return
    for node, peripheral in context.devices.items():
        # The driver has no PDMA for uart0, whatever is set.
        if peripheral.label != "uart0" and _is_uart(peripheral) and node.cells("pdma-enable") == [1]:
            yield Finding(
                "pdma-without-dma",
                **at(node, "pdma-enable"),
                message=f"{peripheral.label} has pdma-enable = <1>, but no PDMA controller is enabled",
                remedy=f'Set pdma-enable = <0> in {peripheral.label}, or status = "okay" in '
                f"{context.chip.peripherals['dma'].path}",
            )


def _is_uart(peripheral: Peripheral) -> bool:
    return peripheral.compatible[0] == "nuvoton,nuc980-uart"


@rule(
    "missing-property",
    "A device lacks a property that its driver needs.",
    "A UART without port-number, map-addr or pdma-enable does not probe; the driver reports a missing "
    "pdma-enable as a missing map-addr. Without bus_freq the I2C driver divides by zero. An I2C or SPI bus "
    "without #address-cells gives its devices no address that dtc checks. With one lamp without a line, or "
    "one key without a code, the driver gives up all of them.",
)
def missing_property(context: Context) -> Iterator[Finding]:
    yield from _parts_and_wholes(context)
    for node, peripheral in context.devices.items():
        needed = {
            name: value
            for name, value in peripheral.properties.items()
            if name in NEEDED.get(peripheral.compatible[0], ())
        }
        if "bus_num" in peripheral.properties and any("reg" in child.properties for child in node):
            needed |= {"#address-cells": 1, "#size-cells": 0}
        lacks = [name for name in needed if not node.cells(name)]
        if lacks:
            yield Finding(
                "missing-property",
                **at(node),
                message=f"{peripheral.label} has no {listed(lacks)}",
                remedy=f"Set {listed(f'{name} = <{_number(needed[name])}>' for name in lacks)} in "
                f"{peripheral.label}",
                fix=None
                if node.properties.keys() & set(lacks)
                else added(" ".join(f"{name} = <{_number(needed[name])}>;" for name in lacks), node),
            )


def _parts_and_wholes(context: Context) -> Iterator[Finding]:
    """Lamps and keys are children of one node: with one that lacks something none of them is there."""
    for node in context.enabled:
        for kind in node.strings("compatible"):
            yield from _lacking([node], WHOLES.get(kind, ()))
            yield from _lacking(node, PARTS.get(kind, ()))


def _lacking(nodes: Iterable[Node], needed: Sequence[Sequence[str]]) -> Iterator[Finding]:
    for node in nodes:
        lacks = [names for names in needed if not set(names) & node.properties.keys()]
        if node.enabled and lacks:
            yield Finding(
                "missing-property",
                **at(node),
                message=f"{node.path} has no {listed(' or '.join(names) for names in lacks)}",
                remedy=f"Set {listed(names[0] for names in lacks)} in {node.path}",
            )


def _number(value: int) -> str:
    return f"{value:#x}" if value > 9 else str(value)


@rule(
    "hog-without-direction",
    "A GPIO line that the kernel shall hold has no direction.",
    "The kernel leaves it as it is, and says so in the log alone: an output that switches something on stays "
    "an input.",
)
def hog_without_direction(context: Context) -> Iterator[Finding]:
    for node in context.enabled:
        if "gpio-hog" in node.properties and not any(name in node.properties for name in DIRECTIONS):
            yield Finding(
                "hog-without-direction",
                **at(node, "gpio-hog"),
                message=f"{context.name(node)} has none of {', '.join(DIRECTIONS)}",
                remedy=f"Add one of {', '.join(DIRECTIONS)} to {context.name(node)}",
            )


RULES = (
    unknown_status,
    wrong_number,
    wrong_compatible,
    bus_num_twice,
    pdma_without_dma,
    missing_property,
    hog_without_direction,
)
