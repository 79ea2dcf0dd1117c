# SPDX-License-Identifier: GPL-3.0-or-later
"""The pin table of a board: pins.yml, and what it says about the chip's pins."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import yaml

from nuc980.errors import UnusableInput
from nuc980.pins.chip import GPIO, Chip, Package, Peripheral, YamlLoader
from nuc980.pins.limits import Limits, load_limits

KEYS = {
    "board",
    "part",
    "limits",
    "flash",
    "console",
    "ethernet",
    "devices",
    "gpios",
    "reserved",
    "not_connected",
    "accepted",
}


@dataclass(frozen=True)
class Device:
    """A peripheral that the board uses, and the pins it has there."""

    peripheral: Peripheral
    purpose: str
    pins: dict[str, str]  # signal, in full: pin


@dataclass(frozen=True)
class Accepted:
    """A finding that the board's people know of."""

    rule: str
    node: str  # path
    reason: str


@dataclass(frozen=True)
class Board:
    """One pin table."""

    file: Path
    name: str
    part: str
    package: Package
    devices: dict[str, Device]  # by the peripheral's label
    gpios: dict[str, str] = field(default_factory=dict)  # pin: what for
    reserved: dict[str, str] = field(default_factory=dict)  # pin: what it is wired to
    not_connected: frozenset[str] = frozenset()
    accepted: tuple[Accepted, ...] = ()
    limits: Limits | None = None  # None: the sizes of memory and flash are not known
    flash: str | None = None  # label of the device that the flash is at
    console: str | None = None  # label of its port
    ethernet: tuple[str, ...] = ()  # labels of the ports, eth0 first

    def use_of(self, pin: str) -> tuple[str, str] | None:
        """Who has a pin, and as what: ("uart1", "UART1_RXD"), ("gpios", "GPIO"); None: nobody."""
        for label, device in self.devices.items():
            for signal, its_pin in device.pins.items():
                if its_pin == pin:
                    return label, signal
        return ("gpios", GPIO) if pin in self.gpios else None


def load_board(file: Path, chip: Chip) -> Board:
    """
    A pin table that fits the chip: each device, signal and pin exists, a signal is on a pin that can carry
    it, and no pin is used twice. Raises UnusableInput with every mistake of the table, one a line.
    """
    try:
        data = yaml.load(file.read_text(encoding="utf-8"), Loader=_Loader)
    except OSError as error:
        raise UnusableInput(f"{file}: {error.strerror}; name another pin table with --table") from error
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise UnusableInput(f"{file} is not YAML: {error}") from error
    return _Reader(file, chip).read(data)


class _Loader(YamlLoader):
    """YAML whose keys are given once: PyYAML keeps the last of several, and other pins are lost."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                problem = f"{key.value} appears twice"
                raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


class _Reader:
    """Collects the mistakes of a table instead of stopping at the first."""

    def __init__(self, file: Path, chip: Chip) -> None:
        self.file = file
        self.chip = chip
        self.mistakes: list[str] = []
        self.users: dict[str, str] = {}  # pin: who has it

    def read(self, data: Any) -> Board:
        table = self._mapping(data, "the table")
        for key in table.keys() - KEYS:
            self._mistake(f"{key}: no such key; known keys are {', '.join(sorted(KEYS))}")
        part = str(table.get("part", ""))
        if part not in self.chip.parts:
            self._mistake(f"part {part or 'is missing'}; known parts are {', '.join(self.chip.parts)}")
            self._give_up()
        board = Board(
            file=self.file,
            name=str(table.get("board", self.file.stem)),
            part=part,
            package=self.chip.packages[self.chip.parts[part]],
            devices=dict(self._devices(self._mapping(table.get("devices"), "devices"))),
            gpios=self._pins_with_text(table, "gpios"),
            reserved=self._pins_with_text(table, "reserved"),
            not_connected=self._not_connected(table.get("not_connected")),
            accepted=tuple(self._accepted(table.get("accepted"))),
            limits=self._limits(table.get("limits")),
            flash=self._one_device(table, "flash"),
            console=self._one_device(table, "console"),
            ethernet=tuple(self._named_devices(table, "ethernet", table.get("ethernet") or [])),
        )
        self._check_bonded(board.package)
        if self.mistakes:
            self._give_up()
        return board

    def _devices(self, devices: dict[str, Any]) -> Iterator[tuple[str, Device]]:
        for label, entry in devices.items():
            peripheral = self.chip.peripherals.get(label)
            if peripheral is None:
                self._mistake(
                    f"devices: {label}: the chip has no such device{near(label, self.chip.peripherals)}"
                )
                continue
            entry = self._mapping(entry, label)
            for key in entry.keys() - {"for", "pins"}:
                self._mistake(f"{label}: {key}: no such key; known keys are for and pins")
            pins: dict[str, str] = {}
            for signal, pin in self._signals(peripheral, self._mapping(entry.get("pins"), f"{label}: pins")):
                if signal in pins:
                    self._mistake(f"{label}: {signal} is on two pins, {pins[signal]} and {pin}")
                pins[signal] = pin
            yield label, Device(peripheral, str(entry.get("for", "")), pins)

    def _signals(self, peripheral: Peripheral, pins: dict[str, Any]) -> Iterator[tuple[str, str]]:
        for short, pin in pins.items():
            signal = self._full_signal(peripheral, short)
            if signal is None:
                prefixes = " or ".join(peripheral.signals) or "none"
                self._mistake(
                    f"{peripheral.label}: {short} is not one of its signals; they begin with {prefixes}"
                )
            elif self._exists(pin, f"{peripheral.label}: {short}"):
                if self.chip.value(pin, signal) is None:
                    where = ", ".join(name for name, _ in self.chip.signals[signal])
                    self._mistake(f"{peripheral.label}: {pin} cannot be {signal}; that is on {where}")
                self._take(pin, f"{peripheral.label} {signal}")
                yield signal, pin

    def _full_signal(self, peripheral: Peripheral, short: str) -> str | None:
        """RXD is UART1_RXD for uart1; NAND_DATA0 is written in full, for fmi has SD0_DATA0 as well."""
        names = [short, *(prefix + short for prefix in peripheral.signals)]
        known = [name for name in names if name in self.chip.signals and peripheral.owns(name)]
        return known[0] if len(known) == 1 else None

    def _pins_with_text(self, table: dict[str, Any], key: str) -> dict[str, str]:
        pins = {
            pin: str(text)
            for pin, text in self._mapping(table.get(key), key).items()
            if self._exists(pin, key)
        }
        for pin in pins:
            self._take(pin, key)
        return pins

    def _not_connected(self, pins: Any) -> frozenset[str]:
        if not isinstance(pins, list | None):
            self._mistake("not_connected: must be a list of pins")
            return frozenset()
        known = frozenset(pin for pin in pins or () if self._exists(pin, "not_connected"))
        for pin in known:
            self._take(pin, "not_connected")
        return known

    def _accepted(self, entries: Any) -> Iterator[Accepted]:
        if not isinstance(entries, list | None):
            self._mistake("accepted: must be a list of {rule, node, reason}")
            return
        for entry in entries or ():
            entry = self._mapping(entry, "accepted")
            if entry.keys() == {"rule", "node", "reason"} and all(map(str.strip, map(str, entry.values()))):
                yield Accepted(str(entry["rule"]), str(entry["node"]), str(entry["reason"]))
            else:
                self._mistake(f"accepted: {entry}: needs rule, node and reason, none of them empty")

    def _limits(self, name: Any) -> Limits | None:
        """The file of this name beside the table."""
        if isinstance(name, str):
            return load_limits(self.file.parent / name)
        if name is not None:
            self._mistake("limits: must be the name of a file beside the table")
        return None

    def _one_device(self, table: dict[str, Any], key: str) -> str | None:
        return next(self._named_devices(table, key, [table[key]]), None) if table.get(key) else None

    def _named_devices(self, table: dict[str, Any], key: str, labels: Any) -> Iterator[str]:
        """Those of the labels that the table has under devices."""
        devices = self._mapping(table.get("devices"), "devices")
        if not isinstance(labels, list):
            self._mistake(f"{key}: must be a list of devices")
            return
        for label in labels:
            if isinstance(label, str) and label in devices:
                yield label
            else:
                self._mistake(f"{key}: {label} is not under devices{near(str(label), devices)}")

    def _check_bonded(self, package: Package) -> None:
        for pin, user in self.users.items():
            if pin not in package.bonded:
                self._mistake(f"{user}: {pin} is not brought out by the package {package.name}")

    def _exists(self, pin: Any, where: str) -> bool:
        if isinstance(pin, str) and pin in self.chip.pins:
            return True
        self._mistake(f"{where}: {pin}: the chip has no such pin{near(str(pin), self.chip.pins)}")
        return False

    def _take(self, pin: str, user: str) -> None:
        if pin in self.users:
            self._mistake(f"{pin} is used twice: {self.users[pin]} and {user}")
        self.users.setdefault(pin, user)

    def _mapping(self, value: Any, what: str) -> dict[str, Any]:
        if isinstance(value, dict):
            return {str(key): entry for key, entry in value.items()}
        if value is not None:
            self._mistake(f"{what}: must be a mapping, not {value!r}")
        return {}

    def _mistake(self, text: str) -> None:
        self.mistakes.append(text)

    def _give_up(self) -> NoReturn:
        lines = "\n".join(f"  {mistake}" for mistake in self.mistakes)
        raise UnusableInput(f"{self.file} is not a usable pin table:\n{lines}")


def near(word: str, known: Iterable[str]) -> str:
    """ "; did you mean …?" when a known word is like this one, else nothing."""
    found = difflib.get_close_matches(word, known, n=3)
    return f"; did you mean {' or '.join(found)}?" if found else ""
