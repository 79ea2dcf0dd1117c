# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on interrupts, and on the controllers of interrupts and lines."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from nuc980.pins.chip import AIC
from nuc980.pins.claims import (
    MalformedError,
    gpio_specifiers,
    interrupt_specifiers,
    interrupts_property,
    is_gpio_list,
)
from nuc980.pins.findings import Claimant, Finding, at, valued
from nuc980.pins.rules.context import Context, listed, off, rule, switched_off
from nuc980.pins.rules.identity import interrupt_sources
from nuc980.pins.tree import Node

INTERRUPT_CELLS = 3  # of the AIC; the kernels read the first, 6.6 and ours the second as the trigger
HIGH_LEVEL = 4
TRIGGERS = {
    0: "no trigger",
    1: "a rising edge",
    2: "a falling edge",
    3: "both edges",
    8: "a low level",
}  # dt-bindings/interrupt-controller/irq.h


@rule(
    "wrong-interrupt",
    "The interrupts of a device are not those of its block.",
    "The driver waits for the interrupts of another block: the device hangs, and the other block may lose "
    "its interrupt. The order counts: the Ethernet drivers take the first one for sending.",
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
            message=f"{peripheral.label} has {has}; it should have {names}",
            remedy=f"Set interrupts = {', '.join(f'<{source} 4 1>' for source in right)} in "
            f"{peripheral.label}, and interrupt-parent in the root to the AIC",
            fix=valued("interrupts", ", ".join(f"<{source} {HIGH_LEVEL} 1>" for source in right)),
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
        if not _is_aic(context, controller):
            return f"interrupts of {context.name(controller)}, not of the AIC"
        if len(cells) != INTERRUPT_CELLS:
            return f"interrupts of {len(cells)} cells (#interrupt-cells of the AIC), not of {INTERRUPT_CELLS}"
    sources = [cells[0] for _, cells in found]
    if sources == right:
        return None
    names = {source: name for name, source in context.chip.interrupts.items()}
    return listed(f"interrupt {source} ({names.get(source, 'no source')})" for source in sources)


@rule(
    "wrong-trigger",
    "The interrupt of a device is not triggered by a high level.",
    "The sources of the AIC are levels: a device holds its level until it is served. Our kernel refuses "
    "every other trigger (-EINVAL), for a port when it is opened; the vendor's 5.10 does not check.",
)
def wrong_trigger(context: Context) -> Iterator[Finding]:
    for node in context.enabled:
        with contextlib.suppress(MalformedError):
            wrong = [
                cells
                for controller, cells in interrupt_specifiers(context.tree, node)
                if _is_aic(context, controller) and len(cells) == INTERRUPT_CELLS and cells[1] != HIGH_LEVEL
            ]
            if not wrong:
                continue
            what = listed(f"{cells[0]} as {TRIGGERS.get(cells[1], f'trigger {cells[1]}')}" for cells in wrong)
            yield Finding(
                "wrong-trigger",
                **at(node, interrupts_property(node)),
                message=f"{context.name(node)} has interrupt {what}; sources of the AIC are high levels",
                remedy=f"Write {listed(f'<{cells[0]} {HIGH_LEVEL} 1>' for cells in wrong)} in "
                f"{interrupts_property(node)} of {context.name(node)}",
                fix=valued("interrupts", ", ".join(f"<{cells[0]} {HIGH_LEVEL} 1>" for cells in wrong))
                if len(wrong) * INTERRUPT_CELLS == len(node.cells("interrupts"))
                else None,
            )


def _is_aic(context: Context, controller: Node) -> bool:
    peripheral = context.peripherals.get(controller)
    return peripheral is not None and peripheral.label == AIC


@rule(
    "controller-off",
    "Other nodes use the lines or interrupts of a controller that is disabled, or that never becomes a "
    "device.",
    "A driver that asks for one of the lines waits for ever (-EPROBE_DEFER). Without the AIC no device has "
    "an interrupt.",
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
            message=f"{context.name(controller)} {off(controller)}, but {listed(names)} "
            f"{'use' if len(names) > 1 else 'uses'} it",
            remedy=f'Set status = "okay" in {switched_off(controller).path}',
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


RULES = (wrong_interrupt, wrong_trigger, controller_off)
