# SPDX-License-Identifier: GPL-3.0-or-later
"""
Functions to pins from wishes. Which blocks of the chip serve is searched; whether their signals find pins
is a matching. So the answer is exact: a plan, or wishes that cannot be had together, and why.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

from nuc980.errors import UnusableInput
from nuc980.pins.board import Board, near
from nuc980.pins.chip import GPIO, Chip, Package, Peripheral, pin_order
from nuc980.pins.picture import RESERVED, Use
from nuc980.pins.rules.context import grouped, in_order, listed, ranged

COUNTED = ("one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
NUMBERS = {"a": 1, "an": 1} | {word: number for number, word in enumerate(COUNTED, 1)}
WISH = re.compile(
    r"(?:(?P<number>\d{1,3}|[a-z]+)\s*[x*]?\s+)?(?P<kind>[a-z][a-z0-9-]*)"
    r"(?:\s+with\s+(?P<signals>[a-z0-9_ ]+?))?(?:\s+on\s+(?P<pins>[a-z0-9 ]+))?",
    re.IGNORECASE,
)
# What people call a kind: the beginning of its signals, without the number of the device.
KINDS = {
    "uart": "UART", "serial": "UART", "rs485": "UART", "rmii": "RMII", "ethernet": "RMII", "emac": "RMII",
    "can": "CAN", "i2c": "I2C", "spi": "SPI", "qspi": "QSPI", "sd": "SD", "nand": "NAND", "i2s": "I2S",
    "pwm": "PWM", "camera": "VCAP", "ebi": "EBI", "smartcard": "SC", "adc": "ADC", "usb-lite": "USBHL",
}  # fmt: skip
PIN_OR_SIGNAL = re.compile(r"p[a-g]\d{1,2}|rts|cts|dtr|dsr|rxd|txd|ri|dcd", re.IGNORECASE)
MOST_WISHES = 120
PATIENCE = 50_000  # choices of devices


@dataclass(frozen=True)
class Wish:
    """One thing that a board shall have."""

    text: str  # "uart with RTS"
    kind: str  # a key of KINDS, a device's label, or "gpio"
    signals: tuple[str, ...] = ()  # without the prefix, beside those it cannot do without
    pins: tuple[str, ...] = ()  # where they may be; none: anywhere


@dataclass(frozen=True)
class Need:
    """A signal that needs a pin."""

    name: str  # of several: those of which one will do
    places: tuple[tuple[str, str], ...]  # pin, signal


@dataclass(frozen=True)
class Choice:
    """A wish, and a block of the chip that serves it."""

    wish: Wish
    label: str  # uart1; gpios
    resources: frozenset[str]  # what no other choice may have
    needs: tuple[Need, ...]


@dataclass
class Plan:
    """Who has which pin, and for what."""

    chip: Chip
    part: str
    devices: dict[str, dict[str, str]] = field(default_factory=dict)  # label: signal: pin
    gpios: dict[str, str] = field(default_factory=dict)  # pin: wish
    wishes: dict[str, str] = field(default_factory=dict)  # label: wish
    kept: Board | None = None

    def lines(self) -> Iterator[str]:
        for label, pins in self.devices.items():
            yield f"{label}: {', '.join(f'{signal} {pin}' for signal, pin in pins.items())}"
        if self.gpios:
            yield f"gpios: {', '.join(self.gpios)}"

    def uses(self) -> list[Use]:
        """For the picture."""
        devices = [
            Use(pin, label, signal, self.wishes.get(label, ""))
            for label, pins in self.devices.items()
            for signal, pin in pins.items()
        ]
        reserved = self.kept.reserved if self.kept else {}
        return [
            *devices,
            *(Use(pin, "gpios", GPIO, wish) for pin, wish in self.gpios.items()),
            *(Use(pin, RESERVED, RESERVED, why) for pin, why in reserved.items()),
        ]

    def table(self, folder: Path) -> str:
        """The text of a pin table for a folder, with all that a kept one has."""
        lines = ["# Made by nuc980-pins plan. docs/device-tree.md tells what else a pin table may have.", ""]
        lines += [
            f"board: {self.kept.name if self.kept else 'planned board'}",
            f"part: {self.part}",
            *self._kept_keys(folder),
            "",
            "devices:",
        ]
        for label, pins in self.devices.items():
            lines += [f"  {label}:", f"    for: {_quoted(self.wishes.get(label, ''))}"]
            lines += [f"    pins: {{{', '.join(f'{signal}: {pin}' for signal, pin in pins.items())}}}"]
        for key, pins in (("gpios", self.gpios), ("reserved", self.kept.reserved if self.kept else {})):
            lines += ["", f"{key}:{'' if pins else ' {}'}"]
            lines += [f"  {pin}: {_quoted(text)}" for pin, text in pins.items()]
        return "\n".join([*lines, *self._kept_lists(), ""])

    def _kept_keys(self, folder: Path) -> Iterator[str]:
        if self.kept and self.kept.limits:
            # Linked folders would make a way by .. lead elsewhere.
            name = os.path.relpath(self.kept.limits.file.resolve(), folder.resolve())
            yield f"limits: {_quoted(name)}"
        for key in ("flash", "console"):
            if self.kept and (label := getattr(self.kept, key)):
                yield f"{key}: {label}"
        if self.kept and self.kept.ethernet:
            yield f"ethernet: [{', '.join(self.kept.ethernet)}]"

    def _kept_lists(self) -> Iterator[str]:
        if self.kept and self.kept.not_connected:
            yield from ("", f"not_connected: [{', '.join(in_order(self.kept.not_connected))}]")
        if self.kept and self.kept.accepted:
            yield from ("", "accepted:")
        for one in self.kept.accepted if self.kept else ():
            row = (f"{key}: {_quoted(getattr(one, key))}" for key in ("rule", "node", "reason"))
            yield f"  - {{{', '.join(row)}}}"


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


def read_wishes(texts: Sequence[str]) -> list[Wish]:
    """ "six UARTs with RTS, two RMII, a CAN, 3 gpio": one each. Raises UnusableInput for what is none."""
    wishes = [
        wish for text in texts for part in re.split(r"[,;\n]", text) if part.strip() for wish in _read(part)
    ]
    if not wishes:
        raise UnusableInput("no wish; write such as 'six uart with RTS, two rmii, one can'")
    if len(wishes) > MOST_WISHES:
        raise UnusableInput(
            f"{len(wishes)} wishes; a chip of 104 pins has no room for more than {MOST_WISHES}"
        )
    return wishes


def _read(text: str) -> list[Wish]:
    found = WISH.fullmatch(text.strip())
    if not found:
        raise UnusableInput(
            f"{text.strip()!r} is no wish; write [NUMBER] KIND [with SIGNALS] [on PINS], with commas between "
            "wishes only"
        )
    number, kind = found["number"] or "one", found["kind"].lower()
    if PIN_OR_SIGNAL.fullmatch(kind) and not (found["number"] or found["signals"]):
        raise UnusableInput(
            f"{text.strip()!r} is no wish: a comma ends one; write: with RTS and CTS, on PF11 PF12"
        )
    count = int(number) if number.isdecimal() else NUMBERS.get(number.lower())
    if count is None:
        raise UnusableInput(f"{text.strip()!r}: {number} is no number; write it with digits")
    kind = kind.removesuffix("s") if kind.removesuffix("s") in (*KINDS, GPIO.lower()) else kind
    signals = tuple(
        word.upper() for word in re.split(r"\s+and\s+|\s+", found["signals"] or "", flags=re.I) if word
    )
    pins = tuple(word.upper() for word in re.split(r"\s+", found["pins"] or "") if word)
    told = (
        kind
        + (f" with {' and '.join(signals)}" if signals else "")
        + (f" on {' '.join(pins)}" if pins else "")
    )
    return [Wish(told, kind, signals, pins)] * count


@dataclass(frozen=True)
class Planner:
    """The chip in a package, and the pins that are not free."""

    chip: Chip
    package: Package
    taken: frozenset[str] = frozenset()
    used: frozenset[str] = frozenset()  # labels of devices that are taken

    def plan(self, wishes: Sequence[Wish]) -> list[tuple[Choice, dict[str, str]]]:
        """For each wish its block, and its signals' pins. Raises UnusableInput, with why, if it cannot be."""
        # Those with the fewest choices first, like ones together.
        options = {wish: self.choices(wish) for wish in dict.fromkeys(wishes)}
        ordered = sorted(wishes, key=lambda wish: (len(options[wish]), wish.text))
        found = _Search(ordered, options).run()
        if found is None:
            self._refuse(ordered, options)
        return found

    def choices(self, wish: Wish) -> list[Choice]:
        """The blocks that can serve a wish, with signals that the package brings out."""
        for pin in wish.pins:
            if pin not in self.chip.pins:
                raise UnusableInput(f"{wish.text}: the chip has no pin {pin}{near(pin, self.chip.pins)}")
        if wish.kind == GPIO.lower():
            if wish.signals:
                raise UnusableInput(f"{wish.text}: a gpio has no signals; write gpio on PIN, or another kind")
            places = self._free((pin, GPIO) for pin in wish.pins or self.chip.pins)
            return [Choice(wish, "gpios", frozenset(), (Need(GPIO, places),))]
        blocks = list(self._blocks(wish.kind))
        if not blocks:
            kinds = [*KINDS, GPIO.lower()]
            hint = near(wish.kind, [*kinds, *self.chip.peripherals])
            raise UnusableInput(f"{wish.text}: no such kind or device{hint}; kinds are {', '.join(kinds)}")
        return [
            Choice(
                wish,
                device.label,
                frozenset((device.label, prefix)),
                self._near(tuple(self._needs(wish, device, prefix))),
            )
            for device, prefix in blocks
            if device.label not in self.used
        ]

    def _near(self, needs: tuple[Need, ...]) -> tuple[Need, ...]:
        """With the places first that lie together on the package, as a board's wires do."""
        number = self.package.bonded
        homes = needs[0].places if needs else ()

        def away(home: tuple[str, str]) -> int:
            return sum(
                min((_apart(number, home, place) for place in need.places), default=0) for need in needs
            )

        if not homes:
            return needs
        home = min(homes, key=away)
        return tuple(
            Need(need.name, tuple(sorted(need.places, key=lambda place: _apart(number, home, place))))
            for need in needs
        )

    def _blocks(self, kind: str) -> Iterator[tuple[Peripheral, str]]:
        beginning = KINDS.get(kind)
        for label, device in self.chip.peripherals.items():
            for prefix in device.signals:
                if label == kind or (beginning and re.fullmatch(rf"{beginning}\d*_?", prefix)):
                    yield device, prefix

    def _needs(self, wish: Wish, device: Peripheral, prefix: str) -> Iterator[Need]:
        needed = device.signals[prefix]
        for signal in dict.fromkeys((*needed.required, *wish.signals)):
            yield self._need([f"{prefix}{signal}"], wish)
        if needed.some and not set(needed.some) & set(wish.signals):
            yield self._need([f"{prefix}{signal}" for signal in needed.some], wish)

    def _need(self, names: Sequence[str], wish: Wish) -> Need:
        places = ((pin, name) for name in names for pin, _ in self.chip.signals.get(name, ()))
        allowed = ((pin, name) for pin, name in places if not wish.pins or pin in wish.pins)
        return Need(" or ".join(names), self._free(allowed))

    def _free(self, places: Iterator[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
        return tuple(
            (pin, name) for pin, name in places if pin in self.package.bonded and pin not in self.taken
        )

    # ---- why not -----------------------------------------------------------------------------------------

    def _refuse(self, wishes: Sequence[Wish], options: dict[Wish, list[Choice]]) -> NoReturn:
        """
        Wishes that cannot be together; without any one of them they can. The kind with the most goes first:
        what is left is short, though another choice can have fewer.
        """
        core = list(wishes)
        for wish in sorted(wishes, key=wishes.count, reverse=True):
            fewer = core.copy()
            fewer.remove(wish)
            if _Search(fewer, options).run() is None:
                core = fewer
        told = listed(
            _counted(text, len(same)) for text, same in grouped(core, lambda wish: wish.text).items()
        )
        why = self._why(core, options)
        raise UnusableInput(f"{told} cannot be had{' together' * (len(core) > 1)}: {why}")

    def _why(self, core: Sequence[Wish], options: dict[Wish, list[Choice]]) -> str:
        blocks = {choice.label for wish in core for choice in options[wish] if choice.resources}
        wanted = sum(1 for wish in core if wish.kind != GPIO.lower())
        if wanted > len(blocks):
            return f"only {listed(sorted(blocks))} could serve" if blocks else "what could serve is in use"
        if all(wish.kind == GPIO.lower() and not wish.pins for wish in core):
            return f"the {self.package.name} has {len(options[core[0]][0].needs[0].places)} free pins"
        best = _Search(core, options).farthest()
        if not best.needs:
            return f"{listed(sorted(blocks))} could serve, but not so many at once: some share their signals"
        return (
            f"{ranged(best.pins)} {'are all that' if len(best.pins) > 1 else 'is all that'} "
            f"{listed(best.needs)} can be on ({listed(best.labels)})"
            if best.pins
            else f"no free pin of the {self.package.name} can be {listed(best.needs)} ({listed(best.labels)})"
        )


def _apart(number: dict[str, int], one: tuple[str, str], other: tuple[str, str]) -> int:
    return abs(number[one[0]] - number[other[0]])


def _counted(text: str, number: int) -> str:
    return f"{number} {text}" if number > 1 else text


@dataclass(frozen=True)
class Contest:
    """Signals that have fewer pins than they are."""

    labels: tuple[str, ...]
    needs: tuple[str, ...]
    pins: tuple[str, ...]


class _Search:
    """Goes through the choices of blocks; a matching keeps a pin for each signal of those chosen so far."""

    def __init__(self, wishes: Sequence[Wish], options: dict[Wish, list[Choice]]) -> None:
        self.wishes = wishes
        self.options = options
        self.steps = 0
        self.best: tuple[int, Contest | None] = (-1, None)

    def run(self) -> list[tuple[Choice, dict[str, str]]] | None:
        chosen = self._from(0, [], {}, {})
        if chosen is None:
            return None
        choices, holders = chosen
        pins: dict[int, dict[str, str]] = {}
        for pin, (index, need) in holders.items():
            signal = next(name for place, name in choices[index].needs[need].places if place == pin)
            pins.setdefault(index, {})[signal] = pin
        order = [
            (
                choice,
                dict(
                    sorted(pins.get(index, {}).items(), key=lambda row, choice=choice: _rank(choice, row[0]))
                ),
            )
            for index, choice in enumerate(choices)
        ]
        return sorted(order, key=lambda row: row[0].label)

    def farthest(self) -> Contest:
        """Where the search came farthest: what then had no pin."""
        self.run()
        return self.best[1] or Contest((), (), ())

    def _from(
        self, depth: int, chosen: list[Choice], holders: dict[str, tuple[int, int]], last: dict[Wish, int]
    ) -> tuple[list[Choice], dict[str, tuple[int, int]]] | None:
        if depth == len(self.wishes):
            return chosen, holders
        wish = self.wishes[depth]
        resources = frozenset().union(*(choice.resources for choice in chosen))
        for number, choice in enumerate(self.options[wish]):
            # Like wishes take blocks in their order: the others are the same plan.
            if choice.resources & resources or (choice.resources and number <= last.get(wish, -1)):
                continue
            self.steps += 1
            if self.steps > PATIENCE:
                raise UnusableInput(
                    f"no answer after {PATIENCE} choices; name devices (uart1 instead of uart)"
                )
            now, matched = [*chosen, choice], dict(holders)
            contest = _match(now, matched)
            if contest is None:
                found = self._from(depth + 1, now, matched, {**last, wish: number})
                if found:
                    return found
            elif depth > self.best[0]:
                self.best = (depth, contest)
        return None


def _match(chosen: list[Choice], holders: dict[str, tuple[int, int]]) -> Contest | None:
    """Gives each signal of the last choice a pin, moving others; what has none, if one stays without."""
    index = len(chosen) - 1
    for need in range(len(chosen[index].needs)):
        seen: set[str] = set()
        if not _augment(chosen, holders, (index, need), seen):
            fighters = {(index, need), *(holders[pin] for pin in seen)}
            names = tuple(chosen[one].needs[place].name for one, place in sorted(fighters))
            labels = tuple(dict.fromkeys(chosen[one].label for one, _ in sorted(fighters)))
            return Contest(labels, names, in_order(seen))
    return None


def _augment(
    chosen: list[Choice], holders: dict[str, tuple[int, int]], wanted: tuple[int, int], seen: set[str]
) -> bool:
    index, need = wanted
    for pin, _ in chosen[index].needs[need].places:
        if pin in seen:
            continue
        seen.add(pin)
        if pin not in holders or _augment(chosen, holders, holders[pin], seen):
            holders[pin] = wanted
            return True
    return False


def _rank(choice: Choice, signal: str) -> int:
    return next((place for place, need in enumerate(choice.needs) if signal in need.name.split(" or ")), 0)


def plan_board(chip: Chip, part: str, wishes: Sequence[Wish], kept: Board | None = None) -> Plan:
    """A plan for a part; what a kept table has stays. Raises UnusableInput, with why, if it cannot be."""
    closed = {*kept.reserved, *kept.not_connected} if kept else set()
    taken = {pin for pin in chip.pins if kept and (kept.use_of(pin) or pin in closed)}
    used = frozenset(kept.devices) if kept else frozenset()
    planner = Planner(chip, chip.packages[chip.parts[part]], frozenset(taken), used)
    plan = Plan(chip, part, kept=kept)
    for label, device in kept.devices.items() if kept else ():
        plan.devices[label], plan.wishes[label] = dict(device.pins), device.purpose
    plan.gpios.update(kept.gpios if kept else {})
    for choice, pins in planner.plan(wishes):
        if choice.label == "gpios":
            plan.gpios.update(dict.fromkeys(pins.values(), choice.wish.text))
        else:
            plan.devices[choice.label], plan.wishes[choice.label] = pins, choice.wish.text
    plan.gpios = dict(sorted(plan.gpios.items(), key=lambda row: pin_order(row[0])))
    return plan
