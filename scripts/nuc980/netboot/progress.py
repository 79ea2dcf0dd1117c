# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person sees while it works: bars on a terminal, plain lines elsewhere."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TextIO

REDRAW_SECONDS = 0.1
PLAIN_SHARE = 0.25  # without a terminal: a line each quarter,
PLAIN_SECONDS = 300.0  # or after so long
NARROWEST_BAR = 5


@dataclass
class Progress:
    """Notes, bars, and how long each phase took (seconds, in the order they began).

    left: how many seconds the whole work still takes, told beside each bar; it gets the bar's share.
    """

    out: TextIO = field(default_factory=lambda: sys.stdout)
    phases: dict[str, float] = field(default_factory=dict)
    failed: str | None = None  # the phase that an exception ended
    left: Callable[[float], float] | None = None

    def note(self, text: str) -> None:
        """One line, at once."""
        print(text, file=self.out, flush=True)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Measures; a phase that comes again adds up."""
        start = time.monotonic()
        self.phases.setdefault(name, 0.0)
        try:
            yield
        except BaseException:
            self.failed = self.failed or name
            raise
        finally:
            self.phases[name] += time.monotonic() - start

    @contextmanager
    def bar(self, title: str, total: int, unit: str = "B") -> Iterator[Bar]:
        """Work of a known size, in bytes or another unit."""
        bar = Bar(self.out, title, max(total, 1), unit, self.left)
        try:
            yield bar
        finally:
            bar.end()


def duration(seconds: float) -> str:
    """As a person says it: 45 s, 12 min, 10 h 40 min."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60} min"


class Bar:
    """How far a work of a known size is, and how fast it went."""

    def __init__(
        self, out: TextIO, title: str, total: int, unit: str, left: Callable[[float], float] | None
    ) -> None:
        self._out, self._title, self._total, self._unit, self._left = out, title, total, unit, left
        self._terminal = out.isatty()
        self._start = time.monotonic()
        self._done = 0
        self._drawn = 0.0
        self._told, self._told_at = 0.0, self._start

    def at(self, done: int) -> None:
        """So much of the total is done."""
        self._done = min(done, self._total)
        share = self._done / self._total
        if self._terminal:
            if time.monotonic() - self._drawn > REDRAW_SECONDS or share == 1:
                self._draw()
        elif share >= self._told + PLAIN_SHARE or time.monotonic() >= self._told_at + PLAIN_SECONDS:
            self._told, self._told_at = share, time.monotonic()
            print(f"  {self._title}: {share:.0%}{self._tail(share)}", file=self._out, flush=True)

    def end(self) -> None:
        """Leaves the bar as it is and goes on below it."""
        if self._terminal and self._drawn:
            self._draw()
            print(file=self._out, flush=True)

    def _draw(self) -> None:
        """Over the line, and not a character into the next."""
        share = self._done / self._total
        columns = shutil.get_terminal_size().columns - 1
        tail = f" {share:4.0%}{self._tail(share)}"
        bar = columns - len(f"  {self._title} []{tail}")
        if bar >= NARROWEST_BAR:
            line = f"  {self._title} [{'#' * int(share * bar):{bar}}]{tail}"
        else:
            line = f"  {self._title}{tail}"[:columns]
        print(f"\r{line:{columns}}", end="", file=self._out, flush=True)
        self._drawn = time.monotonic()

    def _tail(self, share: float) -> str:
        left = f", {duration(self._left(share))} to the end" if self._left else ""
        return self._speed() + left

    def _speed(self) -> str:
        rate = self._done / max(time.monotonic() - self._start, 1e-3)
        for prefix, size in (("M", 1e6), ("k", 1e3)):
            if rate >= size:
                return f", {rate / size:.1f} {prefix}{self._unit}/s"
        return f", {rate:.0f} {self._unit}/s"
