# SPDX-License-Identifier: GPL-3.0-or-later
"""Random assignments of pins that the chip allows check clean; one random mistake in them is found."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from trees import CHIP, GATEWAY_PINS, MORE, TABLE, built, child, set_cells, set_string

from nuc980.pins.board import Board, Device, load_board
from nuc980.pins.chip import Peripheral, gpio_number
from nuc980.pins.claims import PINS, claims, pin_controller
from nuc980.pins.findings import Finding
from nuc980.pins.generate import generated
from nuc980.pins.importing import import_board
from nuc980.pins.rules import RULES, check
from nuc980.pins.source import read_source
from nuc980.pins.tree import Node, Property, Tree

pytestmark = pytest.mark.slow  # as a whole

BOARD = load_board(TABLE, CHIP)
Assignment = dict[str, dict[str, str]]
# One block each: a smart card and its UART, the USB host. Signals of ccap and sc are many and rarely fit.
CANDIDATES = [
    label
    for label, peripheral in CHIP.peripherals.items()
    if peripheral.needs_pins and not label.startswith(("scuart", "usbh_"))
]


def wanted_signals(peripheral: Peripheral, draw: st.DrawFn) -> list[str]:
    """Signals that one of a peripheral's sets needs, and some that it may have."""
    prefix, needed = draw(st.sampled_from(sorted(peripheral.signals.items())))
    names = list(needed.required)
    if needed.some:
        possible = [name for name in needed.some if prefix + name in CHIP.signals]
        names += draw(st.lists(st.sampled_from(possible), min_size=1, unique=True))
    for together in needed.together:
        names += together if draw(st.booleans()) else ()
    return [prefix + name for name in names]


@st.composite
def assignments(draw: st.DrawFn) -> Assignment:
    """Devices, each with all the signals that it needs, on pins of their own."""
    taken: set[str] = set()
    found: Assignment = {}
    for label in draw(st.lists(st.sampled_from(CANDIDATES), min_size=1, max_size=12, unique=True)):
        pins: dict[str, str] = {}
        for signal in wanted_signals(CHIP.peripherals[label], draw):
            free = [
                pin
                for pin, _ in CHIP.signals.get(signal, ())
                if pin not in taken and pin not in pins.values()
            ]
            if not free:
                break
            pins[signal] = draw(st.sampled_from(free))
        else:
            found[label] = pins
            taken |= set(pins.values())
    assume(found)
    return found


@given(assignments())
@settings(deadline=None, max_examples=30)
def test_what_the_chip_allows_has_no_findings(assignment: Assignment) -> None:
    tree = built(assignment)
    assert check(tree, CHIP) == []
    assert {claim.pin: claim.signal for claim in claims(tree, CHIP)} == {
        pin: signal for pins in assignment.values() for signal, pin in pins.items()
    }


ON = 'status = "okay";'


def table_of(assignment: Assignment) -> Board:
    """A pin table, for the package that brings out every pin."""
    part = "NUC980DF71YC"
    devices = {label: Device(CHIP.peripherals[label], "", pins) for label, pins in assignment.items()}
    return Board(Path("pins.yml"), "random", part, CHIP.packages[CHIP.parts[part]], devices)


@given(assignments())
@settings(deadline=None, max_examples=12)
def test_a_pin_table_comes_back_from_its_device_tree(assignment: Assignment) -> None:
    table = table_of(assignment)
    files = {
        path: text for path, text in generated(CHIP, {"random": table}).items() if path.suffix == ".dtsi"
    }
    with TemporaryDirectory() as name:
        folder = Path(name)
        for path, text in files.items():
            (folder / path.name).write_text(text, encoding="utf-8")
        includes = "".join(f'#include "{path.name}"\n' for path in files)
        switched_on = "".join(f"&{label} {{ {ON} {MORE.get(label, '')} }};\n" for label in assignment)
        source = folder / "random.dts"
        source.write_text(f"/dts-v1/;\n{includes}{switched_on}", encoding="utf-8")
        tree = read_source(source)
        assert check(tree, CHIP, table, table.package) == []
        imported = folder / "pins.yml"
        imported.write_text(import_board(tree, CHIP, table.part), encoding="utf-8")
        back = load_board(imported, CHIP)
    assert {label: device.pins for label, device in back.devices.items()} == assignment


def group_of(tree: Tree, label: str) -> Node:
    found = tree.find(f"{pin_controller(tree).path}/{label}/{label}-pins")
    assert found is not None
    return found


def device_of(tree: Tree, label: str) -> Node:
    found = tree.find(CHIP.peripherals[label].path)
    assert found is not None
    return found


# Each takes a tree, one of its devices, that device's pins and a way to draw; and makes one mistake.
Mistake = Callable[[Tree, str, dict[str, str], st.DataObject], None]


def reserved_value(tree: Tree, label: str, pins: dict[str, str], data: st.DataObject) -> None:
    group = group_of(tree, label)
    cells = group.cells(PINS)
    place = data.draw(st.integers(0, len(pins) - 1))
    pin = list(pins.values())[place]
    cells[4 * place + 2] = data.draw(st.integers(1, 15).filter(lambda value: value not in CHIP.pins[pin]))
    set_cells(group, PINS, *cells)


def pin_that_is_none(tree: Tree, label: str, pins: dict[str, str], data: st.DataObject) -> None:
    group = group_of(tree, label)
    cells = group.cells(PINS)
    place = data.draw(st.integers(0, len(pins) - 1))
    cells[4 * place : 4 * place + 2] = data.draw(
        st.sampled_from([(1, 14), (1, 15), (4, 13), (5, 15), (7, 0), (0, 16)])
    )
    set_cells(group, PINS, *cells)


def cell_lost(tree: Tree, label: str, pins: dict[str, str], data: st.DataObject) -> None:
    group = group_of(tree, label)
    cells = group.cells(PINS)
    del cells[data.draw(st.integers(0, len(cells) - 1))]
    set_cells(group, PINS, *cells)


def line_on_a_muxed_pin(tree: Tree, label: str, pins: dict[str, str], data: st.DataObject) -> None:
    user = child(tree.root, "user")
    set_string(user, "compatible", "acme,user")
    number = gpio_number(data.draw(st.sampled_from(sorted(pins.values()))))
    set_cells(device_of(tree, "gpio"), "phandle", 0x3000)
    set_cells(user, "reset-gpios", 0x3000, number, 0)


def group_lost(tree: Tree, label: str, pins: dict[str, str], data: st.DataObject) -> None:
    set_cells(device_of(tree, label), "pinctrl-0", 0x7777)


def group_of_another(tree: Tree, label: str, pins: dict[str, str], data: st.DataObject) -> None:
    spare = child(child(pin_controller(tree), "spare"), "spare")
    set_cells(spare, PINS, 5, 11, 1, 0)  # UART0_RXD, of the debug console
    set_cells(spare, "phandle", 0x2000)
    other = device_of(tree, "i2c0" if label != "i2c0" else "i2c1")
    set_cells(other, "pinctrl-0", 0x2000)
    set_string(other, "pinctrl-names", "default")
    set_string(other, "status", "okay")


def same_name(tree: Tree, label: str, pins: dict[str, str], data: st.DataObject) -> None:
    spare = child(child(pin_controller(tree), "spare"), f"{label}-pins")
    set_cells(spare, PINS, 5, 11, 0, 0)


def state_unnamed(tree: Tree, label: str, pins: dict[str, str], data: st.DataObject) -> None:
    set_string(device_of(tree, label), "pinctrl-names", data.draw(st.sampled_from(["sleep", "Default", ""])))


def no_group(tree: Tree, label: str, pins: dict[str, str], data: st.DataObject) -> None:
    set_cells(device_of(tree, label), "pinctrl-0")


def interrupt_of_another(tree: Tree, label: str, pins: dict[str, str], data: st.DataObject) -> None:
    node = device_of(tree, label)
    cells = node.cells("interrupts")
    assume(cells)
    cells[0] = data.draw(st.integers(0, 63).filter(lambda source: source != cells[0]))
    set_cells(node, "interrupts", *cells)


def address_of_another(tree: Tree, label: str, pins: dict[str, str], data: st.DataObject) -> None:
    node = device_of(tree, label)
    address, size = node.cells("reg")
    set_cells(node, "reg", address ^ (1 << data.draw(st.integers(8, 30))), size)


def unknown_driver(tree: Tree, label: str, pins: dict[str, str], data: st.DataObject) -> None:
    set_string(device_of(tree, label), "compatible", "nuvoton,nuc980-" + label.upper())


def taken_by_another(tree: Tree, label: str, pins: dict[str, str], data: st.DataObject) -> None:
    other = child(tree.root, "other")
    set_string(other, "compatible", "acme,other")
    set_cells(other, "pinctrl-0", device_of(tree, label).cells("pinctrl-0")[0])
    set_string(other, "pinctrl-names", "default")


def required_signal_lost(tree: Tree, label: str, pins: dict[str, str], data: st.DataObject) -> None:
    peripheral = CHIP.peripherals[label]
    required = [
        index
        for index, signal in enumerate(pins)
        for prefix, needed in peripheral.signals.items()
        if signal.removeprefix(prefix) in needed.required and signal.startswith(prefix)
    ]
    assume(required and len(pins) > 1)
    group = group_of(tree, label)
    cells = group.cells(PINS)
    place = data.draw(st.sampled_from(required))
    set_cells(group, PINS, *cells[: 4 * place], *cells[4 * place + 4 :])


MISTAKES: dict[Mistake, str] = {
    reserved_value: "no-such-function",
    pin_that_is_none: "no-such-pin",
    cell_lost: "cell-count",
    line_on_a_muxed_pin: "mux-and-gpio",
    group_lost: "group-missing",
    group_of_another: "foreign-function",
    same_name: "group-name-twice",
    state_unnamed: "no-default-state",
    no_group: "no-pins",
    interrupt_of_another: "wrong-interrupt",
    address_of_another: "wrong-address",
    unknown_driver: "wrong-compatible",
    taken_by_another: "pin-conflict",
    required_signal_lost: "incomplete-set",
}


@given(assignments(), st.sampled_from(list(MISTAKES)), st.data())
@settings(deadline=None, max_examples=80)
def test_one_mistake_is_found(assignment: Assignment, mistake: Mistake, data: st.DataObject) -> None:
    label = data.draw(st.sampled_from(sorted(assignment)))
    tree = built(assignment)
    mistake(tree, label, assignment[label], data)
    tree = Tree(tree.file, tree.root, tree.from_source)  # with its new phandles
    findings = check(tree, CHIP)
    assert MISTAKES[mistake] in {finding.rule for finding in findings}
    assert all(isinstance(finding, Finding) and finding.remedy for finding in findings)


READ_BY_RULES = [
    "compatible", "status", "reg", "interrupts", "interrupt-parent", "interrupts-extended",
    "#interrupt-cells", "phandle", "pinctrl-names", "pinctrl-0", "pinctrl-1", "nuvoton,pins", "gpios",
    "reset-gpios", "gpio-hog", "gpio-controller", "#gpio-cells", "key-matrix", "gpio-keys-rows",
    "gpio-keys-cols", "eint0-config", "eint3-config", "bus_num", "port-number", "map-addr",
    "pdma-enable", "#address-cells", "rs485-rts-active-high",
]  # fmt: skip
CONTENT = st.one_of(
    st.binary(max_size=9),
    st.lists(st.sampled_from([0, 1, 2, 0x1000, 0x1001, 0xB0071000, 0xFFFFFFFF]), max_size=9).map(
        lambda cells: b"".join(cell.to_bytes(4, "big") for cell in cells)
    ),
    st.sampled_from(
        [b"okay\0", b"nuvoton,nuc980-gpio\0", b"nuvoton,nuc980-pinctrl\0", b"simple-bus\0", b"default\0"]
    ),
)


@given(st.lists(st.tuples(st.integers(0), st.sampled_from(READ_BY_RULES), CONTENT), min_size=1, max_size=12))
@settings(deadline=None, max_examples=40)
def test_whatever_the_properties_hold_is_judged(changes: list[tuple[int, str, bytes]]) -> None:
    tree = built(GATEWAY_PINS)
    nodes = list(tree.root.walk())
    for number, name, content in changes:
        nodes[number % len(nodes)].properties[name] = Property(name, content)
    tree = Tree(tree.file, tree.root, tree.from_source)
    for finding in check(tree, CHIP, BOARD, BOARD.package):
        assert finding.rule in RULES
        assert finding.message and finding.remedy
