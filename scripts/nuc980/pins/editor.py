# SPDX-License-Identifier: GPL-3.0-or-later
"""What an editor shows of a source that is being written; knows no protocol."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from nuc980.errors import UnusableInput
from nuc980.pins.checking import Checker
from nuc980.pins.chip import pin_order
from nuc980.pins.claims import PINS, is_group
from nuc980.pins.explain import explain
from nuc980.pins.findings import Finding, Fix
from nuc980.pins.fixing import mended_line
from nuc980.pins.rules.context import cells_of
from nuc980.pins.rules.properties import known_properties
from nuc980.pins.source import read_tree
from nuc980.pins.tree import Place, Tree

INCLUDE = re.compile(r'^\s*(?:#include|/include/)\s*[<"]([^">]+)[">]')
WORD = re.compile(r"[\w,#.+-]+")
LINE_OF_GPIO = re.compile(r"&gpio\s+\d+")
SETTING = re.compile(r"\d+\s+\d+\s+\d+\s+\d+")
PIN = re.compile(r"P[A-G]\d{1,2}")


@dataclass(frozen=True)
class Mark:
    """What is wrong with a line."""

    line: int  # from 0
    rule: str
    message: str
    related: tuple[tuple[Place, str], ...] = ()
    fix: Fix | None = None  # its one right answer, if that is in this file
    fixed_line: int = 0  # where, from 0


@dataclass(frozen=True)
class Proposal:
    """What may be written at the cursor."""

    shown: str
    written: str
    about: str = ""


@dataclass
class Source:
    """One source in an editor, and its tree as it last was one."""

    file: Path
    checker: Checker
    tree: Tree | None = None
    last: list[Mark] = field(default_factory=list)  # of that tree
    checked: str = ""  # the text of that tree

    def marks(self, text: str) -> list[Mark]:
        """What a check finds in the text, which need not be saved."""
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / self.file.name
            copy.write_text(text, encoding="utf-8", errors="surrogateescape")
            include = [self.file.parent, *self.checker.include]
            checker = replace(self.checker, include=include)
            try:
                tree = read_tree(copy, include, checker.defines)
                findings = checker.findings(tree)
            except UnusableInput as error:
                return [self._unusable(str(error), copy)]
            marks = [self._mark(one, copy, text) for one in findings if one.accepted is None]
            self.tree, self.last, self.checked = tree, marks, text
            return marks

    def _mark(self, finding: Finding, copy: Path, text: str) -> Mark:
        return Mark(
            self._line(finding.place, copy, text),
            finding.rule,
            f"{finding.message}. {finding.remedy}.",
            tuple((self._own(one.place, copy), one.wants) for one in finding.claimants if one.place),
            *self._fix(finding, copy),
        )

    def _fix(self, finding: Finding, copy: Path) -> tuple[Fix | None, int]:
        place = (finding.fix and finding.fix.place) or finding.place
        if finding.fix and place and Path(place.file).resolve() == copy.resolve():
            return finding.fix, place.line - 1
        return None, 0

    def repairs(self, text: str, line: int) -> list[tuple[str, int, str]]:
        """
        For each mark of a line with one right answer: what it says, the line, and what becomes of it. None of
        a text that has changed since: its lines may be others.
        """
        if text != self.checked:
            return []
        answers = [
            (mark.message, mark.fixed_line, mark.fix) for mark in self.last if mark.line == line and mark.fix
        ]
        found = ((said, at, mended_line(text, at + 1, fix)) for said, at, fix in answers)
        return [(said, at, new) for said, at, new in found if new is not None]

    def _own(self, place: Place, copy: Path) -> Place:
        return Place(str(self.file), place.line) if Path(place.file).resolve() == copy.resolve() else place

    def _line(self, place: Place | None, copy: Path, text: str) -> int:
        """The finding's, or of one in an included file the line that includes it."""
        if place and Path(place.file).resolve() == copy.resolve():
            return max(place.line - 1, 0)
        name = Path(place.file).name if place else None
        lines = enumerate(text.splitlines())
        return next((n for n, line in lines if (at := INCLUDE.match(line)) and Path(at[1]).name == name), 0)

    def _unusable(self, error: str, copy: Path) -> Mark:
        """At the first line that cpp or dtc name."""
        found = re.search(rf"{re.escape(copy.name)}:(\d+)", error)
        return Mark(
            max(int(found[1]) - 1, 0) if found else 0, "unusable", error.replace(str(copy), str(self.file))
        )

    # ---- the word at the cursor ------------------------------------------------------------------------

    def hover(self, line: str, column: int) -> str | None:
        """What explain says of the setting, line, pin, signal, device or group there."""
        for word in self._words(line, column):
            try:
                return "\n".join(explain(word, self.checker.chip, self.checker.board))
            except UnusableInput:
                continue
        return None

    def _words(self, line: str, column: int) -> Iterator[str]:
        for kind, form in ((LINE_OF_GPIO, "{}"), (SETTING, "<{}>")):
            if kind is LINE_OF_GPIO or PINS in line or line.lstrip().startswith("<"):
                yield from (form.format(word) for word in _at(kind, line, column))
        for word in _at(WORD, line, column):
            yield word
            yield from self._device_of(word)

    def _device_of(self, word: str) -> Iterator[str]:
        """uart1 for uart1_pins, uart1-pins and pinctrl_uart1."""
        parts = re.split(r"[_-]", word)
        yield from (part for part in parts if part in self.checker.chip.peripherals)

    def definition(self, line: str, column: int) -> Place | None:
        """The row of the pin table of a device, group or pin; else where a label is in the sources."""
        for word in _at(WORD, line, column):
            for name in (word, *self._device_of(word)):
                if row := self._row(name):
                    return row
            for node in self.tree.root.walk() if self.tree else ():
                if self.tree and word in node.labels and node.places:
                    return self._own(node.places[0], self.tree.file)
        return None

    def _row(self, name: str) -> Place | None:
        board = self.checker.board
        if board is None:
            return None
        rows = board.file.read_text(encoding="utf-8").splitlines()
        label = name
        if PIN.fullmatch(name):
            use = board.use_of(name)
            label = use[0] if use and use[0] != "gpios" else name
        kind = re.compile(rf"\s+['\"]?{re.escape(label)}['\"]?:")
        return next(
            (Place(str(board.file), number) for number, row in enumerate(rows, 1) if kind.match(row)), None
        )

    # ---- what may come -----------------------------------------------------------------------------------

    def proposals(self, line: str, column: int) -> list[Proposal]:
        """Groups behind pinctrl-0 = <&, labels behind &, settings of pins, values of status, properties."""
        before = line[:column]
        if re.search(r"pinctrl-\d+\s*=.*&\w*$", before):
            return self._labels(groups=True)
        if re.search(r"&\w*$", before):
            return self._labels(groups=False)
        if re.search(r"(nuvoton,pins\s*=\s*|^\s*|,\s*)<[^>]*$", before) and (PINS in line or "<" in before):
            return self._settings()
        if re.search(r'status\s*=\s*"\w*$', before):
            return [Proposal(value, value) for value in ("okay", "disabled")]
        if re.fullmatch(r"\s*[\w,#-]*", before):
            return [Proposal(name, name) for name in sorted(known_properties(self.checker.chip))]
        return []

    def _labels(self, groups: bool) -> list[Proposal]:
        nodes = self.tree.root.walk() if self.tree else ()
        return [
            Proposal(label, label, node.path)
            for node in nodes
            for label in node.labels
            if is_group(node) is groups
        ]

    def _settings(self) -> list[Proposal]:
        chip, package = self.checker.chip, self.checker.package
        return [
            Proposal(f"{pin} {signal}", cells_of(pin, value).strip("<>"), self._owner(pin))
            for pin in sorted(chip.pins, key=pin_order)
            if package is None or pin in package.bonded
            for value, signal in chip.pins[pin].items()
        ]

    def _owner(self, pin: str) -> str:
        use = self.checker.board.use_of(pin) if self.checker.board else None
        return (
            f"{use[1]} of {use[0]} in the pin table"
            if use
            else "free in the pin table"
            if self.checker.board
            else ""
        )


def _at(kind: re.Pattern[str], line: str, column: int) -> Iterator[str]:
    return (found[0] for found in kind.finditer(line) if found.start() <= column <= found.end())
