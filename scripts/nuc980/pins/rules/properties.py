# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on any node's properties: names that are nearly right, and references to nodes of another kind."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml

from nuc980.pins.chip import Chip, YamlLoader
from nuc980.pins.findings import Finding, at, renamed, valued
from nuc980.pins.rules.context import Context, off, rule
from nuc980.pins.tree import Node

KNOWN_FILE = Path(__file__).parents[1] / "properties.yml"
SHORTEST = 5  # letters: of shorter ones too many are one letter away
CUT_LEAST = 9
NUMBERED = re.compile(r"pinctrl-\d+|eint\d-config")
ENDINGS = ("gpios", "gpio", "supply")  # alone, or behind what a driver calls the line


@rule(
    "unknown-property",
    "The name of a property differs by one letter from a known one, or is the beginning of one.",
    "Nothing reads it, and nothing reports it. With pinctl-0 a port keeps the pins that U-Boot set; with "
    "read-onyl Linux may erase the boot loader.",
)
def unknown_property(context: Context) -> Iterator[Finding]:
    known = known_properties(context.chip)
    for node in context.enabled:
        for name in node.properties:
            meant = _meant(name, known)
            if meant:
                yield Finding(
                    "unknown-property",
                    **at(node, name),
                    message=f"{context.name(node)} has {name}, which nothing reads; it probably "
                    f"means {' or '.join(meant)}",
                    remedy=f"Write {' or '.join(meant)}, or delete {name}",
                    fix=renamed(name, meant[0]) if len(meant) == 1 else None,
                )


@functools.cache
def _general() -> frozenset[str]:
    subjects = yaml.load(KNOWN_FILE.read_text(encoding="utf-8"), Loader=YamlLoader)
    return frozenset(name for names in subjects.values() for name in names.split())


def known_properties(chip: Chip) -> frozenset[str]:
    """All that somebody reads, as far as it is known."""
    return _general().union(*(peripheral.properties for peripheral in chip.peripherals.values()))


def _meant(name: str, known: frozenset[str]) -> list[str]:
    """The properties that a name is one letter off; none for one that is known, or like none."""
    if name in known or NUMBERED.fullmatch(name) or name.endswith(ENDINGS):
        return []
    first, dash, last = name.rpartition("-")
    for ending in ENDINGS if dash else ():
        if last.isalpha() and is_one_off(last, ending):
            return [f"{first}-{ending}"]
    words = [word for word in (*sorted(known), "pinctrl-0", "pinctrl-1") if len(word) >= SHORTEST]
    return [word for word in words if is_one_off(name, word)] or [
        word for word in words if _is_cut(name, word)
    ]


def _is_cut(written: str, meant: str) -> bool:
    """As spi-max-freq is spi-max-frequency."""
    return len(written) >= CUT_LEAST and "-" in written and meant.startswith(written) and meant != written


def is_one_off(written: str, meant: str) -> bool:
    """Whether one letter too many, too few, another, or two that changed places is all between two words."""
    if written == meant or abs(len(written) - len(meant)) > 1:
        return False
    start = next(
        (i for i, (a, b) in enumerate(zip(written, meant, strict=False)) if a != b),
        min(len(written), len(meant)),
    )
    here, there = written[start:], meant[start:]
    return (
        here[1:] == there[1:]
        or here[1:] == there
        or here == there[1:]
        or (here[:2] == there[:2][::-1] and here[2:] == there[2:])
    )


# Property: what tells how many cells stand behind a reference.
REFERENCES = {
    "clocks": "#clock-cells",
    "assigned-clocks": "#clock-cells",
    "dmas": "#dma-cells",
    "resets": "#reset-cells",
    "pwms": "#pwm-cells",
    "phys": "#phy-cells",
    "io-channels": "#io-channel-cells",
}


@rule(
    "wrong-reference",
    "A node takes a clock, DMA channel, reset, PWM, PHY or converter from a node that has none, or that is "
    "disabled.",
    "The driver that asks for it fails (-EINVAL), or waits for ever (-EPROBE_DEFER), and the device is "
    "missing. The chip's own devices get their clocks without the tree, and still work.",
)
def wrong_reference(context: Context) -> Iterator[Finding]:
    for node in context.enabled:
        for name, cells in REFERENCES.items():
            fault = _reference_fault(context, node, name, cells) if name in node.properties else None
            if fault:
                yield Finding(
                    "wrong-reference",
                    **at(node, name),
                    message=f"{name} of {context.name(node)} refers to {fault}",
                    remedy=f"Make {name} of {context.name(node)} refer to an enabled node with {cells}, or "
                    "delete it",
                )


def _reference_fault(context: Context, node: Node, name: str, size: str) -> str | None:
    """What is wrong with the first reference of a list that is not right; None: nothing."""
    cells = list(node.cells(name))
    while cells:
        phandle = cells.pop(0)
        if phandle == 0:  # an optional one that is not there
            continue
        target = context.tree.by_phandle.get(phandle)
        if target is None:
            return "a node that does not exist"
        if size not in target.properties:
            return f"{context.name(target)}, which has no {size}"
        if not target.enabled:
            return f"{context.name(target)}, which {off(target)}"
        del cells[: next(iter(target.cells(size)), 0)]
    return None


@dataclass(frozen=True)
class Unit:
    """What a property's value is in, and of what it is taken for if it is this small."""

    name: str
    least: int
    mistaken: str


UNITS = {
    "bus_freq": Unit("Hz", 5_000, "kHz"),
    "spi-max-frequency": Unit("Hz", 5_000, "kHz"),
    "regulator-min-microvolt": Unit("microvolts", 50_000, "millivolts"),
    "regulator-max-microvolt": Unit("microvolts", 50_000, "millivolts"),
}


@rule(
    "wrong-unit",
    "A value is so small that it was probably written in another unit.",
    "Nothing compares it with what the device can do: a bus is a thousand times too slow, and a supply is "
    "told as a thousandth of what it is.",
)
def wrong_unit(context: Context) -> Iterator[Finding]:
    for node in context.enabled:
        for name, unit in UNITS.items():
            for value in node.cells(name)[:1]:
                if 0 < value < unit.least:
                    yield Finding(
                        "wrong-unit",
                        **at(node, name),
                        message=f"{name} of {context.name(node)} is {value} {unit.name}; it was probably "
                        f"written in {unit.mistaken}",
                        remedy=f"Write {name} in {unit.name}: <{1000 * value}>",
                        fix=valued(name, f"<{1000 * value}>"),
                    )


RULES = (unknown_property, wrong_reference, wrong_unit)
