#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""`make busy`: targets of the Makefile, again and again, beside busy processes of the same priority.

What passes on an idle machine alone is not proven: a new user's machine is not idle. Exit code 0: all passed;
1: not all; 2: wrong usage.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TARGETS = ("run-native", "run", "twin", "test-quick")
SPIN = "while True: pass"


@dataclass
class Tally:
    """What came of one target."""

    target: str
    seconds: list[float] = field(default_factory=list)  # of those that passed
    failures: list[Path] = field(default_factory=list)  # their logs


@contextlib.contextmanager
def busy_processes(count: int, processors: set[int] | None = None) -> Iterator[None]:
    """So many processes that compute without end, all on these processors."""
    processes = [subprocess.Popen([sys.executable, "-c", SPIN]) for _ in range(count)]
    try:
        for process in processes:
            os.sched_setaffinity(process.pid, processors or os.sched_getaffinity(0))
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def keep_details(target: str, log: Path, since: float) -> None:
    """What a failed show or step has written to a file, which the next replaces, at the end of its log."""
    failed = re.findall(r"\* (\S+): failed after", log.read_text(errors="replace"))
    for name in (f"{target}-failed", *failed):
        details = ROOT / "build" / "log" / f"{name}.log"
        if details.exists() and details.stat().st_mtime >= since:
            with log.open("ab") as output:
                output.write(details.read_bytes())


def run_once(tally: Tally, log: Path) -> None:
    """Makes the target; its output goes to the log."""
    start, since = time.monotonic(), time.time()
    with log.open("wb") as output:
        command = ["make", "--no-print-directory", tally.target]
        done = subprocess.run(
            command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT, check=False
        )
    seconds = time.monotonic() - start
    load = os.getloadavg()[0]
    if done.returncode:
        tally.failures.append(log)
        keep_details(tally.target, log, since)
    else:
        tally.seconds.append(seconds)
    verdict = f"FAILED, {log}" if done.returncode else "passed"
    print(f"{log.stem:>16}  {seconds:6.0f} s  load {load:5.1f}  {verdict}", flush=True)


def table(tallies: list[Tally]) -> str:
    """Passes, times and failures, a line a target."""
    lines = [f"{'target':<12} {'passed':>9} {'least':>7} {'median':>7} {'most':>7}  failures"]
    for tally in tallies:
        runs = len(tally.seconds) + len(tally.failures)
        of_times = (min, statistics.median, max)
        figures = " ".join(f"{f(tally.seconds):5.0f} s" if tally.seconds else "      -" for f in of_times)
        failed = ", ".join(log.name for log in tally.failures) or "none"
        lines.append(f"{tally.target:<12} {f'{len(tally.seconds)} of {runs}':>9} {figures}  {failed}")
    return "\n".join(lines)


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="make busy", description=__doc__.splitlines()[0])
    parser.add_argument("targets", nargs="*", default=TARGETS, help=f"[{' '.join(TARGETS)}]")
    parser.add_argument("--processes", type=int, default=8, help="busy processes beside them [8]")
    parser.add_argument("--times", type=int, default=20, help="runs of each target [20]")
    logs = ROOT / "build" / "busy"
    parser.add_argument("--logs", type=Path, default=logs, help=f"folder for their output [{logs}]")
    arguments = parser.parse_args()
    if arguments.processes < 0 or arguments.times < 1:
        parser.error("--processes is 0 or more, --times 1 or more")
    arguments.logs.mkdir(parents=True, exist_ok=True)
    tallies = [Tally(target) for target in arguments.targets]
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the busy processes would outlive it
    try:
        with busy_processes(arguments.processes):
            for number in range(1, arguments.times + 1):
                for tally in tallies:
                    run_once(tally, arguments.logs / f"{tally.target}-{number}.log")
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 1
    finally:
        print(f"\nbeside {arguments.processes} busy processes on {os.cpu_count()} cores:")
        print(table(tallies))
    return 1 if any(tally.failures for tally in tallies) else 0


if __name__ == "__main__":
    sys.exit(main())
