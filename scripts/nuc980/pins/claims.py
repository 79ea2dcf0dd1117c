# SPDX-License-Identifier: GPL-3.0-or-later
"""Who wants which pin: what the enabled nodes of a device tree ask for, as the vendor's drivers read it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count

from nuc980.pins.chip import BANKS, GPIO, PINS_A_BANK, Chip, pin_name, pin_of_gpio
from nuc980.pins.tree import Node, Place, Tree

PINCTRL = "nuvoton,nuc980-pinctrl"
GPIO_CONTROLLER = "nuvoton,nuc980-gpio"
KEYS = "nuvoton,nuc980-keys"
BUSES = ("simple-bus", "simple-mfd")  # of these the kernel makes devices of the children (of/platform.c)
PINS = "nuvoton,pins"
# Of a line, dt-bindings/gpio/gpio.h: active low, open source, open drain. Transitory (8) says that a line
# loses its level in sleep, which none of this chip does.
LINE_FLAGS = (0, 1, 2, 3, 6, 7)
TRIGGERS = (0, 1, 2, 3, 4, 8)  # of an interrupt, dt-bindings/interrupt-controller/irq.h
CELLS_A_PIN = 4  # bank, pin, value of the multi-function field, a fourth that no driver reads


@dataclass(frozen=True)
class Claim:
    """A node that wants a pin."""

    pin: str  # "PA0"; "P7.0" for one that no bank has
    node: Node
    signal: str | None  # GPIO for a GPIO line; None: the pin does not exist, or not with this value
    value: int  # of the pin's multi-function field; 0 for a GPIO line
    group: Node | None  # the pin group that says so; None for a GPIO line
    property: str  # of the node: "pinctrl-0", "reset-gpios"
    place: Place | None

    @property
    def muxed(self) -> bool:
        """Whether the pin controller switches the pin for this node; a GPIO line alone switches nothing."""
        return self.group is not None

    @property
    def interrupts(self) -> bool:
        """Whether the line is wanted for its interrupt."""
        return self.property in ("interrupts", "interrupts-extended")


@dataclass(frozen=True)
class State:
    """One of a node's pin states."""

    name: str
    property: str  # "pinctrl-0"
    phandles: tuple[int, ...]


class MalformedError(ValueError):
    """A property whose cells do not fit what they refer to; says in what way."""


def claims(tree: Tree, chip: Chip) -> list[Claim]:
    """
    What the enabled nodes want, in the order of the tree: pins of their groups, GPIO lines, interrupts of
    GPIO lines. A group is the one that the node refers to, also where the kernel would take another of the
    same name; what cannot be read is left out: the rules report both.
    """
    return [
        claim for node in enabled_nodes(tree) for claim in (*_muxed(tree, chip, node), *_lines(tree, node))
    ]


def enabled_nodes(tree: Tree) -> list[Node]:
    """The nodes that the kernel looks at: none that is off, none on a bus without compatible."""
    return list(_walk_enabled(tree.root))


def _walk_enabled(node: Node) -> Iterator[Node]:
    if not node.enabled or node.is_note or node.path == "/aliases":  # the names there are nobody's properties
        return
    if on_bus(node) and "compatible" not in node.properties:
        return
    yield node
    for child in node:
        yield from _walk_enabled(child)


def on_bus(node: Node) -> bool:
    """Whether a node is a device at an address of the chip: a child of a simple bus."""
    return node.parent is not None and not set(BUSES).isdisjoint(node.parent.strings("compatible"))


# ---- pins of groups ------------------------------------------------------------------------------


def states(node: Node) -> Iterator[State]:
    """A node's pin states; the kernel stops at the first number that is missing."""
    names = node.strings("pinctrl-names")
    for number in count():
        found = node.properties.get(f"pinctrl-{number}")
        if found is None:
            return
        name = names[number] if number < len(names) else str(number)
        yield State(name, found.name, tuple(found.cells or ()))


def pin_controller(tree: Tree) -> Node | None:
    """The pin controller's node; None: the tree has none."""
    return next((node for node in tree.root.walk() if PINCTRL in node.strings("compatible")), None)


def is_group(node: Node) -> bool:
    """Whether a node is a pin group: a child of a child of the pin controller."""
    controller = node.parent.parent if node.parent else None
    return controller is not None and PINCTRL in controller.strings("compatible")


def settings(group: Node) -> list[tuple[int, int, int]]:
    """Bank, pin and value of each pin of a group; none when its cells are no multiple of four."""
    cells = group.cells(PINS)
    if len(cells) % CELLS_A_PIN:
        return []
    return [tuple(cells[i : i + 3]) for i in range(0, len(cells), CELLS_A_PIN)]


def _muxed(tree: Tree, chip: Chip, node: Node) -> Iterator[Claim]:
    for state in states(node):
        for group in filter(None, map(tree.by_phandle.get, state.phandles)):
            if not is_group(group):
                continue
            for bank, index, value in settings(group):
                pin = pin_name(bank, index)
                signal = chip.signal(pin, value)
                yield Claim(pin, node, signal, value, group, state.property, node.place_of(state.property))


# ---- GPIO lines ----------------------------------------------------------------------------------


def _lines(tree: Tree, node: Node) -> Iterator[Claim]:
    for name in node.properties:
        try:
            numbers = list(_line_numbers(tree, node, name))
        except MalformedError:
            continue
        for number in numbers:
            yield Claim(pin_of_gpio(number), node, GPIO, 0, None, name, node.place_of(name))


def _line_numbers(tree: Tree, node: Node, name: str) -> Iterator[int]:
    """The numbers of the chip's GPIO lines that a property names, but for what means a bank and a pin."""
    if is_gpio_list(name) or name == interrupts_property(node):
        for specifier in line_specifiers(tree, node, name):
            if meant_pin(specifier, name) is None:
                yield specifier[0]
    elif name in ("gpio-keys-rows", "gpio-keys-cols") and KEYS in node.strings("compatible"):
        yield from _key_lines(node, name)


def line_specifiers(tree: Tree, node: Node, name: str) -> Iterator[list[int]]:
    """Of a list of GPIO lines or interrupts: the specifiers that are the chip's GPIO controller's."""
    read = gpio_specifiers(tree, node, name) if is_gpio_list(name) else interrupt_specifiers(tree, node)
    for controller, specifier in read:
        if GPIO_CONTROLLER in controller.strings("compatible"):
            yield specifier


def meant_pin(specifier: Sequence[int], name: str) -> str | None:
    """
    The pin that <4 11> means to its author, bank and pin: line 4 with flags that nothing has; None for what
    can be a number and its flags.
    """
    number, flags = (*specifier, 0)[:2]
    known = LINE_FLAGS if is_gpio_list(name) else TRIGGERS
    if number < len(BANKS) and flags < PINS_A_BANK and flags not in known:
        return pin_name(number, flags)
    return None


def is_gpio_list(name: str) -> bool:
    """Whether a property of this name lists GPIO lines (the kernel's gpio.txt; of spi-gpio the old names)."""
    if name in ("gpio", "gpios", "gpio-sck", "gpio-mosi", "gpio-miso"):
        return True
    return name.endswith(("-gpio", "-gpios")) and not name.endswith("nr-gpios")


def gpio_specifiers(tree: Tree, node: Node, name: str) -> Iterator[tuple[Node, list[int]]]:
    """Controller and specifier of each GPIO of a property; raises MalformedError for what does not fit."""
    found = node.properties[name].cells
    if found is None:
        raise MalformedError("its length is not a multiple of four bytes")
    cells = list(found)
    hog = node.parent if "gpio-hog" in node.properties else None
    while cells:
        controller = hog
        if controller is None:
            phandle = cells.pop(0)
            if phandle == 0:  # an optional line that is not there
                continue
            controller = tree.by_phandle.get(phandle)
        if controller is None or "gpio-controller" not in controller.properties:
            raise MalformedError("a cell that should refer to a GPIO controller does not")
        size = _size(controller, "#gpio-cells")
        if len(cells) < size:
            raise MalformedError(f"{controller.path} needs {size} cells a line; the last has {len(cells)}")
        yield controller, cells[:size]
        del cells[:size]


def interrupts_property(node: Node) -> str:
    """The property that the kernel takes a node's interrupts from: it tries the longer name first."""
    return "interrupts-extended" if "interrupts-extended" in node.properties else "interrupts"


def interrupt_specifiers(tree: Tree, node: Node) -> Iterator[tuple[Node, list[int]]]:
    """Controller and specifier of each interrupt of a node; raises MalformedError for what does not fit."""
    name = interrupts_property(node)
    cells = list(node.cells(name))
    parent = None if name == "interrupts-extended" else interrupt_parent(tree, node)
    while cells:
        controller = parent or (tree.by_phandle.get(cells.pop(0)) if name != "interrupts" else None)
        if controller is None:
            raise MalformedError("that belong to no interrupt controller")
        size = _size(controller, "#interrupt-cells")
        if len(cells) < size:
            raise MalformedError(f"of {len(node.cells(name))} cells, not a multiple of {size}")
        yield controller, cells[:size]
        del cells[:size]


def interrupt_parent(tree: Tree, node: Node) -> Node | None:
    """
    Where a node's interrupts go, as the kernel looks for it (of_irq_find_parent); None: nowhere, or round in
    circles, where the kernel hangs.
    """
    above: Node | None = node
    passed: set[Node] = set()
    while above and above not in passed:
        passed.add(above)
        named = above.cells("interrupt-parent")
        above = tree.by_phandle.get(named[0]) if named else above.parent
        if above and "#interrupt-cells" in above.properties:
            return above
    return None


def _size(controller: Node, name: str) -> int:
    """Cells of a specifier; the vendor's GPIO driver has two."""
    return next((size for size in controller.cells(name) if size), 2)


def _key_lines(node: Node, name: str) -> list[int]:
    return node.cells(name)[: key_cells(node)[name]]


def key_cells(node: Node) -> dict[str, int]:
    """
    Property of the vendor's keys: how many of its cells the driver reads. key-matrix is <rows columns>; with
    one column, the columns' lines are not read.
    """
    rows, columns = (*node.cells("key-matrix"), 0, 0)[:2]
    return {
        "gpio-keys-rows": rows,
        "gpio-keys-cols": columns if columns > 1 else 0,
        "key-code": rows * columns,
    }
