# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: six lines at once, polled by rtu-modbus, by pymodbus, by plain libmodbus and by the report's
method (a request a point). What the rows mean: docs/bench.md. No time is asserted.
Exit codes: 0 done, 1 something did not work, 2 not built.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from contenders import report_program
from stopwatch import Spread, cpu_ns

from bench import machine
from lab.gateway import Gateway, GatewayError, default_build, free_port, remove, run_directory
from lab.linesim import LineSim, LineSimError, default_program

PORTS = {1: "ttyS1", 2: "ttyS2", 3: "ttyS3", 4: "ttyS4", 5: "ttyS6", 6: "ttyS8"}
UNITS = (11, 12, 13)
DEAD = 12
STOP_BITS = 2
CHAR_BITS = 1 + 8 + STOP_BITS
TABLES = {  # of each device: function code, and the addresses
    "coils": (1, range(16)),
    "discrete_inputs": (2, range(32)),
    "input_registers": (4, range(24)),
    "holding_registers": (3, (*range(12), *range(20, 28))),
}
VALUES = len(UNITS) * sum(len(addresses) for _, addresses in TABLES.values())  # of a line
LATENCY_US = 2000
BAUDS = (9600, 19200, 38400, 115200)
DEAD_BAUD = 19200
OURS, APART, PYMODBUS, LIBMODBUS, REPORT = NAMES = (
    "ours, one process",
    "ours, six processes",
    "pymodbus",
    "libmodbus",
    "report's method",
)
PLAN_TIMEOUT_S = 30.0
SETTLE_S = 3.0  # a dead device is found out in less


class BenchError(Exception):
    """Something that is measured does not run."""


@dataclass(frozen=True)
class Amounts:
    bauds: tuple[int, ...]
    seconds: float  # of one reading
    readings: int
    dead_seconds: float  # of one reading beside a dead device, which is probed ever more rarely
    dead_readings: int


FULL, QUICK = Amounts(BAUDS, 6.0, 3, 20.0, 2), Amounts((DEAD_BAUD,), 0.5, 1, 0.5, 1)


# ---- the line's arithmetic ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Block:
    """A read request."""

    unit: int
    function: int
    address: int
    count: int

    @classmethod
    def of_frame(cls, frame: bytes) -> Block:
        return cls(frame[0], frame[1], int.from_bytes(frame[2:4]), int.from_bytes(frame[4:6]))

    @property
    def octets(self) -> int:
        """Of the request and its answer."""
        data = (self.count + 7) // 8 if self.function <= 2 else 2 * self.count
        return 8 + 5 + data

    def __str__(self) -> str:
        return f"{self.unit}:{self.function}:{self.address}:{self.count}"


def silence_s(baud: int) -> float:
    """3.5 characters; fixed above 19200 bit/s (MODBUS over Serial Line V1.02, 2.5.1.1)."""
    return 0.00175 if baud > 19200 else 3.5 * CHAR_BITS / baud


def limit_s(plan: list[Block], baud: int) -> float:
    """The shortest scan: each octet, a silence behind request and answer, the device's latency."""
    octets = sum(block.octets for block in plan)
    return octets * CHAR_BITS / baud + len(plan) * (2 * silence_s(baud) + LATENCY_US / 1e6)


def each_point() -> list[Block]:
    """The report's plan (figure 5.4): a request a point."""
    return [
        Block(unit, function, address, 1)
        for unit in UNITS
        for function, addresses in TABLES.values()
        for address in addresses
    ]


# ---- what polls --------------------------------------------------------------------------------------


def configuration(baud: int, apart: bool = False) -> dict[str, Any]:
    """Six lines alike, in one process or each in its own."""
    tables = {
        name: [{"address": address} for address in addresses] for name, (_, addresses) in TABLES.items()
    }
    slaves = [{"id": unit, **tables} for unit in UNITS]
    line = {"active": 1, "baud_rate": baud, "data_bits": 8, "stop_bits": STOP_BITS, "parity": 0}
    ports = [{"value": port, **line, "slaves": slaves, "process": port if apart else 1} for port in PORTS]
    return {"iec104": {"address": "127.0.0.1", "port": free_port()}, "port": ports}


@contextlib.contextmanager
def devices(baud: int, directory: Path) -> Iterator[LineSim]:
    config = directory / "devices.json"
    config.write_text(json.dumps(configuration(baud)))
    with LineSim(config, None, directory / "dev", latency_us=LATENCY_US, trace=False) as lines:
        yield lines


@contextlib.contextmanager
def our_lines(name: str, baud: int, directory: Path) -> Iterator[list[int]]:
    with Gateway(configuration(baud, name == APART), directory) as gateway:
        gateway.wait_for(
            lambda: all(point["quality"] == "good" for point in gateway.points().values()), 60, "all is read"
        )
        modules = gateway.modules().items()
        yield [module["pid"] for name, module in modules if name.startswith("rtu-modbus")]


def command_of(name: str) -> list[str | Path]:
    if name == PYMODBUS:
        return [sys.executable, Path(__file__).with_name("pymodbus_line.py")]
    return [line_loop()]


@contextlib.contextmanager
def loops(name: str, baud: int, plan: list[Block], directory: Path) -> Iterator[list[int]]:
    """A process a line."""
    with contextlib.ExitStack() as stack:
        pids = []
        for device in PORTS.values():
            path = directory / "dev" / device
            command = [*command_of(name), path, str(baud), str(STOP_BITS), *map(str, plan)]
            process = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
            stack.callback(process.kill)
            assert process.stdout is not None
            if process.stdout.readline() != "ready\n":
                raise BenchError(f"{name} did not start: exit code {process.wait()}")
            pids.append(process.pid)
        yield pids


def line_loop() -> Path:
    return report_program().with_name("line_loop")


@contextlib.contextmanager
def polling(name: str, baud: int, plan: list[Block], directory: Path) -> Iterator[tuple[LineSim, list[int]]]:
    with contextlib.ExitStack() as stack:
        lines = stack.enter_context(devices(baud, directory))
        if name in (OURS, APART):
            yield lines, stack.enter_context(our_lines(name, baud, directory))
        else:
            yield lines, stack.enter_context(loops(name, baud, plan, directory))


# ---- what is measured --------------------------------------------------------------------------------


def plan_of(lines: LineSim) -> list[Block]:
    """The requests of a scan, as the first line's devices see them: until each came twice."""
    port = next(iter(PORTS))
    lines.command("trace on")
    deadline = time.monotonic() + PLAN_TIMEOUT_S
    while time.monotonic() < deadline:
        frames = [f.bytes for f in lines.frames() if f.kind == "received" and f.port == port]
        if frames and min(map(frames.count, set(frames))) > 1 and len(set(frames)) < len(frames) // 2:
            lines.command("trace off")
            return [Block.of_frame(frame) for frame in dict.fromkeys(frames)]
        time.sleep(0.1)
    raise BenchError("no plan is to be seen on the line")


@dataclass(frozen=True)
class Reading:
    """The six lines together, over some seconds."""

    line_s: float  # six times what elapsed
    requests: int
    busy_s: float  # wire time of all octets
    cpu_s: float  # of all that poll
    switches: int  # to and from them


def read(lines: LineSim, pids: list[int], seconds: float) -> Reading:
    def counters() -> tuple[int, int, int, int, int]:
        all_stats = lines.stats()
        stats = [all_stats[str(port)] for port in PORTS]
        sums = (sum(each[counter] for each in stats) for counter in ("requests", "busy_ns"))
        return (len(PORTS) * time.monotonic_ns(), *sums, sum(map(cpu_ns, pids)), sum(map(switches, pids)))

    begun = counters()
    time.sleep(seconds)
    line_ns, requests, busy_ns, used_ns, switched = (
        after - before for before, after in zip(begun, counters(), strict=True)
    )
    return Reading(line_ns / 1e9, requests, busy_ns / 1e9, used_ns / 1e9, switched)


def switches(pid: int) -> int:
    """How often it gave way or had to."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return sum(int(line.split()[1]) for line in lines if "ctxt_switches" in line)


def results_of(readings: list[Reading], plan: list[Block], baud: int) -> dict[str, Spread]:
    """On average of the six lines."""
    limit = limit_s(plan, baud)
    scans = [reading.line_s * len(plan) / reading.requests for reading in readings]
    used = [r.busy_s + 2 * r.requests * silence_s(baud) for r in readings]
    return {
        "requests of a scan": Spread("", [len(plan)]),
        "scan": Spread("ms", [1000 * scan for scan in scans]),
        "scan / its limit": Spread("", [scan / limit for scan in scans]),
        "line in use": Spread("%", [100 * use / r.line_s for use, r in zip(used, readings, strict=True)]),
        "values of a line": Spread("/s", [VALUES / scan for scan in scans]),
        "CPU of a line": Spread("ms/s", [1000 * r.cpu_s / r.line_s for r in readings]),
        "context switches of a line": Spread("/s", [r.switches / r.line_s for r in readings]),
    }


def measured(name: str, baud: int, plan: list[Block], amounts: Amounts) -> dict[str, Spread]:
    directory = run_directory()
    try:
        with polling(name, baud, plan, directory) as (lines, pids):
            readings = [read(lines, pids, amounts.seconds) for _ in range(amounts.readings)]
            return results_of(readings, plan, baud)
    finally:
        remove(directory)


def our_plan(baud: int) -> list[Block]:
    directory = run_directory()
    try:
        with polling(OURS, baud, [], directory) as (lines, _):
            return plan_of(lines)
    finally:
        remove(directory)


def cost_of_a_dead_device(name: str, plan: list[Block], amounts: Amounts) -> Spread:
    """Of the line's time, in percent: what is left of the scans that the living could have."""
    living = [block for block in plan if block.unit != DEAD]
    directory = run_directory()
    try:
        with polling(name, DEAD_BAUD, plan, directory) as (lines, pids):
            before = read(lines, pids, amounts.seconds)
            for port in PORTS:
                lines.fault(f"{port}.{DEAD}", "mute")
            time.sleep(SETTLE_S)
            after = [read_living(lines, amounts.dead_seconds) for _ in range(amounts.dead_readings)]
    finally:
        remove(directory)
    share = limit_s(living, DEAD_BAUD) / limit_s(plan, DEAD_BAUD)
    scan_s = before.line_s * len(plan) / before.requests * share
    return Spread("%", [100 * (1 - answers * scan_s / len(living)) for answers in after])


def read_living(lines: LineSim, seconds: float) -> float:
    """Answers of a line's living devices a second."""

    def answers() -> int:
        stats = lines.stats()
        slaves = [stats[str(port)]["slaves"] for port in PORTS]
        return sum(each[str(unit)]["answers"] for each in slaves for unit in UNITS if unit != DEAD)

    begun, before = time.monotonic(), answers()
    time.sleep(seconds)
    return (answers() - before) / (time.monotonic() - begun) / len(PORTS)


# ---- the table ---------------------------------------------------------------------------------------


def rows(amounts: Amounts) -> Iterator[tuple[str, list[Spread]]]:
    for baud in amounts.bauds:
        plan = our_plan(baud)
        plans = {name: each_point() if name == REPORT else plan for name in NAMES}
        columns = []
        for name, blocks in plans.items():
            columns.append(measured(name, baud, blocks, amounts))
            print(f"  {baud} bit/s, {name}: scan {columns[-1]['scan']}", file=sys.stderr, flush=True)
        for text in columns[0]:
            yield f"{baud} bit/s: {text}", [column[text] for column in columns]
        if baud == DEAD_BAUD:
            costs = [cost_of_a_dead_device(name, blocks, amounts) for name, blocks in plans.items()]
            yield f"{baud} bit/s: time lost to a dead device", costs


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures six lines at once, by four who poll them.")
    parser.add_argument("--quick", action="store_true", help="a try of some thirty seconds")
    amounts = QUICK if parser.parse_args().quick else FULL
    missing = [
        file
        for file in (line_loop(), default_build() / "rtud" / "rtud", default_program())
        if not file.exists()
    ]
    if missing:
        print(
            f"not built: {', '.join(map(str, missing))}; type `make bench`, which builds it", file=sys.stderr
        )
        return 2
    head = (
        f"{machine()}. Median (minimum..maximum) of {amounts.readings} readings of {amounts.seconds:g} s, "
        f"with a dead device {amounts.dead_readings} of {amounts.dead_seconds:g} s."
    )
    try:
        found = list(rows(amounts))
    except (BenchError, GatewayError, LineSimError, OSError) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1
    print(f"\n{head}\n\n| six lines at once | {' | '.join(NAMES)} |\n|---{len(NAMES) * '|---'}|")
    for text, cells in found:
        print(f"| {text} | {' | '.join(str(cell).strip() for cell in cells)} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
