# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on device nodes against the chip: addresses, interrupts, drivers, and what several of them share."""

from __future__ import annotations

import contextlib
import difflib
import re
from collections.abc import Iterator

from nuc980.pins.chip import Peripheral
from nuc980.pins.claims import (
    BUSES,
    MalformedError,
    gpio_specifiers,
    interrupt_specifiers,
    interrupts_property,
    is_gpio_list,
    on_bus,
)
from nuc980.pins.findings import Claimant, Finding, at
from nuc980.pins.rules.context import Context, grouped, listed, rule
from nuc980.pins.rules.identity import (
    NUMBERS,
    address_of,
    has_driver_name,
    interrupt_sources,
    names_of,
    unit_number,
)
from nuc980.pins.tree import Node

STATUS = re.compile(r"okay|ok|disabled|reserved|fail(-.*)?")
INTERRUPT_CELLS = 3  # of the AIC; the kernels read the first, 6.6 the second as the trigger
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


@rule(
    "wrong-address",
    "A device is at an address that is not its own.",
    "The driver writes to registers of another block, or to none; an access outside every block stops "
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
            there, found = [], "has a reg without size"
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
        # The GPIO driver has its seven sources built in; the vendor's trees name one of them.
        has = None if not right or peripheral.label == "gpio" else _wrong_interrupts(context, node, right)
        if has is None:
            continue
        names = listed(
            f"{source} ({name})" for source, name in zip(right, peripheral.interrupts, strict=True)
        )
        yield Finding(
            "wrong-interrupt",
            **at(node, interrupts_property(node)),
            message=f"{peripheral.label} has {has}; its own is {names}",
            remedy=f"Set interrupts = {', '.join(f'<{source} 4 1>' for source in right)} in "
            f"{peripheral.label}, and interrupt-parent in the root to the AIC",
        )


def _wrong_interrupts(context: Context, node: Node, right: list[int]) -> str | None:
    """What is wrong with a device's interrupts; None: nothing."""
    if not node.cells(interrupts_property(node)):
        return "no interrupts"
    try:
        found = list(interrupt_specifiers(context.tree, node))
    except MalformedError as error:
        return f"interrupts {error}"
    for controller, cells in found:
        peripheral = context.peripherals.get(controller)
        if peripheral is None or peripheral.label != "aic":
            return f"interrupts of {context.name(controller)}, not of the AIC"
        if len(cells) != INTERRUPT_CELLS:
            return f"interrupts of {len(cells)} cells by #interrupt-cells of the AIC, not {INTERRUPT_CELLS}"
    sources = [cells[0] for _, cells in found]
    if sources == right:
        return None
    names = {source: name for name, source in context.chip.interrupts.items()}
    return listed(f"interrupt {source} ({names.get(source, 'no source')})" for source in sources)


@rule(
    "controller-off",
    "A controller is off, or never becomes a device, whose lines or interrupts others use.",
    "A driver that asks for a line of it waits for ever (-EPROBE_DEFER); without the AIC no device has an "
    "interrupt.",
)
def controller_off(context: Context) -> Iterator[Finding]:
    on = set(context.enabled)
    users: dict[Node, list[Node]] = {}
    for node in context.enabled:
        for controller in _controllers(context, node):
            if controller not in on and node is not controller:
                users.setdefault(controller, []).append(node)
    for controller, its in users.items():
        names = [context.name(node) for node in its]
        yield Finding(
            "controller-off",
            **at(controller, "status"),
            message=f"{context.name(controller)} is off, but {listed(names)} "
            f"{'use' if len(names) > 1 else 'uses'} it",
            remedy=f'Set status = "okay" in {controller.path} and all above it',
            claimants=tuple(
                Claimant(node.path, f"lines or interrupts of {context.name(controller)}", node.place_of())
                for node in its
            ),
        )


def _controllers(context: Context, node: Node) -> Iterator[Node]:
    """The controllers of a node's GPIO lines and interrupts, each once; none that cannot be read."""
    found: dict[Node, None] = {}
    for name in filter(is_gpio_list, node.properties):
        with contextlib.suppress(MalformedError):
            found |= dict.fromkeys(controller for controller, _ in gpio_specifiers(context.tree, node, name))
    with contextlib.suppress(MalformedError):
        found |= dict.fromkeys(controller for controller, _ in interrupt_specifiers(context.tree, node))
    yield from found


@rule(
    "no-bus",
    "Devices of the chip are under a node of which the kernel does not make a bus.",
    "The kernel looks only at children of simple-bus and simple-mfd, and gives them registers only where "
    "ranges says how: these devices are in the tree and never in the system.",
)
def no_bus(context: Context) -> Iterator[Finding]:
    names = {name for one in context.chip.peripherals.values() for name in names_of(one)}
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
        return f"is no {BUSES[0]}"
    if "ranges" not in bus.properties:
        return "has no ranges"
    if bus.cells("ranges")[:1] != bus.cells("ranges")[1:2]:
        return "has ranges that move addresses"
    wrong = [name for name in ("#address-cells", "#size-cells") if bus.cells(name) not in ([], [1])]
    return f"has {listed(f'{name} = <{bus.cells(name)[0]}>' for name in wrong)}" if wrong else None


@rule(
    "unknown-status",
    "A status that the specification does not know.",
    'For the kernel whatever is not "okay" or "ok" is off: with "enabled" or "Okay" the device is missing, '
    "and nothing is logged.",
)
def unknown_status(context: Context) -> Iterator[Finding]:
    for node in context.tree.root.walk():
        values = node.strings("status")
        if "status" not in node.properties or (len(values) == 1 and STATUS.fullmatch(values[0])):
            continue
        said = ", ".join(f'"{value}"' for value in values) or "no string"
        yield Finding(
            "unknown-status",
            **at(node, "status"),
            message=f"status of {context.name(node)} is {said}",
            remedy='Write "okay" or "disabled"',
        )


@rule(
    "wrong-number",
    "A number by which the driver knows which of several devices it has is another's.",
    "port-number chooses clock and port of a UART, map-addr its registers, id the channels of a PWM: with "
    "another's, the driver works on the wrong block, and a second port of one number overwrites the first.",
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
                message=f"{peripheral.label} has {name} = <{told}>; its own is {_number(own)}",
                remedy=f"Set {name} = <{_number(own)}> in {peripheral.label}",
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
    "pdma-enable a missing map-addr; without bus_freq the I2C "
    "driver divides by zero; an I2C or SPI bus without #address-cells gives its devices no "
    "address that dtc checks.",
)
def missing_property(context: Context) -> Iterator[Finding]:
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
            )


def _number(value: int) -> str:
    return f"{value:#x}" if value > 9 else str(value)


RULES = (
    wrong_address,
    unit_address,
    wrong_interrupt,
    controller_off,
    no_bus,
    unknown_status,
    wrong_number,
    wrong_compatible,
    address_twice,
    stale_node,
    bus_num_twice,
    pdma_without_dma,
    missing_property,
)
