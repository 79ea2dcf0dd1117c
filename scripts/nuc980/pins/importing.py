# SPDX-License-Identifier: GPL-3.0-or-later
"""A pin table from an existing device tree: the way in for whoever has one."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, field

import yaml

from nuc980.errors import printable
from nuc980.pins.chip import GPIO, Chip, Package, Peripheral
from nuc980.pins.claims import (
    PINS,
    Claim,
    MalformedError,
    claims,
    enabled_nodes,
    gpio_specifiers,
    interrupt_specifiers,
    is_gpio_list,
    is_group,
    states,
)
from nuc980.pins.rules.context import in_order, is_well_formed
from nuc980.pins.rules.identity import identify
from nuc980.pins.tree import Node, Tree

WIDTH = 110
GPIOS = "gpios"


def import_board(tree: Tree, chip: Chip, part: str) -> str:
    """
    The text of a pins.yml with what the enabled nodes of a tree have: pins of devices, GPIO lines. The first
    of several claimants has a pin; every claim that a pin table cannot express is a comment there that says
    why. `part` is one of the chip's.
    """
    table = _Table(chip, chip.packages[chip.parts[part]])
    for node in enabled_nodes(tree):
        for cause in _unreadable(tree, node):
            table.leave_out(node, cause)
    for claim in claims(tree, chip):
        table.add(claim)
    return "\n".join(_lines(table, tree, part)) + "\n"


@dataclass
class _Table:
    """The pin table as far as it is."""

    chip: Chip
    package: Package
    devices: dict[str, dict[str, str]] = field(default_factory=dict)  # label: signal, in full: pin
    gpios: dict[str, str] = field(default_factory=dict)  # pin: what for
    users: dict[str, Claim] = field(default_factory=dict)  # pin: who has it here
    comments: dict[str, list[str]] = field(
        default_factory=dict
    )  # a device's label or GPIOS: what was left out

    def add(self, claim: Claim) -> None:
        """Gives a pin to its claimant, or says why not."""
        peripheral = identify(claim.node, self.chip)
        cause = self._obstacle(claim, peripheral)
        if cause:
            what = claim.signal or f"function {claim.value}"
            self.leave_out(claim.node, f"{claim.pin} as {what} ({claim.property}): {cause}")
            return
        # The node that uses a line knows better what it is for than one that only switches the pin.
        if claim.pin not in self.users or not claim.muxed:
            self.users[claim.pin] = claim
        if claim.signal == GPIO:
            self.gpios[claim.pin] = _purpose(self.users[claim.pin])
        else:
            self.devices.setdefault(peripheral.label, {})[claim.signal] = claim.pin

    def leave_out(self, node: Node, cause: str) -> None:
        """A comment at the node's device, or at the GPIOs for a node that is no device of the chip."""
        peripheral = identify(node, self.chip)
        section = peripheral.label if peripheral and peripheral.signals else GPIOS
        self.comments.setdefault(section, []).append(f"{node.path}: {cause}")

    def _obstacle(self, claim: Claim, peripheral: Peripheral | None) -> str | None:
        """What keeps a claim out of a pin table; None: nothing."""
        if claim.pin not in self.chip.pins:
            return "the chip has no such pin"
        if claim.signal is None:
            return "the pin has no such function"
        if claim.pin not in self.package.bonded:
            return f"{self.package.name} does not bring it out"
        if claim.signal != GPIO and (peripheral is None or not peripheral.owns(claim.signal)):
            return "not a signal of this node"
        user = self.users.get(claim.pin)
        if user and not _is_same_use(user, claim):
            return f"{user.node.path} has the pin as {user.signal}"
        if claim.signal != GPIO:
            elsewhere = self.devices.get(peripheral.label, {}).get(claim.signal, claim.pin)
            return f"the signal is on {elsewhere}" if elsewhere != claim.pin else None
        return None


def _is_same_use(one: Claim, other: Claim) -> bool:
    """A device that has a pin in two states, or a group that makes it the GPIO line that somebody uses."""
    if one.signal != other.signal:
        return False
    return one.node is other.node or (one.signal == GPIO and one.muxed != other.muxed)


def _unreadable(tree: Tree, node: Node) -> Iterator[str]:
    """What a node wants but says wrongly: claims() leaves it out."""
    for state in states(node):
        for group in map(tree.by_phandle.get, state.phandles):
            if group is None or not is_group(group):
                yield f"{state.property} refers to something that is not a pin group"
            elif not is_well_formed(group):
                yield f"{PINS} of {group.path} does not have four cells for each pin"
    for name in filter(is_gpio_list, node.properties):
        try:
            list(gpio_specifiers(tree, node, name))
        except MalformedError as error:
            yield f"{name}: {error}"
    try:
        list(interrupt_specifiers(tree, node))
    except MalformedError as error:
        yield f"interrupts {error}"


def _purpose(claim: Claim) -> str:
    """What people call a line: "leds, run", "lcd, dc-gpios", "group uart6-RTS of /apb/serial@b0076000"."""
    node = claim.node
    if claim.muxed:
        return f"group {claim.group.name} of {node.path}"
    name = next(iter([*node.strings("label"), *node.strings("line-name")]), node.base_name)
    words = [name] if claim.property in ("gpio", "gpios") else [name, claim.property]
    if "compatible" not in node.properties and node.parent:
        words.insert(0, node.parent.base_name)
    return ", ".join(words)


def _lines(table: _Table, tree: Tree, part: str) -> Iterator[str]:
    name = next(iter(tree.root.strings("model")), tree.file.stem)
    yield "# SPDX-License-Identifier: GPL-3.0-or-later"
    yield printable(f"# Pin table made from {tree.file.name} by nuc980-pins import.")
    if table.comments:
        yield "# Not everything in there fits a pin table: the comments say what was left out, and why."
    yield ""
    yield _entry("board", name)
    yield _entry("part", part)
    yield ""
    yield "devices:" if table.devices else "devices: {}"
    for label, pins in table.devices.items():
        yield f"  {label}:"
        yield from _flow(_short_names(table.chip.peripherals[label], pins))
        yield from _comments(table, label, "    ")
    for section in table.comments:
        if section not in table.devices and section != GPIOS:
            yield from _comments(table, section, "  ")
    yield ""
    yield "gpios:" if table.gpios else "gpios: {}"
    for pin in in_order(table.gpios):
        yield "  " + _entry(pin, table.gpios[pin])
    yield from _comments(table, GPIOS, "  ")
    yield ""
    yield "reserved: {}"
    yield "not_connected: []"
    yield "accepted: []"


def _short_names(peripheral: Peripheral, pins: dict[str, str]) -> Iterator[str]:
    """ "RXD: PA0" for uart1's UART1_RXD; in full for the fmi, which has NAND_DATA0 and SD0_DATA0."""
    prefixes = [prefix for prefix in peripheral.signals if prefix.endswith("_")]
    prefix = prefixes[0] if len(peripheral.signals) == len(prefixes) == 1 else ""
    return (f"{signal.removeprefix(prefix)}: {pin}" for signal, pin in pins.items())


def _flow(pins: Iterator[str]) -> Iterator[str]:
    text = "{" + ", ".join(pins) + "}"
    if len(text) + len("    pins: ") <= WIDTH:
        yield f"    pins: {text}"
        return
    yield "    pins:"
    # A space inside "RXD: PA0" is none to break the line at.
    text = text.replace(": ", ":\N{NO-BREAK SPACE}")
    for line in textwrap.wrap(text, WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 7):
        yield line.replace("\N{NO-BREAK SPACE}", " ")


def _comments(table: _Table, section: str, indent: str) -> Iterator[str]:
    for text in table.comments.get(section, ()):
        yield printable(f"{indent}# {text}")


def _entry(key: str, text: str) -> str:
    return yaml.safe_dump({key: printable(text)}, width=float("inf"), allow_unicode=True).rstrip("\n")
