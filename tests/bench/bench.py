# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: one table, ours beside the method of the project report, measured by one stop-watch in one run.
What the rows mean: docs/bench.md. No time is asserted.
Exit codes: 0 done, 1 something did not work, 2 wrong usage or not built.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import random
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from contenders import OURS, REPORT, UNIT, Contender, ContenderError, Line, report_program, running
from stopwatch import (
    Memory,
    Session,
    Spread,
    ages,
    change_times,
    interrogation_cpu,
    interrogation_times,
    memory,
    watching_cpu,
)

from lab.gateway import REPOSITORY, GatewayError, default_build
from lab.linesim import LineSimError, default_program
from lab.raw_master import RawMaster, StationError

DEVICES = (35, 67, 155, 201)  # on port 3 of chapter 5
SEED = 3067  # for both the same objects change, after the same pauses
HEADINGS = ("measured", "n", "ours", "report's method", "ours / report's")

Result = Spread | Memory
Results = Iterator[tuple[str, Result]]


@dataclass(frozen=True)
class Amounts:
    """How often each is repeated."""

    interrogations: int
    cpu_rounds: int
    cpu_interrogations: int
    watching_seconds: int
    dated_interrogations: int
    changes: int


FULL = {OURS: Amounts(100, 5, 200, 5, 200, 30), REPORT: Amounts(25, 5, 5, 5, 25, 30)}
QUICK = {OURS: Amounts(10, 1, 50, 1, 10, 3), REPORT: Amounts(5, 1, 2, 1, 3, 3)}


@dataclass(frozen=True)
class Row:
    """One quantity, of both."""

    text: str
    ours: Result | None
    report: Result | None

    @property
    def ratio(self) -> float | None:
        return self.ours.middle / self.report.middle if self.ours and self.report else None

    def cells(self) -> tuple[str, ...]:
        both = (self.ours, self.report)
        numbers = [str(len(result.values)) for result in both if isinstance(result, Spread)]
        ratio = f"{self.ratio:.2g}" if self.ratio is not None else ""
        return (self.text, " / ".join(numbers), *(str(result) if result else "" for result in both), ratio)

    def record(self) -> dict[str, object]:
        both = {"ours": self.ours, "report": self.report}
        results = {name: result.record() if result else None for name, result in both.items()}
        return {"measured": self.text, **results, "ratio": self.ratio}


# ---- what is measured where ----------------------------------------------------------------------


def interrogation(session: Session, line: Line, amounts: Amounts) -> Results:
    """At each baud rate."""
    yield f"(a) GI of 13 points, {line}", interrogation_times(session, amounts.interrogations)


def changes_and_ages(session: Session, line: Line, amounts: Amounts) -> Results:
    """With what else is on the line. The changes come first: no older event may be under way."""
    yield f"(c) change to master, {line}", change_times(session, amounts.changes)
    yield f"(b) age of its data, {line}", ages(session, amounts.dated_interrogations)


def costs(session: Session, line: Line, amounts: Amounts) -> Results:
    """CPU and memory."""
    cpu = interrogation_cpu(session, amounts.cpu_rounds, amounts.cpu_interrogations)
    yield f"(a) CPU of such a GI, {line}", cpu
    yield f"(c) CPU meanwhile, {line}", watching_cpu(session, amounts.watching_seconds)
    processes = memory(session)
    if len(processes) > 1:
        yield from ((f"(d) memory, {name}", used) for name, used in processes.items())
    yield "(d) memory, all processes", sum(processes.values(), start=Memory(0, 0, 0))


Measures = tuple[Callable[[Session, Line, Amounts], Results], ...]
SHORT_PLAN = ((Line(19200, DEVICES), (interrogation, changes_and_ages, costs)),)
PLAN = (
    (Line(9600, DEVICES), (interrogation,)),
    *SHORT_PLAN,
    (Line(115200, DEVICES), (interrogation,)),
    (Line(19200, (UNIT,)), (changes_and_ages,)),
)


def measured(contender: Contender, line: Line, measures: Measures, amounts: Amounts) -> Results:
    with RawMaster(*contender.address) as master:
        session = Session(contender, master, line.stations, random.Random())
        session.wait_until_good()
        for measure in measures:
            session.random.seed(SEED)
            for text, result in measure(session, line, amounts):
                print(f"  {contender.name}: {text}: {result}", flush=True)
                yield text, result


def rows(quick: bool) -> list[Row]:
    """Measures all."""
    found: dict[str, dict[str, Result]] = {OURS: {}, REPORT: {}}
    for line, measures in SHORT_PLAN if quick else PLAN:
        for name, results in found.items():
            with running(name, line) as contender:
                results.update(measured(contender, line, measures, (QUICK if quick else FULL)[name]))
    texts = sorted(found[OURS] | found[REPORT], key=lambda text: (text[:3], "CPU" in text))
    return [Row(text, found[OURS].get(text), found[REPORT].get(text)) for text in texts]


# ---- the table -----------------------------------------------------------------------------------


def table(found: list[Row]) -> str:
    """Markdown that is a table on a terminal too."""
    cells = [HEADINGS, *(row.cells() for row in found)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ["| " + " | ".join(map(str.ljust, line, widths)) + " |" for line in cells]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def machine() -> str:
    model = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    cores = len(os.sched_getaffinity(0))
    load = os.getloadavg()[0]
    return f"{model[1] if model else platform.machine()}, {cores} cores, load {load:.1f} at the start"


def heading() -> str:
    return (
        f"{datetime.date.today()}, {machine()}. Median (minimum..maximum) of n; two n: ours / report's.\n"
        "Devices, gateway, controlling station and whatever else share the machine: look at the spread."
    )


def write(directory: Path, head: str, found: list[Row]) -> None:
    directory.mkdir(parents=True, exist_ok=True)
    record = {"heading": head, "rows": [row.record() for row in found]}
    (directory / "bench.json").write_text(json.dumps(record, indent=2) + "\n")
    (directory / "bench.md").write_text(f"{head}\n\n{table(found)}\n")


# ---- start ---------------------------------------------------------------------------------------


def missing() -> list[Path]:
    programs = (default_build() / "rtud" / "rtud", default_program(), report_program())
    return [program for program in programs if not program.exists()]


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures the gateway beside the project report's method.")
    parser.add_argument("--quick", action="store_true", help="a try of some ten seconds")
    parser.add_argument("--output", type=Path, default=REPOSITORY / "build", help="folder for the table")
    arguments = parser.parse_args()
    if missing():
        names = ", ".join(map(str, missing()))
        print(f"not built: {names}; type `make bench`, which builds them", file=sys.stderr)
        return 2
    head = heading()
    try:
        found = rows(arguments.quick)
    except (ContenderError, GatewayError, LineSimError, StationError, OSError) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ninterrupted: nothing written", file=sys.stderr)
        return 1
    write(arguments.output, head, found)
    print(f"\n{head}\n\n{table(found)}\n\nAlso in {arguments.output}/bench.md and bench.json.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
