# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on where device nodes are: addresses, buses, and nodes that describe no device."""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Iterator

from nuc980.pins.chip import AIC, Peripheral
from nuc980.pins.claims import BUSES, on_bus
from nuc980.pins.findings import Claimant, Finding, at
from nuc980.pins.rules.context import Context, grouped, listed, rule
from nuc980.pins.rules.identity import address_of, unit_number
from nuc980.pins.tree import Node


@rule(
    "wrong-address",
    "A node gives a device the wrong address.",
    "The driver writes to the registers of another block, or to none. An access outside every block stops "
    "the system.",
)
def wrong_address(context: Context) -> Iterator[Finding]:
    for node, peripheral in context.peripherals.items():
        address = address_of(node)
        if peripheral.address is None or (peripheral.address == address and any(node.cells("reg")[1:2])):
            continue
        if address is None and node is context.pinctrl:  # its driver has the address built in
            continue
        there = [other.label for other in context.chip.at(address)] if address is not None else []
        found = "has no reg" if address is None else f"has reg {address:#x}"
        if address == peripheral.address:
            there, found = [], "has a reg without a size"
        owner = f", where {listed(there)} is" if there else ""
        yield Finding(
            "wrong-address",
            **at(node, "reg"),
            message=f"{node.path} {found}{owner}; {peripheral.label} is at {peripheral.address:#x}",
            remedy=f"Set reg = <{peripheral.address:#x} {peripheral.size:#x}> in {peripheral.label}",
        )


@rule(
    "unit-address",
    "A node's name and its reg give different addresses.",
    "The kernel uses reg; people and dtc read the name. The vendor's interrupt controller is called "
    "b0004000, which is the address of the GPIO block, but it sits at b0042000.",
)
def unit_address(context: Context) -> Iterator[Finding]:
    for node in context.tree.root.walk():
        address, unit = address_of(node), unit_number(node)
        if unit is None or address is None or address == unit:
            continue
        if not (on_bus(node) or node.parent in context.serial_buses or _is_partition(node)):
            continue
        peripheral = context.peripherals.get(node)
        if peripheral and peripheral.address != address:
            continue  # wrong-address
        owner = (
            f", the address of {listed(there)}"
            if (there := [at.label for at in context.chip.at(unit)])
            else ""
        )
        yield Finding(
            "unit-address",
            **at(node, "reg"),
            message=f"the name of {node.name} says {unit:x}{owner}, but its reg says {address:x}",
            remedy=f"Rename the node to {node.base_name}@{address:x}, or correct its reg",
        )


def _is_partition(node: Node) -> bool:
    parent = node.parent
    return (
        parent is not None
        and "fixed-partitions" in parent.strings("compatible")
        and len(node.cells("reg")) == 2
    )


@rule(
    "no-bus",
    "Devices of the chip are under a node that the kernel does not treat as a bus.",
    "The kernel looks only at the children of simple-bus and simple-mfd, and gives them registers only "
    "where ranges says how. Devices elsewhere are in the tree, but never in the system.",
)
def no_bus(context: Context) -> Iterator[Finding]:
    names = {name for one in context.chip.peripherals.values() for name in one.names}
    below = grouped(
        (node for node in context.tree.root.walk() if not names.isdisjoint(node.strings("compatible"))),
        lambda node: node.parent,
    )
    for bus, devices in below.items():
        fault = _bus_fault(bus) if bus and bus is not context.tree.root else None
        if fault:
            yield Finding(
                "no-bus",
                **at(bus, "compatible"),
                message=f"{bus.path} {fault}, but {devices[0].path} is under it"
                + (f", and {len(devices) - 1} more" if len(devices) > 1 else ""),
                remedy='Set compatible = "simple-bus", #address-cells = <1>, #size-cells = <1> and an empty '
                f"ranges in {bus.path}, or move what is under it to a bus",
            )


def _bus_fault(bus: Node) -> str | None:
    if not set(BUSES).intersection(bus.strings("compatible")):
        return f"is not a {BUSES[0]}"
    if "ranges" not in bus.properties:
        return "has no ranges"
    if bus.cells("ranges")[:1] != bus.cells("ranges")[1:2]:
        return "has ranges that translate addresses"
    wrong = [name for name in ("#address-cells", "#size-cells") if bus.cells(name) not in ([], [1])]
    return f"has {listed(f'{name} = <{bus.cells(name)[0]}>' for name in wrong)}" if wrong else None


@rule(
    "outside-bus",
    "A device of the chip is not on its bus.",
    "The kernel creates the device there too. But board files, U-Boot and programs know it by its path on "
    "/apb or /ahb. Whoever changes the node at that path creates a second node with the same registers.",
)
def outside_bus(context: Context) -> Iterator[Finding]:
    buses = {peripheral.bus for peripheral in context.chip.peripherals.values()}
    for node, peripheral in context.peripherals.items():
        parent = node.parent
        if peripheral.address is None or parent.name == peripheral.bus:
            continue
        if parent is not context.tree.root and parent.name not in buses:  # a board's own name for a bus
            continue
        if peripheral.label == AIC and parent is context.tree.root:  # the kernel finds it by compatible alone
            continue
        yield Finding(
            "outside-bus",
            **at(node),
            message=f"{node.path} is {peripheral.label}, which is on the bus /{peripheral.bus}",
            remedy=f"Move the node to {peripheral.path}, or change &{peripheral.label} {{ … }} instead",
        )


@rule(
    "address-twice",
    "Two enabled nodes describe the same block of the chip.",
    "The second driver does not get the registers (-EBUSY), or both drivers write to them. A smart-card "
    "interface and its UART are one block, for example. The ports of the USB host share a block on purpose.",
)
def address_twice(context: Context) -> Iterator[Finding]:
    for address, nodes in grouped(_located(context), address_of).items():
        known = [context.peripherals.get(node) for node in nodes]
        if len(nodes) < 2 or all(map(_is_usb_host, known)):
            continue
        yield Finding(
            "address-twice",
            **at(nodes[-1], "reg"),
            message=f"{listed(node.path for node in nodes)} are enabled, and all are at {address:#x}",
            remedy='Keep one of them; set status = "disabled" in the others',
            claimants=tuple(
                Claimant(node.path, f"the block at {address:#x}", node.place_of("reg")) for node in nodes
            ),
        )


def _located(context: Context) -> list[Node]:
    """The enabled nodes with registers of the chip."""
    return [
        node
        for node in context.enabled
        if (on_bus(node) or node in context.peripherals) and address_of(node) is not None
    ]


def _is_usb_host(peripheral: Peripheral | None) -> bool:
    return peripheral is not None and peripheral.label.startswith("usbh_")


@rule(
    "reg-overlap",
    "The registers of two enabled devices overlap.",
    "A driver gets its whole reg or nothing: the second of the two to probe fails (-EBUSY, -16). With a reg "
    "of 0x2000 bytes, ttyS1 takes the registers of ttyS2, and ttyS2 is missing.",
)
def reg_overlap(context: Context) -> Iterator[Finding]:
    for first, second in _overlapping(sorted(_located(context), key=address_of)):
        start, end = address_of(second), address_of(first) + _size_of(first)
        if address_of(first) == start:  # address-twice
            continue
        wrong = next((node for node in (first, second) if not _has_own_size(context, node)), first)
        peripheral = context.peripherals.get(wrong)
        own = f"Set reg = <{peripheral.address:#x} {peripheral.size:#x}>" if peripheral else "Shorten reg"
        yield Finding(
            "reg-overlap",
            **at(wrong, "reg"),
            message=f"{context.name(first)} covers {address_of(first):#x} to {end - 1:#x}, and with it "
            f"{context.name(second)} at {start:#x}",
            remedy=f"{own} in {context.name(wrong)}",
            claimants=tuple(
                Claimant(
                    node.path, f"{_size_of(node):#x} bytes at {address_of(node):#x}", node.place_of("reg")
                )
                for node in (first, second)
            ),
        )


def _overlapping(nodes: list[Node]) -> Iterator[tuple[Node, Node]]:
    """Of nodes by address, each with those that begin before it ends."""
    for place, first in enumerate(nodes):
        end = address_of(first) + _size_of(first)
        behind = itertools.islice(nodes, place + 1, None)
        for second in itertools.takewhile(lambda node, end=end: address_of(node) < end, behind):
            yield first, second


def _size_of(node: Node) -> int:
    return next(iter(node.cells("reg")[1:]), 0)


def _has_own_size(context: Context, node: Node) -> bool:
    peripheral = context.peripherals.get(node)
    return peripheral is not None and _size_of(node) == peripheral.size


@rule(
    "stale-node",
    "A node on a bus has no compatible string; it was probably meant to change a node of another name.",
    "dtc creates a new node for a name that it does not know. The vendor's board files disable "
    "cap0@b0024000, but that node is called ccap0 now, so they disable nothing.",
)
def stale_node(context: Context) -> Iterator[Finding]:
    for node in context.tree.root.walk():
        if not on_bus(node) or "compatible" in node.properties:
            continue
        meant = _meant(context, node)
        yield Finding(
            "stale-node",
            **at(node),
            message=f"{node.path} has no compatible string, so it describes no device"
            + (f"; it probably means {meant.path}" if meant else ""),
            remedy=f"Rename the node to {meant.name}, the one that it is to change"
            if meant
            else f"Delete {node.path}, or give it the name of the node that it is to change",
        )


def _meant(context: Context, stale: Node) -> Node | None:
    """The device that a node of no device was meant for: at the same address, or of nearly the same name."""
    devices = list(context.peripherals)
    unit = unit_number(stale)
    for node in devices:
        if unit is not None and unit in (unit_number(node), address_of(node)):
            return node
    names = {node.name: node for node in devices if node.parent is stale.parent}
    close = difflib.get_close_matches(stale.name, names, n=1, cutoff=0.8)
    return names[close[0]] if close else None


RULES = (wrong_address, unit_address, no_bus, outside_bus, address_twice, reg_overlap, stale_node)
