# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on a device tree against the board's pin table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from nuc980.pins.board import Board
from nuc980.pins.chip import GPIO, Peripheral
from nuc980.pins.claims import PINS, Claim
from nuc980.pins.findings import Finding, Fix, at, valued
from nuc980.pins.rules.context import (
    Context,
    cells_of,
    claimants,
    grouped,
    in_order,
    listed,
    off,
    ranged,
    rule,
    switched_off,
)
from nuc980.pins.tree import Node

TABLE = "the pin table"


def _is_closed(board: Board, pin: str) -> bool:
    """Whether nothing may use a pin; then that alone is found."""
    return pin in board.reserved or pin in board.not_connected


@rule(
    "reserved-pin",
    "A node uses a pin that the pin table calls reserved or not connected.",
    "The pin is wired to something that no device of Linux may drive, or to nothing.",
)
def reserved_pin(context: Context) -> Iterator[Finding]:
    board = context.board
    if board is None:
        return
    for node, claims in context.claims_of.items():
        closed = [claim for claim in claims if _is_closed(board, claim.pin)]
        for name, wrong in grouped(closed, lambda claim: claim.property).items():
            pins = in_order(claim.pin for claim in wrong)
            why = listed(f"{pin} is {board.reserved.get(pin, 'not connected')}" for pin in pins)
            yield Finding(
                "reserved-pin",
                **at(node, name),
                message=f"{context.name(node)} uses {ranged(pins)}, but in {TABLE} {why}",
                remedy=f"Take {ranged(pins)} out of {name} of {context.name(node)}, or correct "
                f"{board.file.name}",
                claimants=claimants(wrong),
                pins=pins,
            )


@rule(
    "table-missing",
    "A device of the pin table is not enabled.",
    "The board has the device, but Linux does not.",
)
def table_missing(context: Context) -> Iterator[Finding]:
    enabled = {peripheral.label for peripheral in context.devices.values()}
    for label, device in context.board.devices.items() if context.board else ():
        if label in enabled:
            continue
        node = next((node for node, found in context.peripherals.items() if found.label == label), None)
        where = at(node, "status") if node else {"node": device.peripheral.path, "place": None}
        yield Finding(
            "table-missing",
            **where,
            message=f"{label} ({device.purpose}) is in {TABLE} and "
            + (off(node) if node else "not in the tree"),
            remedy=f'Set status = "okay" in {context.name(switched_off(node))}'
            if node
            else f"Add the node {device.peripheral.path}",
            fix=valued("status", '"okay"') if node and switched_off(node) is node else None,
        )


@rule(
    "table-disagrees",
    "The pins of a device differ from the pin table.",
    "Either the signal is not where the board has it, or the device drives a pin of unknown wiring, as the "
    "RTS of the vendor's UART groups does.",
)
def table_disagrees(context: Context) -> Iterator[Finding]:
    for node, peripheral in context.devices.items():
        device = context.board.devices.get(peripheral.label) if context.board else None
        claims = context.working_claims(node)
        if device is None or not claims or not context.is_readable(node):
            continue
        has = {claim.signal: claim for claim in claims if claim.signal != GPIO}
        open_signals = [name for name, claim in has.items() if not _is_closed(context.board, claim.pin)]
        extra = [name for name in open_signals if name not in device.pins]
        moved = [name for name in open_signals if device.pins.get(name, has[name].pin) != has[name].pin]
        # A signal that the device cannot do without is found by incomplete-set.
        lacks = [name for name in device.pins if name not in {*has, *_vital_signals(peripheral)}]
        if not (extra or moved or lacks):
            continue
        differences = [f"{name} on {has[name].pin} instead of {device.pins[name]}" for name in moved]
        differences += [f"no {name} on {device.pins[name]}" for name in lacks]
        if extra:
            beyond = listed(f"{name} on {has[name].pin}" for name in extra)
            differences.append(f"{beyond}, which {TABLE} does not have")
        concerned = [has[name] for name in (*moved, *extra)]
        yield Finding(
            "table-disagrees",
            **at(node, claims[0].property),
            message=f"{peripheral.label} has {'; '.join(differences)}",
            remedy=_as_in_table(context, node, device.pins),
            fix=_group_of_table(context, node, device.pins),
            claimants=claimants(concerned or claims),
            pins=in_order([claim.pin for claim in concerned] + [device.pins[name] for name in lacks]),
        )


def _group_of_table(context: Context, node: Node, pins: dict[str, str]) -> Fix | None:
    """The device's one group with the table's pins, if no other node has it."""
    groups = {claim.group for claim in context.muxed(node)}
    [group, *more] = groups
    if more or any(claim.group is group and claim.node is not node for claim in context.claims):
        return None
    cells = ", ".join(cells_of(pin, context.chip.value(pin, signal)) for signal, pin in pins.items())
    return replace(valued(PINS, cells), place=group.place_of(PINS))


def _vital_signals(peripheral: Peripheral) -> set[str]:
    return {prefix + name for prefix, needed in peripheral.signals.items() for name in needed.required}


def _as_in_table(context: Context, node: Node, pins: dict[str, str]) -> str:
    cells = " ".join(
        cells_of(pin, context.chip.value(pin, signal)).strip("<>") for signal, pin in pins.items()
    )
    table = context.board.file.name
    return f"Give {context.name(node)} a group with nuvoton,pins = <{cells}>, or correct {table}"


@rule(
    "left-on",
    "A device that is not in the pin table is enabled, and it takes pins.",
    "The vendor's nuc980.dtsi enables SPI flash, SD card, USB and an interrupt pin by default. Their "
    "drivers drive pins that this board uses for something else, or whose wiring is unknown.",
)
def left_on(context: Context) -> Iterator[Finding]:
    if context.board is None:
        return
    for node in context.claims_of:
        claims = [claim for claim in context.muxed(node) if _is_unknown(context, claim)]
        if not claims or (node in context.devices and not context.is_readable(node)):
            continue
        pins = in_order(claim.pin for claim in claims)
        name = context.name(node)
        yield Finding(
            "left-on",
            **at(node, "status"),
            message=f"{name} is enabled{_by_default(node)} and takes {_taken(context.board, pins)}, "
            f"but it is not in {TABLE}",
            remedy=_switch_off(context, node, claims),
            claimants=claimants(claims),
            pins=pins,
        )


def _is_unknown(context: Context, claim: Claim) -> bool:
    """Whether the table has nothing of the device that a pin's function belongs to."""
    if claim.signal in (None, GPIO) or _is_closed(context.board, claim.pin):
        return False
    peripheral = context.peripherals.get(claim.node)
    owners = [peripheral] if peripheral else context.chip.owners(claim.signal)
    return not any(owner.label in context.board.devices for owner in owners)


def _by_default(node: Node) -> str:
    if "status" not in node.properties:
        return " (it has no status)"
    place = node.place_of("status")
    return f" (by {place})" if place else ""


def _taken(board: Board, pins: Sequence[str]) -> str:
    users = {pin: use[0] for pin in pins if (use := board.use_of(pin))}
    owned = [f"{ranged(its)} of {user}" for user, its in grouped(users, users.get).items()]
    unknown = [pin for pin in pins if pin not in users]
    if unknown:
        owned.append(f"{ranged(unknown)} of unknown wiring")
    return listed(owned)


def _switch_off(context: Context, node: Node, claims: Sequence[Claim]) -> str:
    name = context.name(node)
    peripheral = context.peripherals.get(node)
    # The GPIO controller must stay on.
    off = (
        f"Delete {claims[0].property} of gpio"
        if peripheral and peripheral.label == "gpio"
        else f'Set status = "disabled" in {name}'
    )
    return f"{off}, or add {name} to {context.board.file.name} if the board has it"


@rule(
    "table-gpio",
    "A node uses a GPIO line that is not in the pin table.",
    "Nobody has written down what the line is wired to, or a device of the table has the pin.",
)
def table_gpio(context: Context) -> Iterator[Finding]:
    if context.board is None:
        return
    # A pin that a device has as well is found by mux-and-gpio.
    muxed = {claim.pin for claim in context.claims if claim.muxed and claim.signal != GPIO}
    for node, claims in context.claims_of.items():
        unknown = [
            claim
            for claim in claims
            if claim.signal == GPIO
            and claim.pin in context.chip.pins
            and claim.pin not in context.board.gpios
            and claim.pin not in muxed
            and not _is_closed(context.board, claim.pin)
        ]
        for name, wrong in grouped(unknown, lambda claim: claim.property).items():
            pins = in_order(claim.pin for claim in wrong)
            yield Finding(
                "table-gpio",
                **at(node, name),
                message=f"{context.name(node)} uses {_taken(context.board, pins)} as GPIO, "
                f"which is not in {TABLE}",
                remedy=f"Add {ranged(pins)} under gpios in {context.board.file.name} with what it is "
                f"wired to, or take it out of {name} of {context.name(node)}",
                claimants=claimants(wrong),
                pins=pins,
            )


RULES = (reserved_pin, table_missing, table_disagrees, left_on, table_gpio)
