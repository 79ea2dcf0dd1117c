# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on pin groups and on the properties that refer to them."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator

from nuc980.pins.chip import BANKS, GPIOS_A_BANK, pin_of_gpio
from nuc980.pins.claims import (
    CELLS_A_PIN,
    KEYS,
    PINS,
    MalformedError,
    gpio_specifiers,
    interrupt_specifiers,
    interrupts_property,
    is_gpio_list,
    is_group,
    key_cells,
    line_specifiers,
    meant_pin,
    settings,
    states,
)
from nuc980.pins.findings import Claimant, Finding, at
from nuc980.pins.rules.context import Context, grouped, is_well_formed, listed, off, rule
from nuc980.pins.tree import CELL, Node

MOST_KEYS = 8  # rows, and columns (nuc980_keys.c, ROW_COL_MAX)
PORT = re.compile(r"P([A-G])(?![A-Za-z])")


@rule(
    "cell-count",
    "A property has the wrong number of cells: nuvoton,pins needs four for each pin, a GPIO list as many as "
    "its controller says, a key matrix its rows and columns.",
    "One such group makes the whole pin controller fail, and with it every device that has a pin group. A "
    "GPIO list is refused, or read one cell off.",
)
def cell_count(context: Context) -> Iterator[Finding]:
    for group in context.groups:
        length = len(group.properties[PINS].raw) if PINS in group.properties else 0
        if length % (CELL * CELLS_A_PIN):
            yield Finding(
                "cell-count",
                **at(group, PINS),
                message=f"the group {group.name} has {_cells(length)}, not a multiple of {CELLS_A_PIN}",
                remedy=f"Write four cells for each pin in {group.name}: bank, pin, function, 0",
            )
    for node in context.enabled:
        for name in filter(is_gpio_list, node.properties):
            try:
                list(gpio_specifiers(context.tree, node, name))
            except MalformedError as error:
                yield Finding(
                    "cell-count",
                    **at(node, name),
                    message=f"{name} of {context.name(node)} cannot be read: {error}",
                    remedy=f"Write {name} as <&gpio NUMBER FLAGS>: the controller, then as many cells as its "
                    "#gpio-cells says (a gpio-hog omits the controller); NUMBER is 32 * bank + pin",
                )
        if node not in context.peripherals:  # of those it is wrong-interrupt
            yield from _odd_interrupts(context, node)
        if KEYS in node.strings("compatible"):
            yield from _short_key_lists(context, node)


def _odd_interrupts(context: Context, node: Node) -> Iterator[Finding]:
    try:
        list(interrupt_specifiers(context.tree, node))
    except MalformedError as error:
        yield Finding(
            "cell-count",
            **at(node, interrupts_property(node)),
            message=f"{context.name(node)} has interrupts {error}",
            remedy=f"Write the interrupts of {context.name(node)} as its interrupt-parent expects them; for "
            "gpio that is <NUMBER FLAGS>",
        )


def _short_key_lists(context: Context, node: Node) -> Iterator[Finding]:
    """Of the vendor's keys: for a cell too few the driver gives up, beyond eight rows it overwrites."""
    wanted = key_cells(node)
    lacks = [f"{name} with {count} cells" for name, count in wanted.items() if len(node.cells(name)) < count]
    if not wanted["key-code"]:
        lacks = ["key-matrix with a number of rows and one of columns"]
    elif any(count > MOST_KEYS for count in node.cells("key-matrix")[:2]):
        lacks = [f"key-matrix with at most {MOST_KEYS} rows and columns"]
    if lacks:
        yield Finding(
            "cell-count",
            **at(node, "key-matrix"),
            message=f"{context.name(node)} needs {listed(lacks)}",
            remedy=f"Write key-matrix = <ROWS COLUMNS> in {context.name(node)}, a GPIO number for each row "
            "in gpio-keys-rows and for each of several columns in gpio-keys-cols, and a code for each key",
        )


def _cells(length: int) -> str:
    return f"{length // CELL} cells" if length % CELL == 0 else f"{length} bytes"


@rule(
    "bank-and-pin",
    "A GPIO line is written as a bank and a pin instead of as one number.",
    "A line has one number, 32 * bank + pin, and the flags follow it. <&gpio 4 11> is not PE11: it is line "
    "4, PA4, with flags that do not exist.",
)
def bank_and_pin(context: Context) -> Iterator[Finding]:
    for node in context.enabled:
        for name in node.properties:
            if not is_gpio_list(name) and name != interrupts_property(node):
                continue
            with contextlib.suppress(MalformedError):  # cell-count
                for specifier in line_specifiers(context.tree, node, name):
                    yield from _bank_and_pin(context, node, name, specifier)


def _bank_and_pin(context: Context, node: Node, name: str, specifier: list[int]) -> Iterator[Finding]:
    pin = meant_pin(specifier, name)
    if pin is None:
        return
    written = " ".join(map(str, specifier))
    number = GPIOS_A_BANK * specifier[0] + specifier[1]
    yield Finding(
        "bank-and-pin",
        **at(node, name),
        message=f"{name} of {context.name(node)} has <{written}>: line {specifier[0]} "
        f"({pin_of_gpio(specifier[0])}) with flags {specifier[1]}, which do not exist; it probably "
        f"means {pin}",
        remedy=f"For {pin} write {number} and the flags; the number is 32 * bank + pin, "
        f"32 * {specifier[0]} + {specifier[1]}",
        pins=(pin,),
    )


@rule(
    "group-name-twice",
    "Two pin groups, or two functions, have the same name before the @.",
    "The vendor's driver looks for a group by that name alone, in all functions, and takes the first. A "
    "device that refers to the second group gets the pins of the first.",
)
def group_name_twice(context: Context) -> Iterator[Finding]:
    functions = list(context.pinctrl or ())
    for kind, nodes in (("groups", context.groups), ("functions", functions)):
        for name, same in grouped(nodes, lambda node: node.base_name).items():
            if len(same) < 2:
                continue
            yield Finding(
                "group-name-twice",
                **at(same[-1]),
                message=f"{len(same)} {kind} are called {name}; a reference to one of them gets the first",
                remedy=f"Give {listed(node.path for node in same[1:])} another name",
                claimants=tuple(Claimant(node.path, f"the name {name}", node.place_of()) for node in same),
            )


@rule(
    "group-missing",
    "A pin state refers to nothing or to a node that is not a pin group, or a group or function is empty.",
    "A device whose group is not found does not probe (-EINVAL). An empty group or function makes the pin "
    "controller fail, and with it every device that has a pin group.",
)
def group_missing(context: Context) -> Iterator[Finding]:
    yield from _bad_references(context)
    for function in context.pinctrl or ():
        if not function.children:
            yield Finding(
                "group-missing",
                **at(function),
                message=f"the function {function.name} has no groups",
                remedy=f"Delete the node {function.path}, or give it a group with {PINS}",
            )
    for group in context.groups:
        if not group.properties.get(PINS) or not group.properties[PINS].raw:
            yield Finding(
                "group-missing",
                **at(group),
                message=f"the group {group.name} has no {PINS}",
                remedy=f"Give {group.path} its pins, four cells each, or delete it",
            )


def _bad_references(context: Context) -> Iterator[Finding]:
    for node in context.enabled:
        for state in states(node):
            faults = list(dict.fromkeys(filter(None, (_fault(context, handle) for handle in state.phandles))))
            if len(node.properties[state.property].raw) % CELL:
                faults.append("a part of a cell")
            if faults:
                yield Finding(
                    "group-missing",
                    **at(node, state.property),
                    message=f"{state.property} of {context.name(node)} refers to {listed(faults)}",
                    remedy=f"Make {state.property} of {context.name(node)} refer to a pin group: a child of "
                    f"a function of {context.pinctrl.path if context.pinctrl else 'the pin controller'}",
                )


def _fault(context: Context, phandle: int) -> str | None:
    target = context.tree.by_phandle.get(phandle)
    if target is None:
        return "a node that does not exist"
    if not is_group(target):
        return f"{target.path}, which is not a pin group"
    controller = target.parent.parent
    if not controller.enabled:
        return f"a group of {controller.path}, which {off(controller)}"
    return None


@rule(
    "no-default-state",
    "A device has pin groups, but no state called default.",
    "The kernel applies only the states called init and default by itself. The pins stay as the boot loader "
    "left them; on this chip, that is GPIO.",
)
def no_default_state(context: Context) -> Iterator[Finding]:
    for node in context.enabled:
        found = list(states(node))
        if any(state.phandles for state in found) and not any(state.name == "default" for state in found):
            names = node.strings("pinctrl-names")
            has = f"only {listed(names)}" if names else "no pinctrl-names"
            yield Finding(
                "no-default-state",
                **at(node, "pinctrl-names" if names else "pinctrl-0"),
                message=f"{context.name(node)} has {has}, so the kernel never applies its pinctrl-0",
                remedy=f'Set pinctrl-names = "default" in {context.name(node)}',
            )


@rule(
    "label-misleads",
    "The label of a pin group names another group, or a port where the group has no pin.",
    "Whoever writes <&pinctrl_uart2_PG> expects these pins; dtc does not compare a label with its node.",
)
def label_misleads(context: Context) -> Iterator[Finding]:
    names = {_plain(group.name): group for group in context.groups}
    for group in context.groups:
        pins = settings(group)
        ports = {BANKS[bank] for bank, _, _ in pins if bank < len(BANKS)}
        for label in group.labels:
            meant = _plain(label.removeprefix("pinctrl_"))
            told = set(PORT.findall(label.replace("_", "-")))
            if names.get(meant, group) is not group:
                what = f"names the group {names[meant].name}"
            elif is_well_formed(group) and told and not told & ports:
                what = (
                    f"names port {listed(sorted(told))}, but its pins are on "
                    f"{listed(sorted(ports) or ['none'])}"
                )
            else:
                continue
            yield Finding(
                "label-misleads",
                **at(group),
                message=f"the label {label} of the group {group.name} {what}",
                remedy=f"Rename the label {label} after its node, and check every place that uses it",
            )


def _plain(name: str) -> str:
    return name.replace("_", "-").casefold()


RULES = (cell_count, bank_and_pin, group_name_twice, group_missing, no_default_state, label_misleads)
