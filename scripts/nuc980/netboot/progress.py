# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person sees while it works: bars on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TextIO

BAR = 30
REDRAW_SECONDS = 0.1
PLAIN_SHARE = 0.25  # without a terminal: a line each quarter


@dataclass
class Progress:
    """Notes, bars, and how long each phase took (seconds, in the order they began)."""

    out: TextIO = field(default_factory=lambda: sys.stdout)
    phases: dict[str, float] = field(default_factory=dict)

    def note(self, text: str) -> None:
        """One line, at once."""
        print(text, file=self.out, flush=True)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Measures; a phase that comes again adds up."""
        start = time.monotonic()
        try:
            yield
        finally:
            self.phases[name] = self.phases.get(name, 0.0) + time.monotonic() - start

    @contextmanager
    def bar(self, title: str, total: int) -> Iterator[Bar]:
        """Work of a known size."""
        bar = Bar(self.out, title, max(total, 1))
        try:
            yield bar
        finally:
            bar.end()


class Bar:
    """How far a work of a known size is."""

    def __init__(self, out: TextIO, title: str, total: int) -> None:
        self._out, self._title, self._total = out, title, total
        self._terminal = out.isatty()
        self._done = 0
        self._drawn = 0.0
        self._told = 0.0

    def at(self, done: int) -> None:
        """So much of the total is done."""
        self._done = min(done, self._total)
        share = self._done / self._total
        if self._terminal and (time.monotonic() - self._drawn > REDRAW_SECONDS or share == 1):
            filled = round(share * BAR)
            print(
                f"\r  {self._title} [{'#' * filled:{BAR}}] {share:4.0%}", end="", file=self._out, flush=True
            )
            self._drawn = time.monotonic()
        elif not self._terminal and share >= self._told + PLAIN_SHARE:
            self._told = share
            print(f"  {self._title}: {share:.0%}", file=self._out, flush=True)

    def end(self) -> None:
        """Leaves the bar as it is and goes on below it."""
        if self._terminal and self._drawn:
            print(file=self._out, flush=True)
