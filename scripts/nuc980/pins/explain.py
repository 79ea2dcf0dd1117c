# SPDX-License-Identifier: GPL-3.0-or-later
"""What a word of a device tree or pin table means: a pin, a signal, a device, a pin's cells, a GPIO."""

from __future__ import annotations

import difflib
import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from typing import NoReturn

from nuc980.errors import UnusableInput
from nuc980.pins.board import Board
from nuc980.pins.chip import BANKS, GPIO, Chip, Peripheral, gpio_number, pin_name, pin_of_gpio, pin_order
from nuc980.pins.claims import CELLS_A_PIN
from nuc980.pins.rules import RULES
from nuc980.pins.rules.context import Rule, cells_of, functions_of_pin

PIN = re.compile(r"P?([A-G])\.?(\d{1,2})", re.IGNORECASE)  # table 2.1 of the project report says A0
NUMBER = r"(?:0x[0-9a-f]{1,8}|0|[1-9][0-9]{0,9})"
LINE = re.compile(rf"<?\s*&?gpio\s*({NUMBER})(?:\s+{NUMBER})?\s*>?", re.IGNORECASE)  # <&gpio 138 0>
CELLS = re.compile(rf"<?\s*({NUMBER}(?:\s+{NUMBER})*)\s*>?", re.IGNORECASE)
REGISTER = re.compile(r"0x[0-9a-f]{8}", re.IGNORECASE)


def explain(word: str, chip: Chip, board: Board | None) -> list[str]:
    """
    Lines of text on a pin (PA0), signal (UART8_TXD), device (uart8), pin setting (<4 7 1 0>), GPIO (gpio 138)
    or register (0xb0000070), on a rule of the check (pin-conflict) or on all of them (rules); upper or lower
    case. Without a board nothing is said of who has a pin. Raises UnusableInput, with what is like it, for a
    word that is none of these.
    """
    return list(_Explainer(chip, board).lines(word.strip()))


class _Explainer:
    def __init__(self, chip: Chip, board: Board | None) -> None:
        self.chip = chip
        self.board = board
        self.package = board.package if board else None

    def lines(self, word: str) -> Iterator[str]:
        signal = next((name for name in self.chip.signals if name.upper() == word.upper()), None)
        if signal:
            return self._signal(signal)
        if word.lower() in self.chip.peripherals:
            return self._device(self.chip.peripherals[word.lower()])
        if word.lower() == "rules":
            return _table([("", rule.name, rule.what) for rule in RULES.values()])
        if word.lower() in RULES:
            return _rule(RULES[word.lower()])
        if found := PIN.fullmatch(word):
            return self._pin(f"P{found[1].upper()}{int(found[2])}")
        if found := LINE.fullmatch(word):
            return self._line(int(found[1], 0))
        if REGISTER.fullmatch(word):
            return self._register(int(word, 16))
        if found := CELLS.fullmatch(word):
            return self._cells(word, [int(number, 0) for number in found[1].split()])
        self._unknown(word)

    def _unknown(self, word: str) -> NoReturn:
        known = [*self.chip.pins, *self.chip.signals, *self.chip.peripherals, *RULES]
        upper = {name.upper(): name for name in known}
        alike = difflib.get_close_matches(word.upper(), upper, n=3)
        hint = f"; did you mean {' or '.join(upper[name] for name in alike)}?" if alike else ""
        raise UnusableInput(
            f"{word!r} is not a pin, signal or device of the {self.chip.name}{hint}\n"
            "  explain takes PA0, UART8_TXD, uart8, '<4 7 1 0>', 'gpio 138', 0xb0000070, pin-conflict, rules"
        )

    # ---- a pin ---------------------------------------------------------------------------------------------

    def _pin(self, pin: str) -> Iterator[str]:
        if pin not in self.chip.pins:
            bank = sorted((name for name in self.chip.pins if name[1] == pin[1]), key=pin_order)
            raise UnusableInput(f"{pin}: no such pin; bank {pin[1]} has {bank[0]} to {bank[-1]}")
        number = gpio_number(pin)
        yield f"{pin}: GPIO {number}, <&gpio {number} 0> in a device tree"
        yield from _table(
            [
                ("package pin", self._package_pins(pin)),
                ("register", self._field(pin)),
                ("interrupt", self._interrupt(pin)),
                ("pin table", self._who(pin)),
            ]
        )
        yield "  functions"
        use = self.board.use_of(pin) if self.board else None
        rows = [
            (
                "*" if use and use[1] == signal else " ",
                str(value),
                signal,
                cells_of(pin, value),
                _devices(self.chip, signal),
            )
            for value, signal in self.chip.pins[pin].items()
        ]
        yield from _table(rows)

    def _package_pins(self, pin: str) -> str:
        return ", ".join(
            f"{name} {package.bonded.get(pin, 'not brought out')}"
            + (" (this board)" if package is self.package else "")
            for name, package in self.chip.packages.items()
        )

    def _field(self, pin: str) -> str:
        register, shift = self.chip.register_of(pin)
        value = self._value_in_table(pin)
        now = f"; the pin table makes it {value}" if value is not None else ""
        return f"{register:#x}, bits {shift + 3}..{shift}{now}"

    def _value_in_table(self, pin: str) -> int | None:
        use = self.board.use_of(pin) if self.board else None
        return self.chip.value(pin, use[1]) if use else None

    def _interrupt(self, pin: str) -> str:
        """EINT0 is on PA0 and PA13: eint0-config's second cell says which of them it is."""
        for name, pins in self.chip.eint.items():
            if pin in pins:
                value = self.chip.value(pin, name.upper())
                return (
                    f"{name.upper()} with function {value}; second cell of {name}-config: {pins.index(pin)}"
                )
        return ""

    def _who(self, pin: str) -> str:
        if self.board is None:
            return ""
        if pin in self.board.reserved:
            return f"reserved: {self.board.reserved[pin]}"
        if pin in self.board.not_connected:
            return "not connected"
        use = self.board.use_of(pin)
        if use is None:
            bonded = pin in self.package.bonded
            return "free, wiring unknown" if bonded else f"not brought out by the {self.package.name}"
        owner, signal = use
        purpose = self.board.gpios[pin] if pin in self.board.gpios else self.board.devices[owner].purpose
        return f"{signal} of {owner}" + (f", {purpose}" if purpose else "")

    # ---- a signal ------------------------------------------------------------------------------------------

    def _signal(self, signal: str) -> Iterator[str]:
        owners = _devices(self.chip, signal)
        yield f"{signal}: signal{f' of {owners}' if owners else ''}"
        yield from _table([("", *row) for row in self._places(signal)])

    def _places(self, signal: str) -> Iterator[tuple[str, ...]]:
        for pin, value in self.chip.signals[signal]:
            numbers = [
                f"{name} {package.bonded[pin]}"
                for name, package in self.chip.packages.items()
                if pin in package.bonded and self.package in (None, package)
            ]
            where = ", ".join(numbers) or f"not in {self.package.name if self.package else 'any package'}"
            here = self.board is not None and (self.board.use_of(pin) or ("", ""))[1] == signal
            yield "*" if here else " ", pin, cells_of(pin, value), where, self._who(pin) if numbers else ""

    # ---- a device ------------------------------------------------------------------------------------------

    def _device(self, device: Peripheral) -> Iterator[str]:
        yield f"{device.label}: {device.path}"
        yield from _table(
            [
                ("compatible", ", ".join(device.compatible + device.compatible_66)),
                (
                    "registers",
                    "" if device.address is None else f"{device.address:#x}, {device.size:#x} bytes",
                ),
                (
                    "interrupts",
                    ", ".join(f"{self.chip.interrupts[name]} ({name})" for name in device.interrupts),
                ),
                ("driver", "" if device.has_driver else "no vendor kernel has one"),
                *_headed("needs", _needs(device)),
                ("pin table", self._purpose(device)),
            ]
        )
        signals = sorted(filter(device.owns, self.chip.signals), key=_natural)
        if signals:
            yield "  signals" + (" (* in the pin table)" if self.board else "")
        yield from _table([("", signal, self._choices(signal)) for signal in signals])

    def _purpose(self, device: Peripheral) -> str:
        if self.board is None:
            return ""
        used = self.board.devices.get(device.label)
        return (used.purpose or "in use") if used else "not used"

    def _choices(self, signal: str) -> str:
        choices = []
        for pin, value in self.chip.signals[signal]:
            here = self.board is not None and (self.board.use_of(pin) or ("", ""))[1] == signal
            lost = self.package is not None and pin not in self.package.bonded
            choices.append(
                f"{pin} {cells_of(pin, value)}{'*' if here else ' (not brought out)' if lost else ''}"
            )
        return ", ".join(choices)

    # ---- cells, lines, registers ---------------------------------------------------------------------------

    def _cells(self, word: str, numbers: Sequence[int]) -> Iterator[str]:
        if len(numbers) % CELLS_A_PIN:
            raise UnusableInput(
                f"{word}: {len(numbers)} cells; nuvoton,pins has four for each pin: "
                "bank, pin, function, and one unused"
                + ("; for a GPIO, write gpio before the number" if len(numbers) == 1 else "")
            )
        for start in range(0, len(numbers), CELLS_A_PIN):
            yield from self._setting(*numbers[start : start + CELLS_A_PIN])

    def _setting(self, bank: int, index: int, value: int, conf: int) -> Iterator[str]:
        pin = pin_name(bank, index)
        written = f"<{bank} {index} {value} {conf}>"
        functions = self.chip.pins.get(pin)
        if functions is None:
            yield f"{written}: {pin} does not exist"
            yield f"  the first cell is the bank, 0 for A to {len(BANKS) - 1} for G, the second the pin in it"
            return
        signal = functions.get(value)
        owners = _devices(self.chip, signal or "")
        function = signal or f"{pin} has {functions_of_pin(self.chip, pin)}"
        yield f"{written}: {pin} as {signal or 'no function that it has'}{f' of {owners}' if owners else ''}"
        rows = [
            ("bank", f"{bank}: P{BANKS[bank]}"),
            ("pin", f"{index}: {pin}, {self._package_pins(pin)}"),
            ("function", f"{value}: {function}"),
            ("fourth cell", f"{conf}: pin configuration; the vendor's driver stores it and never uses it"),
            ("register", self._field(pin)),
            ("pin table", self._verdict(pin, signal)),
        ]
        yield from _table(rows)

    def _verdict(self, pin: str, signal: str | None) -> str:
        use = self.board.use_of(pin) if self.board else None
        agrees = use is not None and use[1] == signal
        return self._who(pin) + (": this one" if agrees else ": another one" if use else "")

    def _line(self, number: int) -> Iterator[str]:
        pin = pin_of_gpio(number)
        if pin not in self.chip.pins:
            raise UnusableInput(
                f"gpio {number}: no pin has this number; numbers are 32 times the bank (A is 0) plus the "
                f"pin, 0 to {max(map(gpio_number, self.chip.pins))}"
            )
        yield f"GPIO {number} is {pin}: 32 x {number // 32} (bank {pin[1]}) + {number % 32}"
        yield from self._pin(pin)

    def _register(self, address: int) -> Iterator[str]:
        pins = [pin for pin in self.chip.pins if self.chip.register_of(pin)[0] == address]
        devices = self.chip.at(address)
        if not pins and not devices:
            raise UnusableInput(
                f"{address:#x}: neither a multi-function register nor the address of a device"
            )
        for device in devices:
            yield from self._device(device)
        if pins:
            yield f"{address:#x}: multi-function register of {pins[0]} to {pins[-1]}"
            yield from _table(
                [("", pin, self._field(pin).partition(", ")[2], self._who(pin)) for pin in pins]
            )


def _rule(rule: Rule) -> Iterator[str]:
    yield f"{rule.name}: {rule.what}"
    yield from textwrap.wrap(rule.why, 100, initial_indent="  ", subsequent_indent="  ")


def _devices(chip: Chip, signal: str) -> str:
    return " or ".join(owner.label for owner in chip.owners(signal)) if signal != GPIO else ""


def _needs(device: Peripheral) -> Iterator[str]:
    for prefix, needed in device.signals.items():
        if needed.required:
            yield f"all of {_names(prefix, needed.required)}"
        for group in needed.together:
            yield f"all or none of {_names(prefix, group)}"
        if needed.some:
            yield f"one or more of {_names(prefix, needed.some)}"


def _headed(name: str, texts: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Rows of a table, the name before the first of them."""
    for index, text in enumerate(texts):
        yield "" if index else name, text


def _names(prefix: str, signals: Iterable[str]) -> str:
    return " ".join(prefix + signal for signal in signals)


def _natural(name: str) -> list[str | int]:
    """DATA2 before DATA10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def _table(rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    """Rows in columns, two spaces apart, without the facts of which nothing is known."""
    rows = [row for row in rows if len(row) > 2 or row[-1]]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield ("  " + "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True))).rstrip()
