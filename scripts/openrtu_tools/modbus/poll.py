# SPDX-License-Identifier: GPL-3.0-or-later
"""`openrtu poll`: reads again and again, and prints what changes.

Exit codes: 0 something was answered, 1 nothing was, 2 nothing could be asked.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field
from datetime import datetime

from openrtu_tools.modbus import arguments, read
from openrtu_tools.modbus.errors import (
    Damaged,
    Exceptional,
    LinkLost,
    ModbusError,
    NoAnswer,
    NotAsked,
    Unreachable,
)
from openrtu_tools.modbus.links import Link, TcpLink
from openrtu_tools.modbus.read import Asked, Value
from openrtu_tools.modbus.registers import Place

# What became of a request; the first that fits.
FATES: dict[str, type[Exception]] = {
    "refused": Exceptional,
    "not answered": NoAnswer,
    "damaged": Damaged,
    "answered by others": NotAsked,
    "link lost": LinkLost,
    "not connected": Unreachable,
}
ANSWERED = "answered"
HUNG_AT = 3  # requests without an answer: a new connection may work where this one hangs


@dataclass
class Statistics:
    began: float = field(default_factory=time.monotonic)
    fates: Counter[str] = field(default_factory=Counter)
    took_s: list[float] = field(default_factory=list)

    def text(self) -> str:
        parts = [f"{self.fates[word]} {word}" for word in (ANSWERED, *FATES) if self.fates[word]]
        took = time.monotonic() - self.began
        text = f"{self.fates.total()} requests in {took:.1f} s: {', '.join(parts) or 'none'}"
        if self.took_s:
            least, mean, most = (
                f"{seconds * 1e3:.1f}"
                for seconds in (min(self.took_s), sum(self.took_s) / len(self.took_s), max(self.took_s))
            )
            text += f"; answers took {least} ms at least, {mean} on average, {most} at most"
        return text


@dataclass
class Poll:
    """What is known of the objects; say: prints a line."""

    link: Callable[[], Link]
    unit: int
    asked: Sequence[Asked]
    say: Callable[[Value], None]
    complain: Callable[[str], None]
    statistics: Statistics = field(default_factory=Statistics)
    values: dict[Place, Value] = field(default_factory=dict)
    troubles: dict[int, str] = field(default_factory=dict)  # of each request, what was said of it
    now: Link | None = None
    silent: int = 0  # requests in a row without an answer

    def turn(self) -> None:
        """Reads all once. What fails is said once, until something else comes of it."""
        for number, asked in enumerate(self.asked):
            try:
                values = self._read(asked)
            except (ModbusError, Unreachable) as error:
                self._failed(number, error)
            else:
                self.troubles.pop(number, None)
                self._changed(values)

    def close(self) -> None:
        self.silent = 0
        if self.now:
            self.now.stream.close()
            self.now = None

    def _read(self, asked: Asked) -> list[Value]:
        if self.now is None:
            self.now = self.link()
        began = time.monotonic()
        values = asked.read(self.now, self.unit)
        self.statistics.took_s.append(time.monotonic() - began)
        self.statistics.fates[ANSWERED] += 1
        self.silent = 0
        return values

    def _failed(self, number: int, error: ModbusError | Unreachable) -> None:
        fate = next(word for word, kind in FATES.items() if isinstance(error, kind))
        self.statistics.fates[fate] += 1
        self.silent = self.silent + 1 if isinstance(error, NoAnswer) else 0
        hung = isinstance(self.now, TcpLink) and self.silent >= HUNG_AT
        if hung or isinstance(error, LinkLost):
            self.close()
        if self.troubles.get(number) != fate:
            self.complain(str(error))
        self.troubles[number] = fate

    def _changed(self, values: Sequence[Value]) -> None:
        for value in values:
            if self.values.get(value.place) != value:
                self.values[value.place] = value
                self.say(value)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_device(parser)
    read.add_objects(parser)
    arguments.add_link(parser, read.TIMEOUT_S)
    parser.add_argument(
        "--period",
        type=arguments.ranged(0, arguments.DAY_S, float),
        default=1.0,
        metavar="S",
        help="seconds from one turn to the next; 0: without a pause [1]",
    )
    parser.add_argument(
        "--times",
        type=arguments.ranged(1, 1 << 31, int),
        metavar="N",
        help="end after so many turns [at Ctrl-C]",
    )
    parser.add_argument("--json", action="store_true", help="print JSON lines, a change each")


def _stamp() -> str:
    return datetime.now().isoformat(sep=" ", timespec="milliseconds")


def _as_json(value: Value) -> None:
    print(json.dumps({"time": datetime.now().astimezone().isoformat(), **value.record()}), flush=True)


def _as_row(value: Value) -> None:
    print(f"{_stamp()}  {value.row()}", flush=True)


def run(parsed: argparse.Namespace) -> int:
    def complain(text: str) -> None:
        print(f"{_stamp()}  {text}", file=sys.stderr, flush=True)

    poll = Poll(
        lambda: arguments.link_of(parsed),
        parsed.unit,
        read.asked_for(parsed),
        _as_json if parsed.json else _as_row,
        complain,
    )
    poll.now = arguments.link_of(parsed)  # a device that cannot be had at first is a mistake of who asks
    with closing(poll), suppress(KeyboardInterrupt):
        _go_on(poll, parsed.period, parsed.times)
    print(poll.statistics.text(), file=sys.stderr)
    return 0 if poll.statistics.fates[ANSWERED] else 1


def _go_on(poll: Poll, period_s: float, times: int | None) -> None:
    due = time.monotonic()
    turns = 0
    while True:
        poll.turn()
        turns += 1
        if turns == times:
            return
        now = time.monotonic()
        due = max(due + period_s, now)
        time.sleep(due - now)
