# SPDX-License-Identifier: GPL-3.0-or-later
"""What the rules look at: the tree, the chip, perhaps a board, and what is known of each node."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from nuc980.pins.board import Board
from nuc980.pins.chip import GPIO, Chip, Package, Peripheral, pin_order
from nuc980.pins.claims import (
    CELLS_A_PIN,
    PINS,
    Claim,
    State,
    claims,
    enabled_nodes,
    is_group,
    on_bus,
    pin_controller,
    states,
)
from nuc980.pins.environment import Environment
from nuc980.pins.findings import Claimant, Finding
from nuc980.pins.rules.identity import identify
from nuc980.pins.tree import Node, Tree


@dataclass(frozen=True)
class Rule:
    """One thing that a device tree can do wrong."""

    name: str
    what: str  # one sentence
    why: str  # what happens on this chip, with this kernel
    find: Callable[[Context], Iterator[Finding]]


def rule(name: str, what: str, why: str) -> Callable[[Callable[[Context], Iterator[Finding]]], Rule]:
    """Makes a rule of the generator that finds where a tree breaks it."""
    return lambda find: Rule(name, what, why, find)


@dataclass(frozen=True)
class Context:
    """A tree to be judged."""

    tree: Tree
    chip: Chip
    board: Board | None  # None: the rules of the pin table do not run
    package: Package | None  # None: nothing is known of what it brings out
    environment: Environment = field(default_factory=Environment)  # what is said beside the tree
    validated: Sequence[Finding] = ()  # what the kernel's bindings find

    @cached_property
    def claims(self) -> list[Claim]:
        return claims(self.tree, self.chip)

    @cached_property
    def claims_of(self) -> dict[Node, list[Claim]]:
        """Node: what it wants; only nodes that want something."""
        return grouped(self.claims, lambda claim: claim.node)

    @cached_property
    def enabled(self) -> list[Node]:
        return enabled_nodes(self.tree)

    @cached_property
    def peripherals(self) -> dict[Node, Peripheral]:
        """Node: the peripheral that it describes, on or off."""
        found = {}
        for node in self.tree.root.walk():
            if on_bus(node) or node.parent is self.tree.root:
                peripheral = identify(node, self.chip)
                if peripheral:
                    found[node] = peripheral
        return found

    @cached_property
    def devices(self) -> dict[Node, Peripheral]:
        """The peripherals that are on."""
        return {node: self.peripherals[node] for node in self.enabled if node in self.peripherals}

    @cached_property
    def serial_buses(self) -> dict[Node, str]:
        """The I2C and SPI controllers that are on, of the chip and by GPIO: "i2c" or "spi"."""
        chips = {node: one.label for node, one in self.devices.items() if "bus_num" in one.properties}
        kinds = {node: "i2c" if label.startswith("i2c") else "spi" for node, label in chips.items()}
        by_lines = {
            node: compatible.removesuffix("-gpio")
            for node in self.enabled
            for compatible in node.strings("compatible")
            if compatible in ("i2c-gpio", "spi-gpio")
        }
        return kinds | by_lines

    @cached_property
    def pinctrl(self) -> Node | None:
        return pin_controller(self.tree)

    @cached_property
    def groups(self) -> list[Node]:
        """All pin groups, used or not."""
        return [group for function in self.pinctrl or () for group in function]

    @property
    def chosen(self) -> Node:
        """Where the tree has what a kernel is told, or would have it."""
        return self.tree.find("/chosen") or self.tree.root

    @cached_property
    def command_line(self) -> list[str]:
        """The kernel's, word by word: what the tree has of it, and what is said beside."""
        chosen = self.tree.find("/chosen")
        own = " ".join(chosen.strings("bootargs")).split() if chosen else []
        return [*own, *self.environment.words]

    def muxed(self, node: Node) -> list[Claim]:
        return [claim for claim in self.claims_of.get(node, ()) if claim.muxed]

    def working_state(self, node: Node) -> State | None:
        """The state a device works in: the one called default, or the first."""
        found = list(states(node))
        return next((state for state in found if state.name == "default"), found[0] if found else None)

    def working_claims(self, node: Node) -> list[Claim]:
        """The pins of the state a device works in."""
        state = self.working_state(node)
        return [claim for claim in self.muxed(node) if state and claim.property == state.property]

    def is_foreign(self, claim: Claim) -> bool:
        """
        Whether a pin's function is another device's. A node that is no peripheral may have any, and the pin
        controller for pins that nobody else asks for.
        """
        if claim.signal in (None, GPIO) or claim.node is self.pinctrl:
            return False
        peripheral = self.peripherals.get(claim.node)
        if peripheral is None or peripheral.owns(claim.signal):
            return False
        return bool(self.chip.owners(claim.signal))

    def is_readable(self, node: Node) -> bool:
        """
        Whether a device's groups say what it wants. If not, that is found, and its pins are judged no
        further: whatever is missing may be what the faulty cells meant.
        """
        groups = [self.tree.by_phandle.get(handle) for state in states(node) for handle in state.phandles]
        if not all(group and is_group(group) and is_well_formed(group) for group in groups):
            return False
        return not any(claim.signal is None or self.is_foreign(claim) for claim in self.muxed(node))

    def name(self, node: Node) -> str:
        """What people call a node: uart1, or its path."""
        peripheral = self.peripherals.get(node)
        return peripheral.label if peripheral else node.labels[0] if node.labels else node.path


def switched_off(node: Node) -> Node:
    """Of a node that is off: itself, or the node above it that is."""
    above = node.parent
    return switched_off(above) if above and not above.enabled else node


def off(node: Node) -> str:
    """ "is disabled", with the bus that is the cause."""
    cause = switched_off(node)
    return "is disabled" if cause is node else f"is disabled, because {cause.path} is"


def is_well_formed(group: Node) -> bool:
    """Whether a group has pins, of four cells each."""
    cells = group.cells(PINS)
    return bool(cells) and len(cells) % CELLS_A_PIN == 0


# ---- words ---------------------------------------------------------------------------------------


def grouped(items: Iterable, key: Callable) -> dict:
    """Key: its items, in the order of the first of each."""
    found: dict = {}
    for item in items:
        found.setdefault(key(item), []).append(item)
    return found


def in_order(pins: Iterable[str]) -> tuple[str, ...]:
    """Pins without repetition, PA9 before PA10, those that do not exist last."""

    def order(pin: str) -> tuple[bool, tuple[int, int] | str]:
        try:
            return False, pin_order(pin)
        except ValueError:
            return True, pin

    return tuple(sorted(set(pins), key=order))


def listed(words: Iterable[str]) -> str:
    """ "a", "a and b", "a, b and c"."""
    *most, last = words
    return f"{', '.join(most)} and {last}" if most else last


def ranged(pins: Sequence[str]) -> str:
    """Pins in their order for people, three and more of a row drawn together: "PA0 and PF0 to PF6"."""
    rows: list[list[str]] = []
    for pin in pins:
        if rows and _follows(pin, rows[-1][-1]):
            rows[-1].append(pin)
        else:
            rows.append([pin])
    drawn = ([f"{row[0]} to {row[-1]}"] if len(row) > 2 else row for row in rows)
    return listed(word for row in drawn for word in row)


def _follows(pin: str, before: str) -> bool:
    try:
        (bank, index), (bank_before, index_before) = pin_order(pin), pin_order(before)
    except ValueError:
        return False
    return bank == bank_before and index == index_before + 1


def claimants(claims: Sequence[Claim]) -> tuple[Claimant, ...]:
    """One for each node and property, with all that it wants there."""
    return tuple(
        Claimant(node.path, _wants(group), group[0].place)
        for (node, _), group in grouped(claims, lambda claim: (claim.node, claim.property)).items()
    )


def _wants(claims: Sequence[Claim]) -> str:
    pins = ", ".join(f"{claim.pin} as {claim.signal or f'function {claim.value}'}" for claim in claims)
    groups = dict.fromkeys(claim.group.name for claim in claims if claim.group)
    return f"{pins} ({claims[0].property}{f', group {listed(groups)}' if groups else ''})"


def cells_of(pin: str, value: int) -> str:
    """As a group writes it: "<0 1 4 0>"."""
    bank, index = pin_order(pin)
    return f"<{bank} {index} {value} 0>"


def places_of_signal(chip: Chip, signal: str) -> str:
    """Where a signal can be had: "PA1 <0 1 4 0> or PC5 <2 5 7 0>"."""
    return " or ".join(f"{pin} {cells_of(pin, value)}" for pin, value in chip.signals[signal])


def functions_of_pin(chip: Chip, pin: str) -> str:
    """ "0 GPIO, 1 UART0_RXD"."""
    return ", ".join(f"{value} {signal}" for value, signal in chip.pins[pin].items())
