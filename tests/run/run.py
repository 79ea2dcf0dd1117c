# SPDX-License-Identifier: GPL-3.0-or-later
"""All tests, in parts that are goals of make: what runs beside what, what each took, which failed.

Two things run beside each other. First the parts that compile, with the kernels and the images in the time
that their tests wait (nice); then test-native, which waits half of its time, with test-linux, which fills a
core for each guest. What several of them need is built before, by one make. Of the downloads and the
configuring, which wait as well, two run at a time.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

COMPILING = ["lint", "unit", "coverage", "asan", "cross", "fuzzers", "test-sanitizers"]
PARTS = [*COMPILING, "test-native", "test-linux"]
LOGS = Path("build/log")
TIMES = Path("build/times")
TAIL_LINES = 40
LOOK_S = 0.5


@dataclass
class Report:
    """Which part took how long, and which failed."""

    begun_s: float = field(default_factory=time.monotonic)
    took: list[tuple[str, float]] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    def ended(self, what: str, *, failed: str = "") -> None:
        """The next one begins where this one has ended."""
        now_s = time.monotonic()
        self.took.append((what, now_s - self.begun_s))
        self.begun_s = now_s
        if failed:
            self.failed.append(failed)

    def run(self, part: str, *goals: str) -> None:
        self.ended(part, failed="" if make(*(goals or [part])) else part)

    def conclude(self) -> int:
        sys.stdout.flush()
        subprocess.run(
            [sys.executable, Path(__file__).with_name("times.py"), *map(str, sorted(TIMES.glob("*.json")))],
            check=False,
        )
        print("the parts:", *(f"{took_s:6.0f} s  {part}" for part, took_s in self.took), sep="\n")
        if self.failed:
            print(f"make test: failed: {' '.join(self.failed)}", file=sys.stderr)
        return 1 if self.failed else 0


def make(*goals: str) -> bool:
    """Whether it went well. Its jobs are those of the make that has started us, if that has some."""
    sys.stdout.flush()
    return subprocess.run(["make", *goals], check=False, close_fds=False).returncode == 0


@contextmanager
def beside(name: str, script: str) -> Iterator[subprocess.Popen[bytes]]:
    """A shell's script that runs beside what follows, into a log; it ends with us."""
    LOGS.mkdir(parents=True, exist_ok=True)
    print(f"test: runs {name} beside what follows; log: {log_of(name)}", flush=True)
    with log_of(name).open("wb") as log:
        process = subprocess.Popen(
            ["bash", "-c", script],
            stdout=log,
            stderr=subprocess.STDOUT,
            close_fds=False,
            start_new_session=True,
        )
    try:
        yield process
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGTERM)
            process.wait()


def log_of(name: str) -> Path:
    return LOGS / f"{name}.log"


def show_end(name: str) -> None:
    lines = log_of(name).read_text(errors="replace").splitlines()
    print(*lines[-TAIL_LINES:], sep="\n", flush=True)


def follow(name: str, process: subprocess.Popen[bytes]) -> None:
    """What it has written and still writes, until it ends."""
    with log_of(name).open("rb") as log:
        while process.poll() is None:
            shutil.copyfileobj(log, sys.stdout.buffer)
            sys.stdout.flush()
            time.sleep(LOOK_S)
        shutil.copyfileobj(log, sys.stdout.buffer)
        sys.stdout.flush()


def run_all(report: Report) -> None:
    report.run("build", "--jobs", "2", ".shared")
    builds, native = "test-linux-build", "test-native"
    with beside(builds, "nice make --jobs 2 .linux-alone && nice make image-debian lab") as linux_built:
        for part in COMPILING:
            report.run(part)
        with beside(native, f"make {native}") as native_tested:
            if linux_built.wait():
                show_end(builds)
            report.ended("rest of test-linux's builds")  # what they lack, test-linux will say
            report.run("test-linux")
            follow(native, native_tested)
            report.ended(f"rest of {native}", failed=native if native_tested.returncode else "")


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", nargs="+", choices=PARTS, metavar="PART", help=f"these, one by one: {', '.join(PARTS)}"
    )
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    shutil.rmtree(TIMES, ignore_errors=True)
    report = Report()
    if arguments.only:
        for part in arguments.only:
            report.run(part)
    else:
        run_all(report)
    return report.conclude()


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(128 + signal.SIGINT)
