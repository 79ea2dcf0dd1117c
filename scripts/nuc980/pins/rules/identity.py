# SPDX-License-Identifier: GPL-3.0-or-later
"""Which peripheral a node describes, also when one of its properties is wrong: the evidence decides."""

from __future__ import annotations

from collections.abc import Iterator

from nuc980.pins.chip import Chip, Peripheral
from nuc980.pins.tree import Node

# The address weighs most: with two nodes that were copied from one, it is what somebody did change.
COMPATIBLE, REG, UNIT_ADDRESS, ONE_EACH = 1, 3, 2, 1
NUMBERS = ("port-number", "map-addr", "id")  # of an instance; bus_num is free to choose


def has_driver_name(node: Node, peripheral: Peripheral) -> bool:
    """Whether a vendor kernel has a driver for the peripheral by one of the node's compatible strings."""
    return not set(node.strings("compatible")).isdisjoint(peripheral.names)


def address_of(node: Node) -> int | None:
    """The first address of reg, on a bus with addresses of one cell."""
    return next(iter(node.cells("reg")), None)


def unit_number(node: Node) -> int | None:
    """The unit address as a number; None without one, or for one that is none."""
    try:
        return int(node.unit_address or "", 16)
    except ValueError:
        return None


def interrupt_sources(peripheral: Peripheral, chip: Chip) -> list[int]:
    return [chip.interrupts[name] for name in peripheral.interrupts]


def identify(node: Node, chip: Chip) -> Peripheral | None:
    """The peripheral that a node on a bus describes; None for one without compatible, or of another kind."""
    if "compatible" not in node.properties:
        return None
    candidates = list(_candidates(node, chip))
    if len(candidates) < 2:
        return next(iter(candidates), None)
    return max(candidates, key=lambda peripheral: _evidence(node, peripheral, chip))


def _candidates(node: Node, chip: Chip) -> Iterator[Peripheral]:
    strings = set(node.strings("compatible"))
    address, unit, name = address_of(node), unit_number(node), node.base_name
    for peripheral in chip.peripherals.values():
        by_name = address is None and name == peripheral.node and unit == peripheral.address
        by_address = address is not None and address == peripheral.address
        if by_address or by_name or not strings.isdisjoint(peripheral.names):
            yield peripheral


def _evidence(node: Node, peripheral: Peripheral, chip: Chip) -> int:
    numbers = [
        node.cells(name) == [peripheral.properties[name]] for name in NUMBERS if name in peripheral.properties
    ]
    sources = interrupt_sources(peripheral, chip)
    return (
        COMPATIBLE * has_driver_name(node, peripheral)
        + REG * (peripheral.address is not None and address_of(node) == peripheral.address)
        + UNIT_ADDRESS * (peripheral.address is not None and unit_number(node) == peripheral.address)
        + ONE_EACH * (node.base_name == peripheral.node)
        + ONE_EACH * (bool(sources) and node.cells("interrupts")[::3] == sources)
        + ONE_EACH * sum(numbers)
    )
