# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on any node's properties: names that are nearly right, and references to nodes of another kind."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from nuc980.pins.chip import Chip, YamlLoader
from nuc980.pins.findings import Finding, Fix, at, renamed, valued
from nuc980.pins.rules.context import Context, off, rule
from nuc980.pins.tree import Node

KNOWN_FILE = Path(__file__).parents[1] / "properties.yml"
SHORTEST = 5  # letters: of shorter ones too many are one letter away
SHORTEST_WORD = 4
LONG_WORD = 6  # letters: of these two may be wrong
CUT_LEAST = 9
SEPARATORS = re.compile("[-,_]")
NUMBERED = re.compile(r"pinctrl-\d+|eint\d-config")
ENDINGS = ("gpios", "gpio", "supply")  # alone, or behind what a driver calls the line


@rule(
    "unknown-property",
    "The name of a property is nearly that of a known one, or the beginning of one.",
    "Nothing reads it, and nothing reports it. With pinctl-0 a port keeps the pins that U-Boot set; with "
    "read-onyl Linux may erase the boot loader.",
)
def unknown_property(context: Context) -> Iterator[Finding]:
    known = known_properties(context.chip)
    for node in context.enabled:
        for name in node.properties:
            if nearest := meant(name, known):
                yield Finding(
                    "unknown-property",
                    **at(node, name),
                    message=f"{context.name(node)} has {name}, which nothing reads; it probably "
                    f"means {' or '.join(nearest)}",
                    remedy=f"Write {' or '.join(nearest)}, or delete {name}",
                    fix=_only_answer(node, name, nearest),
                )


def _only_answer(node: Node, name: str, nearest: Sequence[str]) -> Fix | None:
    """Of two values of a property, only a person knows the right one."""
    if len(nearest) != 1:
        return None
    stands = node.properties.get(nearest[0])
    return renamed(name, nearest[0]) if stands is None or stands.raw == node.properties[name].raw else None


@functools.cache
def _general() -> frozenset[str]:
    subjects = yaml.load(KNOWN_FILE.read_text(encoding="utf-8"), Loader=YamlLoader)
    return frozenset(name for names in subjects.values() for name in names.split())


def known_properties(chip: Chip) -> frozenset[str]:
    """All that somebody reads, as far as it is known."""
    return _general().union(*(peripheral.properties for peripheral in chip.peripherals.values()))


@functools.cache
def meant(name: str, known: frozenset[str]) -> tuple[str, ...]:
    """The known properties that a name is nearly, of the nearest kind; none for one that is known."""
    if name in known or NUMBERED.fullmatch(name) or name.endswith(ENDINGS):
        return ()
    first, dash, last = name.rpartition("-")
    for ending in ENDINGS if dash else ():
        if last.isalpha() and is_one_off(last, ending):
            return (f"{first}-{ending}",)
    candidates = [word for word in (*sorted(known), "pinctrl-0", "pinctrl-1") if len(word) >= SHORTEST]
    for is_near in (is_one_off, _is_written_otherwise, _is_cut, _is_misspelt(known)):
        if found := tuple(word for word in candidates if is_near(name, word)):
            return found
    return ()


def _is_written_otherwise(written: str, meant: str) -> bool:
    """As Read_Only is read-only."""
    return SEPARATORS.sub("", written).casefold() == SEPARATORS.sub("", meant).casefold()


def _is_misspelt(known: frozenset[str]) -> Callable[[str, str], bool]:
    """As interupt-parnt is interrupt-parent: word by word; a word of another name is not misspelt."""
    words = _words(known)

    def is_near(written: str, meant: str) -> bool:
        has, wants = SEPARATORS.split(written), SEPARATORS.split(meant)
        return len(has) == len(wants) and all(
            a == b or (a not in words and len(b) >= SHORTEST_WORD and _is_near_word(a, b))
            for a, b in zip(has, wants, strict=True)
        )

    return is_near


@functools.cache
def _words(known: frozenset[str]) -> frozenset[str]:
    return frozenset(word for name in known for word in SEPARATORS.split(name))


def _is_near_word(written: str, meant: str) -> bool:
    """One letter off, or two in a long word: what one letter's change brings one letter near."""
    if is_one_off(written, meant):
        return True
    if len(meant) < LONG_WORD or abs(len(written) - len(meant)) > 2:
        return False
    shorter, longer = sorted((written, meant), key=len)
    return any(
        near == shorter or is_one_off(near, shorter)
        for near in (longer[:i] + longer[i + 1 :] for i in range(len(longer)))
    )


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
    "A node takes a clock, DMA channel, reset, PWM, PHY, converter or supply from a node that has none, or "
    "that is disabled.",
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
        for name in (one for one in node.properties if one.endswith("-supply")):
            if fault := _supply_fault(context, node, name):
                yield Finding(
                    "wrong-reference",
                    **at(node, name),
                    message=f"{name} of {context.name(node)} refers to {fault}",
                    remedy=f"Make {name} of {context.name(node)} refer to an enabled regulator, or delete it",
                )


def _supply_fault(context: Context, node: Node, name: str) -> str | None:
    """What is wrong with who supplies a node; None: nothing, or nobody knows what a regulator is there."""
    for handle in node.cells(name)[:1]:
        target = context.tree.by_phandle.get(handle)
        if target is None:
            return "a node that does not exist"
        if target in context.peripherals:
            return f"{context.name(target)}, which is no regulator"
        if not target.enabled:
            return f"{context.name(target)}, which {off(target)}"
    return None


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
    """What a property's value is in, and for what it is taken if it is smaller or larger than any."""

    name: str
    mistaken: str
    least: int = 0
    most: int = 0xFFFFFFFF

    def right(self, value: int) -> int | None:
        """A value in this unit that was written in the other; None: it can be as it is."""
        if 0 < value < self.least:
            return 1000 * value
        return value // 1000 if value > self.most and value % 1000 == 0 else None


FREQUENCY = Unit("Hz", "kHz", least=5_000)
VOLTAGE = Unit("microvolts", "millivolts", least=50_000)
UNITS = {
    "bus_freq": FREQUENCY,
    "spi-max-frequency": FREQUENCY,
    "max-frequency": FREQUENCY,
    "regulator-min-microvolt": VOLTAGE,
    "regulator-max-microvolt": VOLTAGE,
    "debounce-interval": Unit("milliseconds", "microseconds", most=999),
    "poll-interval": Unit("milliseconds", "microseconds", most=99_999),
    "timeout-sec": Unit("seconds", "milliseconds", most=999),
}


@rule(
    "wrong-unit",
    "A value is so small or so large that it was probably written in another unit.",
    "Nothing compares it with what the device can do: a bus is a thousand times too slow, a supply is told "
    "as a thousandth of what it is, and a key is heard after twenty seconds.",
)
def wrong_unit(context: Context) -> Iterator[Finding]:
    for node in context.enabled:
        for name, unit in UNITS.items():
            for value in node.cells(name)[:1]:
                if right := unit.right(value):
                    yield Finding(
                        "wrong-unit",
                        **at(node, name),
                        message=f"{name} of {context.name(node)} is {value} {unit.name}; it was probably "
                        f"written in {unit.mistaken}",
                        remedy=f"Write {name} in {unit.name}: <{right}>",
                        fix=valued(name, f"<{right}>"),
                    )


RULES = (unknown_property, wrong_reference, wrong_unit)
