# SPDX-License-Identifier: GPL-3.0-or-later
"""U-Boot's line editor: cread_line of common/cli_readline.c."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import takewhile

from .wire import Wire

CBSIZE = 256
BELL = "\a"
ARROWS = {"A": "\x10", "B": "\x0e", "C": "\x06", "D": "\x02", "H": "\x01", "F": "\x05"}


class LineEditor:
    """Reads a line. echo: what the faults make of an echoed character."""

    def __init__(self, wire: Wire, words: Iterable[str], echo: Callable[[str], str]) -> None:
        self._wire = wire
        self._words = sorted(words)
        self._echo = echo
        self._history: list[str] = []

    def read(self, prompt: str) -> str | None:
        """The line without its end, or None for Ctrl-C."""
        self._wire.puts(prompt)
        self._line: list[str] = []
        self._at = 0
        self._past = len(self._history)
        escape = ""
        while True:
            key = chr(self._wire.getc())
            if key in "\r\n":
                self._wire.puts("\n")
                break
            if escape:
                escape, key = self._escape(escape, key)
                if not key:
                    continue
            if key == "\x03":
                return None
            if key == "\x1b":
                escape = key
            else:
                self._press(key)
        line = "".join(self._line)
        if line and not line.startswith("!"):
            self._history.append(line)
        return line

    def _escape(self, escape: str, key: str) -> tuple[str, str]:
        """What of an escape sequence is still open, and the key that it stood for."""
        if len(escape) == 1 and key in "[O":
            return escape + key, ""
        if len(escape) == 2 and key in ARROWS:
            return "", ARROWS[key]
        for character in escape + key:
            self._insert(character)
        return "", ""

    def _press(self, key: str) -> None:
        match key:
            case "\x01":
                self._home()
            case "\x02":
                self._left()
            case "\x04":
                self._delete()
            case "\x05":
                self._right(len(self._line))
            case "\x06":
                self._right(self._at + 1)
            case "\x0b":
                self._cut()
            case "\x15" | "\x18":
                self._home()
                self._cut()
            case "\x08" | "\x7f" | "\xff":
                if self._at:
                    self._left()
                    self._delete()
            case "\x10":
                self._recall(self._past - 1)
            case "\x0e":
                self._recall(self._past + 1)
            case "\t":
                self._complete()
            case _:
                self._insert(key)

    def _insert(self, key: str) -> None:
        if len(self._line) > CBSIZE - 1:
            self._wire.puts(BELL)
            return
        self._line.insert(self._at, key)
        rest = "".join(self._line[self._at :])
        self._wire.puts(self._echo(rest[0]) + rest[1:] + "\b" * (len(rest) - 1))
        self._at += 1

    def _home(self) -> None:
        self._wire.puts("\b" * self._at)
        self._at = 0

    def _left(self) -> None:
        if self._at:
            self._wire.puts("\b")
            self._at -= 1

    def _right(self, to: int) -> None:
        self._wire.puts("".join(self._line[self._at : to]))
        self._at = min(to, len(self._line))

    def _delete(self) -> None:
        if self._at < len(self._line):
            del self._line[self._at]
            rest = "".join(self._line[self._at :])
            self._wire.puts(rest + " " + "\b" * (len(rest) + 1))

    def _cut(self) -> None:
        gone = len(self._line) - self._at
        self._wire.puts(" " * gone + "\b" * gone)
        del self._line[self._at :]

    def _recall(self, past: int) -> None:
        if not 0 <= past <= len(self._history):
            self._wire.puts(BELL)
            return
        self._past = past
        self._home()
        self._cut()
        self._line = list((*self._history, "")[past])
        self._right(len(self._line))

    def _complete(self) -> None:
        """A command's name that has one end only; in a real one also variables and a list of choices."""
        typed = "".join(takewhile(lambda key: key != " ", self._line))
        ends = [word[len(typed) :] for word in self._words if word.startswith(typed)]
        if len(ends) != 1 or self._at != len(typed):
            self._wire.puts(BELL)
            return
        for key in ends[0] + " ":
            self._insert(key)
