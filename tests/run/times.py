# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests cost: seconds and processor seconds by area, and the slowest, at the end of a run.

As a plugin (conftest.py registers it) for one run of pytest, which leaves its numbers in the file that
OPENRTU_TIMES names. As a program, `python tests/run/times.py FILE ...`, for several runs together.
"""

import json
import os
import resource
import sys
import time
from collections import defaultdict
from collections.abc import Generator, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import pytest

from areas import area_of

SLOWEST = 10
ALONE = "-alone.json"  # the end of the name of alone.py's second run
CPU = "cpu_s"


@dataclass
class Cost:
    """Of one test, or of several."""

    tests: int = 0
    failed: int = 0
    seconds: float = 0.0  # elapsed; set-up and tear-down included
    cpu_s: float = 0.0  # of pytest's process and of those that it started and that ended

    def add(self, other: "Cost") -> None:
        self.tests += other.tests
        self.failed += other.failed
        self.seconds += other.seconds
        self.cpu_s += other.cpu_s


def cpu_s() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


class Times:
    """The plugin. With xdist the workers measure, and the reports bring it to where the table is printed."""

    def __init__(self) -> None:
        self._costs: dict[str, Cost] = defaultdict(Cost)
        self._last: dict[str, tuple[float, str]] = {}  # of each worker the last test: its end, its name
        self._begun_s = time.time()
        self._cpu_before_s = 0.0
        self._whole = True

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, error: object) -> None:
        """Of xdist: a worker has ended. With one that crashed ends the run, whatever is left."""
        self._whole = self._whole and not error

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self) -> Generator[None, object, object]:
        self._cpu_before_s = cpu_s()
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        if report.when == "teardown":
            report.user_properties.append((CPU, cpu_s() - self._cpu_before_s))
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        cost = self._costs[report.nodeid]
        cost.tests = 1
        cost.failed = max(cost.failed, int(report.failed))
        cost.seconds += report.duration
        cost.cpu_s += sum(value for name, value in report.user_properties if name == CPU)
        if worker := getattr(report, "worker_id", ""):
            self._last[worker] = (report.stop, report.nodeid)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if not self._costs:
            return
        ended_s = time.time()
        terminalreporter.section("what the tests cost")
        for line in table(self._costs, ended_s - self._begun_s):
            terminalreporter.write_line(line)
        for worker, (stopped_s, test) in sorted(self._last.items()):
            terminalreporter.write_line(f"{worker} ended after {stopped_s - self._begun_s:.0f} s with {test}")
        if file := os.environ.get("OPENRTU_TIMES"):
            Path(file).parent.mkdir(parents=True, exist_ok=True)
            costs = {test: asdict(cost) for test, cost in self._costs.items()}
            run = {"begun_s": self._begun_s, "ended_s": ended_s, "whole": self._whole, "costs": costs}
            Path(file).write_text(json.dumps(run))


def table(costs: dict[str, Cost], elapsed_s: float) -> Iterable[str]:
    areas: dict[str, Cost] = defaultdict(Cost)
    total = Cost()
    for test, cost in costs.items():
        areas[area_of(test)].add(cost)
        total.add(cost)
    yield f"{'area':<12}{'tests':>8}{'failed':>8}{'seconds':>10}{'CPU s':>10}"
    for area, cost in sorted(areas.items(), key=lambda pair: -pair[1].seconds):
        yield f"{area:<12}{cost.tests:>8}{cost.failed:>8}{cost.seconds:>10.1f}{cost.cpu_s:>10.1f}"
    yield f"{'all':<12}{total.tests:>8}{total.failed:>8}{total.seconds:>10.1f}{total.cpu_s:>10.1f}"
    yield f"elapsed: {elapsed_s:.0f} s"
    yield f"the {SLOWEST} slowest:"
    for test, cost in sorted(costs.items(), key=lambda pair: -pair[1].seconds)[:SLOWEST]:
        yield f"{cost.seconds:>8.1f} s {cost.cpu_s:>8.1f} CPU s  {test}"


def failed_tests(file: Path) -> list[str]:
    """Of the run that left this file; none if it left none, or a worker's crash ended it before its time."""
    run = json.loads(file.read_text()) if file.exists() else {"whole": False}
    return [test for test, cost in run["costs"].items() if cost["failed"]] if run["whole"] else []


def passed_alone(file: Path) -> Iterable[str]:
    """Of alone.py's second run; nothing if it left none."""
    if file.exists():
        for test, cost in json.loads(file.read_text())["costs"].items():
            if not cost["failed"]:
                yield f"passed only alone: {test}"


def main(files: list[str]) -> int:
    costs: dict[str, Cost] = defaultdict(Cost)
    runs = [json.loads(Path(file).read_text()) for file in files]
    # From the first's begin to the last's end: they run beside each other.
    elapsed_s = max((run["ended_s"] for run in runs), default=0.0) - min(
        (run["begun_s"] for run in runs), default=0.0
    )
    for run in runs:
        for test, cost in run["costs"].items():
            costs[test].add(Cost(**cost))
    print(*table(costs, elapsed_s), sep="\n")
    for file in files:
        if file.endswith(ALONE):
            print(*passed_alone(Path(file)), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
