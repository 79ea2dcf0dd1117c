# SPDX-License-Identifier: GPL-3.0-or-later
"""A plan: the steps of a work on a board, as a value. What a dry run prints is what a run types."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from itertools import takewhile
from typing import TYPE_CHECKING, ClassVar

from nuc980.netboot.commandline import COMMAND_ROOM, quoted, typed

if TYPE_CHECKING:
    from nuc980.netboot.session import Session

# Names of shell variables, which are no part of U-Boot's environment.
PIECE = "piece"
NUMBER = re.compile(r"0x[0-9a-f]+|\d+")


@dataclass(frozen=True)
class Cost:
    """What a step moves, beside the lines that it types. In bytes; erased: in blocks; seconds: all else."""

    network: int = 0
    read: int = 0  # from the flash
    summed: int = 0  # by crc32
    erased: int = 0
    written: int = 0
    printed: int = 0  # by U-Boot over the serial line
    seconds: float = 0.0

    def __add__(self, other: Cost) -> Cost:
        return Cost(*(mine + its for mine, its in zip(astuple(self), astuple(other), strict=True)))


class Step(ABC):
    """One thing to do on a board at U-Boot's prompt. Subclasses are frozen dataclasses."""

    phase: str  # the line of the time report that it counts for

    @abstractmethod
    def title(self) -> str:
        """What it does, for a person."""

    @abstractmethod
    def commands(self) -> tuple[str, ...]:
        """What it types when nothing goes wrong, each without its marker."""

    @abstractmethod
    def run(self, session: Session) -> None:
        """Does it. Raises NetbootError."""

    def cost(self) -> Cost:
        """What it takes when nothing goes wrong, for the forecast."""
        return Cost()


Shown = list[tuple[str, list[str]]]  # titles, and the lines below each


@dataclass(frozen=True)
class Plan:
    """Steps, one after the other."""

    steps: tuple[Step, ...]

    def dialogue(self, first: int = 1) -> Shown:
        """Each step's title and its lines exactly as typed; first: the number of the first marker."""
        shown: Shown = []
        for step in self.steps:
            lines = [typed(command, first + at) for at, command in enumerate(step.commands())]
            first += len(lines)
            shown.append((step.title(), lines))
        return shown

    def summary(self, first: int = 1) -> Shown:
        """As dialogue(), but steps that differ in numbers only are shown once, and so are their lines."""
        alike: dict[str, Shown] = {}
        for title, lines in self.dialogue(first):
            alike.setdefault(NUMBER.sub("#", title), []).append((title, lines))
        return [
            (
                steps[0][0] + (f" {len(steps)} such steps." if len(steps) > 1 else ""),
                _counted([line for _, lines in steps for line in lines]),
            )
            for steps in alike.values()
        ]

    def run(self, session: Session) -> None:
        """Does the steps. Raises NetbootError, also LineTooLong before anything is typed."""
        self.dialogue()
        for step in self.steps:
            session.progress.note(step.title())
            with session.progress.phase(step.phase):
                step.run(session)


def _counted(lines: Sequence[str]) -> list[str]:
    """Each line; of those that begin alike, up to their first number, how many there are."""
    found = {_beginning(line): line for line in lines}
    counts = Counter(map(_beginning, lines))
    return [
        line if counts[beginning] == 1 else f"{beginning} … {counts[beginning]} times"
        for beginning, line in found.items()
    ]


def _beginning(line: str) -> str:
    return " ".join(takewhile(lambda word: not word[:1].isdigit(), line.removeprefix("if ").split(" ")))


@dataclass(frozen=True)
class SetVariable(Step):
    """Sets a variable of U-Boot's environment in RAM; an empty value removes it."""

    name: str
    value: str
    phase: ClassVar[str] = "set-up"

    def title(self) -> str:
        return f"{'Set' if self.value else 'Remove'} {self.name}."

    def commands(self) -> tuple[str, ...]:
        """One, or for a value that no line holds: pieces in the shell's own variables, put together by it.

        hush reads what it has put in for a variable as if it were typed: the pieces are quoted twice.
        """
        if not self.value:
            return (f"setenv {self.name}",)
        whole = f"setenv {self.name} {quoted(self.value)}"
        if len(whole) <= COMMAND_ROOM:
            return (whole,)
        pieces = _pieces(self.value, COMMAND_ROOM - len(f"{PIECE}999="))
        names = [f"{PIECE}{number}" for number in range(1, len(pieces) + 1)]
        together = "".join(f"${{{name}}}" for name in names)
        return (
            *(f"{name}={quoted(quoted(piece))}" for name, piece in zip(names, pieces, strict=True)),
            f"setenv {self.name} {together}",
        )

    def run(self, session: Session) -> None:
        for command in self.commands():
            session.console.run(command).required()


def _pieces(value: str, room: int) -> list[str]:
    """Cut so that each, quoted twice, fits."""
    pieces = [""]
    for character in value:
        if len(quoted(quoted(pieces[-1] + character))) > room:
            pieces.append("")
        pieces[-1] += character
    return pieces
