# SPDX-License-Identifier: GPL-3.0-or-later
"""What a tool tells its user when it fails: what happened, the likely cause and the next step."""

from __future__ import annotations


def printable(text: str, kept: str = "") -> str:
    """What quotes a file and goes to a terminal: without the letters that would command it."""
    return "".join(letter if letter.isprintable() or letter in kept else "?" for letter in text)


class ToolError(Exception):
    """What happened, why probably, and what to do next; cause and next step default to those of the class."""

    exit_code = 1
    cause = ""
    next_step = ""

    def __init__(self, what: str, *, cause: str = "", next_step: str = "") -> None:
        super().__init__(what)
        self.what = what
        self.cause = cause or self.cause
        self.next_step = next_step or self.next_step

    def __str__(self) -> str:
        lines = [self.what]
        if self.cause:
            lines.append(f"  likely cause: {self.cause}")
        if self.next_step:
            lines.append(f"  next step: {self.next_step}")
        return "\n".join(lines)


class UnusableInput(ToolError):
    """A word, file or port cannot be used: nothing was done."""

    exit_code = 2
