# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on device nodes against the chip: addresses, interrupts, drivers, and what several of them share."""

from __future__ import annotations

import difflib
from collections.abc import Iterator

from nuc980.pins.chip import Peripheral
from nuc980.pins.claims import interrupt_parent, on_bus
from nuc980.pins.findings import Claimant, Finding, at
from nuc980.pins.rules.context import Context, grouped, listed, rule
from nuc980.pins.rules.identity import address_of, has_driver_name, interrupt_sources, unit_number
from nuc980.pins.tree import Node

INTERRUPT_CELLS = 3  # of the AIC; the kernels read the first, 6.6 the second as the trigger
NEEDED_BY_UART = ("port-number", "map-addr", "pdma-enable")


@rule(
    "wrong-address",
    "A device is at an address that is not its own.",
    "The driver writes to registers of another block, or to none; an access outside every block stops "
    "the system.",
)
def wrong_address(context: Context) -> Iterator[Finding]:
    for node, peripheral in context.peripherals.items():
        address = address_of(node)
        if peripheral.address is None or peripheral.address == address:
            continue
        if address is None and peripheral.label == "pinctrl":  # its driver has the address built in
            continue
        there = [other.label for other in context.chip.at(address)] if address is not None else []
        found = "has no reg" if address is None else f"has reg {address:#x}"
        owner = f", where {listed(there)} is" if there else ""
        yield Finding(
            "wrong-address",
            **at(node, "reg"),
            message=f"{node.path} {found}{owner}; {peripheral.label} is at {peripheral.address:#x}",
            remedy=f"Set reg = <{peripheral.address:#x} {peripheral.size:#x}> in {peripheral.label}",
        )


@rule(
    "unit-address",
    "The name of a node gives another address than its reg.",
    "The kernel goes by reg, people and dtc by the name: the vendor's interrupt controller is called "
    "b0004000, the address of the GPIO block, and sits at b0042000.",
)
def unit_address(context: Context) -> Iterator[Finding]:
    for node in context.tree.root.walk():
        address, unit = address_of(node), unit_number(node)
        if not on_bus(node) or unit is None or address is None or address == unit:
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
            message=f"{node.name} is called {unit:x}{owner}, its reg says {address:x}",
            remedy=f"Call the node {node.base_name}@{address:x}, or correct its reg",
        )


@rule(
    "wrong-interrupt",
    "The interrupts of a device are not its own.",
    "The driver waits for interrupts of another block: the device hangs, and the other's interrupt may "
    "be taken away. The order counts: the Ethernet drivers take the first for sending.",
)
def wrong_interrupt(context: Context) -> Iterator[Finding]:
    for node, peripheral in context.peripherals.items():
        right = interrupt_sources(peripheral, context.chip)
        parent = interrupt_parent(context.tree, node)
        controlled = parent is None or context.peripherals.get(parent, peripheral).label == "aic"
        if not right or "interrupts-extended" in node.properties or not controlled:
            continue
        if (
            peripheral.label == "gpio"
        ):  # its driver has the seven sources built in; the sources disagree on one
            continue
        cells = node.cells("interrupts")
        if cells[::INTERRUPT_CELLS] == right and len(cells) == INTERRUPT_CELLS * len(right):
            continue
        names = listed(
            f"{source} ({name})" for source, name in zip(right, peripheral.interrupts, strict=True)
        )
        yield Finding(
            "wrong-interrupt",
            **at(node, "interrupts"),
            message=f"{peripheral.label} has {_interrupts(context, cells)}; its own is {names}",
            remedy=f"Set interrupts = {', '.join(f'<{source} 4 1>' for source in right)} in "
            f"{peripheral.label}",
        )


def _interrupts(context: Context, cells: list[int]) -> str:
    if not cells:
        return "no interrupts"
    if len(cells) % INTERRUPT_CELLS:
        return f"interrupts of {len(cells)} cells, no multiple of {INTERRUPT_CELLS}"
    names = {source: name for name, source in context.chip.interrupts.items()}
    return listed(
        f"interrupt {source} ({names.get(source, 'no source')})" for source in cells[::INTERRUPT_CELLS]
    )


@rule(
    "wrong-compatible",
    "No driver takes a device by its compatible string.",
    "The device is in the tree and never in the system; nothing is logged.",
)
def wrong_compatible(context: Context) -> Iterator[Finding]:
    for node, peripheral in context.peripherals.items():
        if not has_driver_name(node, peripheral):
            yield Finding(
                "wrong-compatible",
                **at(node, "compatible"),
                message=f"{node.path} is {peripheral.label} by its address, but compatible is "
                f"{', '.join(map(repr, node.strings('compatible'))) or 'empty'}",
                remedy=f"Set compatible = {_quoted(peripheral.compatible)} in {node.path}",
            )
        elif not peripheral.has_driver and node in context.devices:
            yield Finding(
                "wrong-compatible",
                **at(node, "compatible"),
                message=f"{peripheral.label} is on, but no kernel of the vendor has a driver for "
                f"{peripheral.compatible[0]}",
                remedy=f'Set status = "disabled" in {peripheral.label}, or delete the node',
            )


def _quoted(strings: tuple[str, ...]) -> str:
    return ", ".join(f'"{string}"' for string in strings)


@rule(
    "address-twice",
    "Two enabled nodes are at one block of the chip.",
    "The second driver cannot have the registers (-EBUSY), or both write to them: a smart card and its "
    "UART are one block. The USB host's ports share theirs by intent.",
)
def address_twice(context: Context) -> Iterator[Finding]:
    located = [node for node in context.enabled if on_bus(node) and address_of(node) is not None]
    for address, nodes in grouped(located, address_of).items():
        known = [context.peripherals.get(node) for node in nodes]
        if len(nodes) < 2 or all(map(_is_usb_host, known)):
            continue
        yield Finding(
            "address-twice",
            **at(nodes[-1], "reg"),
            message=f"{listed(node.path for node in nodes)} are on, all at {address:#x}",
            remedy='Set status = "disabled" in all of them but one',
            claimants=tuple(
                Claimant(node.path, f"the block at {address:#x}", node.place_of("reg")) for node in nodes
            ),
        )


def _is_usb_host(peripheral: Peripheral | None) -> bool:
    return peripheral is not None and peripheral.label.startswith("usbh_")


@rule(
    "stale-node",
    "A node on a bus has no compatible string: it was meant to change another, which has another name.",
    "dtc makes a new node of a name it does not know. The vendor's board files switch off cap0@b0024000, "
    "which is called ccap0 now: nothing is switched off.",
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
            + (f"; {meant.path} is the device meant" if meant else ""),
            remedy=f"Call the node {meant.name}, as the one it changes"
            if meant
            else f"Delete {node.path}, or call it as the node that it was to change",
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


@rule(
    "bus-num-twice",
    "Two enabled controllers of one kind have one bus_num.",
    "The second bus is not registered: its devices are missing. The vendor's 6.6 tree gives 0 to all "
    "three SPI controllers.",
)
def bus_num_twice(context: Context) -> Iterator[Finding]:
    numbered = [
        (node, peripheral.label.rstrip("0123").removeprefix("q"), number)
        for node, peripheral in context.devices.items()
        for number in node.cells("bus_num")[:1]
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
    "A UART is set to PDMA while the PDMA controller is off.",
    "Opening the port fails: the driver asks for a channel and there is none.",
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
                message=f"{peripheral.label} has pdma-enable = <1>, but no PDMA controller is on",
                remedy=f'Set pdma-enable = <0> in {peripheral.label}, or status = "okay" in '
                f"{context.chip.peripherals['dma'].path}",
            )


def _is_uart(peripheral: Peripheral) -> bool:
    return peripheral.compatible[0] == "nuvoton,nuc980-uart"


@rule(
    "missing-property",
    "A device lacks a property that its driver cannot do without.",
    "A UART without port-number, map-addr or pdma-enable does not probe, and the driver calls a missing "
    "pdma-enable a missing map-addr; an I2C or SPI bus without #address-cells gives its devices no "
    "address that dtc checks.",
)
def missing_property(context: Context) -> Iterator[Finding]:
    for node, peripheral in context.devices.items():
        needed = {}
        if _is_uart(peripheral):
            needed = {name: peripheral.properties[name] for name in NEEDED_BY_UART}
        elif "bus_num" in peripheral.properties and any("reg" in child.properties for child in node):
            needed = {"#address-cells": 1, "#size-cells": 0}
        lacks = [name for name in needed if name not in node.properties]
        if lacks:
            yield Finding(
                "missing-property",
                **at(node),
                message=f"{peripheral.label} has no {listed(lacks)}",
                remedy=f"Set {listed(f'{name} = <{_number(needed[name])}>' for name in lacks)} in "
                f"{peripheral.label}",
            )


def _number(value: int) -> str:
    return f"{value:#x}" if value > 9 else str(value)


RULES = (
    wrong_address,
    unit_address,
    wrong_interrupt,
    wrong_compatible,
    address_twice,
    stale_node,
    bus_num_twice,
    pdma_without_dma,
    missing_property,
)
