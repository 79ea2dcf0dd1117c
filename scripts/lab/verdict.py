# SPDX-License-Identifier: GPL-3.0-or-later
"""How a show ends that did not see all: three lines for its user, and a file with the rest."""

from __future__ import annotations

import contextlib
import datetime
import errno
import os
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import search_path
from lab.errors import LabError
from lab.gateway import REPOSITORY
from lab.turns import take_short_turns
from nuc980.netboot.errors import NetbootError
from nuc980.twin.machine import Machine

LINE = 160  # characters of what was seen; the file has all of it
BUSY = 1.5  # waiting processes for each processor
ENDS_S = 1.0
PATIENCE_S = 60.0  # with what is asked and does not answer
LOOK_AGAIN = "rm build/packages*.done"  # for what it lacks, which make has noted as there
NO_CAUSE = "a fault of the gateway or of the show itself"


@dataclass
class Verdict:
    """What a show expects, and what tells more when it fails: sources, asked while all of it still runs."""

    command: str  # what was typed, as "make run"
    name: str  # of the file
    expected: str = "the show starts"  # now
    sources: dict[str, Callable[[], str]] = field(default_factory=dict)
    causes: list[Callable[[], str]] = field(default_factory=list)  # each says what it finds wrong, or ""
    found: str = ""
    collected: list[str] = field(default_factory=list)

    @property
    def file(self) -> Path:
        return REPOSITORY / "build" / "log" / f"{self.name}-failed.log"

    def add_machine(self, machine: Machine) -> None:
        """What QEMU says, and that it has ended."""

        def ended() -> str:
            try:  # its sockets are closed before its code is there
                return f"QEMU ended with {machine.process.wait(ENDS_S)}"
            except subprocess.TimeoutExpired:
                return ""

        self.sources["QEMU"] = lambda: machine.output
        self.causes.append(ended)

    @contextlib.contextmanager
    def watched(self) -> Iterator[None]:
        """Asks the sources when what is inside fails, before it is shut down."""
        try:
            yield
        except Exception:
            self.found = next((first_line(found) for ask in self.causes if (found := asked(ask))), "")
            begin = time.monotonic()
            for title, ask in self.sources.items():
                late = time.monotonic() - begin > PATIENCE_S
                self.collected.append(
                    section(title, "not asked: the others took too long" if late else asked(ask))
                )
            raise

    def lines(self, error: Exception) -> list[str]:
        """What was expected, what was seen, and what probably is the cause and what to type."""
        expected, seen, advice = self.expected, first_line(str(error) or repr(error)), ""
        if isinstance(error, LabError):
            expected = f"{error.expected} ({expected})" if error.expected else expected
            seen, advice = first_line(error.seen), error.advice
        elif isinstance(error, NetbootError):
            seen, advice = first_line(error.what), "; ".join(filter(None, (error.cause, error.next_step)))
        if not advice:
            load = busy() if ran_out_of_time(error) else ""
            causes = "; ".join(filter(None, (known_cause(error), self.found, load))) or NO_CAUSE
            advice = f"{causes}; to try again, type: {self.command}"
        return [
            f"expected: {expected}",
            f"seen:     {seen}",
            f"probably: {advice} (details: {os.path.relpath(self.file)})",
        ]

    def write(self, error: Exception) -> None:
        """All that is known, to the file."""
        now = datetime.datetime.now().astimezone()
        load = f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors"
        parts = [
            f"{self.command}, {now:%Y-%m-%d %H:%M:%S %z}, {load}\n",
            *(f"{line}\n" for line in self.lines(error)),
            *self.collected,
            section("the error", "".join(traceback.format_exception(error))),
        ]
        self.file.parent.mkdir(parents=True, exist_ok=True)
        self.file.write_text("".join(parts), errors="replace")


def run(verdict: Verdict, show: Callable[[], None]) -> int:
    """The exit code of a show, and what it did not see. Who ends it ends all that it has started."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    search_path.complete_own()
    take_short_turns()
    verdict.file.unlink(missing_ok=True)
    try:
        show()
    except KeyboardInterrupt:
        return 1
    except Exception as error:
        verdict.write(error)
        print("", *verdict.lines(error), sep="\n", file=sys.stderr)
        return 1
    return 0


def asked(source: Callable[[], str]) -> str:
    """What a source says; that it says nothing any more is told, too."""
    try:
        return source()
    except Exception as error:
        return f"it does not answer: {error}"


def section(title: str, text: str) -> str:
    return f"\n==== {title}\n{text.rstrip()}\n"


def first_line(text: str) -> str:
    line = text.strip().partition("\n")[0]
    return line if len(line) <= LINE else f"{line[:LINE]}…"


def known_cause(error: Exception) -> str:
    """What this machine itself says of it: a program that is missing, a right, a port. Else ""."""
    match error:
        case FileNotFoundError(filename=str(name)) if "/" not in name:  # a file is looked for by its path
            return f"{name} is not installed; type: {LOOK_AGAIN}"
        case PermissionError(filename=str(name)):
            return f"this user may not use {name}"
        case OSError(errno=errno.EADDRINUSE):
            return "another program has this port"
    return ""


def ran_out_of_time(error: Exception) -> bool:
    late = error.late if isinstance(error, LabError) else False
    return late or isinstance(error, (TimeoutError, subprocess.TimeoutExpired))


def busy() -> str:
    """That this machine has more to do than it can, if it has."""
    load, processors = os.getloadavg()[0], os.cpu_count() or 1
    if load <= BUSY * processors:
        return ""
    return f"this machine is too busy (load {load:.0f} on {processors} processors)"
