# SPDX-License-Identifier: GPL-3.0-or-later
"""What is made from chip data and pin table: device trees, the pins of Linux and of the emulated chip."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from nuc980.boards import table_path
from nuc980.pins.board import Board, Device
from nuc980.pins.chip import BANKS, PINS_A_BANK, Chip, Peripheral, pin_order

TEMPLATES = Path(__file__).parent / "templates"
SOC_FILE = Path("dts/nuvoton/nuc980.dtsi")
ROUTING_FILE = Path("board/nuc980/qemu/include/hw/misc/nuc980_pins_table.h")
LINUX_FILE = Path("board/nuc980/linux/drivers/pinctrl/nuvoton/pinctrl-nuc980-pins.h")

# What other nodes refer to, or what is on in every system: without a status, so on.
ALWAYS_ON = ("aic", "pinctrl", "gpio")


@dataclass(frozen=True)
class Setting:
    """A pin of a group, as the vendor's driver wants it: four cells, the last never read."""

    cells: str
    pin: str
    signal: str


def pins_file(board: str) -> Path:
    """The pin groups of a board, from the tree's root."""
    return Path(f"dts/nuvoton/nuc980-{board}-pins.dtsi")


def generated(chip: Chip, boards: Mapping[str, Board]) -> dict[Path, str]:
    """Path from the tree's root: the file's text. `boards` has each board's pin table by the board's name."""
    templates = _templates()
    described = [one for one in chip.peripherals.values() if one.has_driver]
    return {
        SOC_FILE: templates.get_template("nuc980.dtsi.j2").render(
            chip=chip,
            buses={bus: _of_bus(described, bus) for bus in ("apb", "ahb")},
            without_registers=[one for one in described if one.address is None],
            always_on=ALWAYS_ON,
        ),
        **{pins_file(name): _pin_groups(templates, chip, name, board) for name, board in boards.items()},
        ROUTING_FILE: templates.get_template("nuc980_pins_table.h.j2").render(
            banks=[f"P{letter}" for letter in BANKS],
            functions=[
                (*pin_order(pin), sorted(functions.items()))
                for pin, functions in sorted(chip.pins.items(), key=lambda one: pin_order(one[0]))
            ],
            owners=sorted(_owners(chip).items()),
            boards=[_wiring(chip, name, board) for name, board in boards.items()],
        ),
        LINUX_FILE: templates.get_template("pinctrl-nuc980-pins.h.j2").render(
            functions=1 + max(value for functions in chip.pins.values() for value in functions),
            pins=[
                _linux_pin(pin, functions)
                for pin, functions in sorted(chip.pins.items(), key=lambda one: pin_order(one[0]))
            ],
        ),
    }


def _pin_groups(templates: Environment, chip: Chip, name: str, board: Board) -> str:
    return templates.get_template("pins.dtsi.j2").render(
        board=board,
        table=table_path(name),
        groups={label: list(_settings(chip, device)) for label, device in board.devices.items()},
    )


def _wiring(chip: Chip, name: str, board: Board) -> dict[str, Any]:
    """What the emulated chip knows of a board."""
    return {
        "name": name,
        "wired": sorted(
            (*pin_order(pin), signal)
            for device in board.devices.values()
            for signal, pin in device.pins.items()
        ),
        "closed": sorted((*pin_order(pin), _c_string(why)) for pin, why in _closed(chip, board).items()),
    }


def write(files: dict[Path, str], root: Path) -> list[Path]:
    """Writes the files that are not so already; returns their paths."""
    changed = stale(files, root)
    for path in changed:
        (root / path).write_text(files[path], encoding="utf-8")
    return changed


def stale(files: dict[Path, str], root: Path) -> list[Path]:
    """The files below root that are missing or have another text."""
    return [
        path
        for path, text in files.items()
        if not (root / path).is_file() or (root / path).read_text(encoding="utf-8") != text
    ]


def _templates() -> Environment:
    templates = Environment(
        loader=FileSystemLoader(TEMPLATES),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    templates.filters["hex"] = "0x{:x}".format
    templates.filters["property"] = _property
    templates.filters["comment"] = _comment
    return templates


def _linux_pin(pin: str, functions: dict[int, str]) -> list[str]:
    """An entry's lines: a tab is as wide as eight characters there, and no line wider than 80."""
    bank, index = pin_order(pin)
    names = [f'"{functions[value]}"' if value in functions else "NULL" for value in range(max(functions) + 1)]
    entry = f'NUC980_PIN({bank * PINS_A_BANK + index}, "{pin}", {", ".join(names)}),'
    first, *more = textwrap.wrap(entry, 80 - 8, subsequent_indent=" " * len("NUC980_PIN("))
    indent = "\t\t" + " " * (len("NUC980_PIN(") - 8)
    return [f"\t{first}", *(indent + line.lstrip() for line in more)]


def _of_bus(peripherals: list[Peripheral], bus: str) -> list[Peripheral]:
    return [one for one in peripherals if one.bus == bus and one.address is not None]


def _settings(chip: Chip, device: Device) -> Iterator[Setting]:
    for signal, pin in device.pins.items():
        bank, index = pin_order(pin)
        yield Setting(f"{bank} {index} {chip.value(pin, signal)} 0", pin, signal)


def _owners(chip: Chip) -> dict[str, str]:
    """Prefix of signals: the labels of whose they are; a smart card's are those of two."""
    labels: dict[str, list[str]] = {}
    for label, peripheral in chip.peripherals.items():
        for prefix in peripheral.signals:
            labels.setdefault(prefix, []).append(label)
    return {prefix: " or ".join(names) for prefix, names in labels.items()}


def _closed(chip: Chip, board: Board) -> dict[str, str]:
    """Pin: why nothing may use it."""
    hidden = dict.fromkeys(
        chip.pins.keys() - board.package.bonded, f"not brought out by {board.package.name}"
    )
    reserved = {pin: f"reserved: {use}" for pin, use in board.reserved.items()}
    return hidden | reserved | dict.fromkeys(board.not_connected, "not connected")


def _c_string(text: str) -> str:
    """A literal that leaves its line of C below 80 characters; json's escapes are among C's."""
    return json.dumps(textwrap.shorten(text, 47, placeholder=" ..."), ensure_ascii=False)


def _comment(text: str) -> str:
    """On one line, and without the end of a comment: a board may be called anything."""
    return " ".join(text.split()).replace("*/", "* /")


def _property(value: int | list[int], name: str) -> str:
    """name = <value>; addresses in hexadecimal."""
    numbers = value if isinstance(value, list) else [value]
    return f"{name} = <{' '.join(hex(n) if name == 'map-addr' else str(n) for n in numbers)}>;"
