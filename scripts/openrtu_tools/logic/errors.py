# SPDX-License-Identifier: GPL-3.0-or-later
"""What is wrong with a program's text, and where."""

from __future__ import annotations

from dataclasses import dataclass, field

from nuc980.errors import UnusableInput


class LogicError(UnusableInput):
    """A file that cannot be used, or a machine that does not answer; the text says what to do."""


@dataclass(frozen=True)
class Place:
    line: int
    column: int


class SourceError(Exception):
    """One mistake in the text; the statement it is in is left out."""

    def __init__(self, place: Place, text: str) -> None:
        super().__init__(text)
        self.place = place
        self.text = text


@dataclass(frozen=True, order=True)
class Finding:
    line: int
    column: int
    severity: str  # error or warning
    text: str

    def shown(self, name: str) -> str:
        return f"{name}:{self.line}:{self.column}: {self.severity}: {self.text}"


@dataclass
class Findings:
    """Each mistake once: a block's text is compiled for each of its instances."""

    found: set[Finding] = field(default_factory=set)
    muted: bool = False  # while the library is compiled: its lines are not the user's

    def error(self, place: Place, text: str) -> None:
        self.found.add(Finding(place.line, place.column, "error", text))

    def warn(self, place: Place, text: str) -> None:
        if not self.muted:
            self.found.add(Finding(place.line, place.column, "warning", text))

    @property
    def failed(self) -> bool:
        return any(finding.severity == "error" for finding in self.found)

    def sorted(self) -> list[Finding]:
        return sorted(self.found)
