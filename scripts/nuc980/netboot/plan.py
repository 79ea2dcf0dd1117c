# SPDX-License-Identifier: GPL-3.0-or-later
"""A plan: the steps of a work on a board, as a value. What a dry run prints is what a run types."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from nuc980.netboot.commandline import COMMAND_ROOM, quoted, typed

if TYPE_CHECKING:
    from nuc980.netboot.session import Session

# Names of shell variables, which are no part of U-Boot's environment.
PIECE = "piece"


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


@dataclass(frozen=True)
class Plan:
    """Steps, one after the other."""

    steps: tuple[Step, ...]

    def dialogue(self, first: int = 1) -> list[tuple[str, list[str]]]:
        """Each step's title and its lines exactly as typed; first: the number of the first marker."""
        shown = []
        for step in self.steps:
            lines = [typed(command, first + at) for at, command in enumerate(step.commands())]
            first += len(lines)
            shown.append((step.title(), lines))
        return shown

    def run(self, session: Session) -> None:
        """Does the steps. Raises NetbootError, also LineTooLong before anything is typed."""
        self.dialogue()
        for step in self.steps:
            session.progress.note(step.title())
            with session.progress.phase(step.phase):
                step.run(session)


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
