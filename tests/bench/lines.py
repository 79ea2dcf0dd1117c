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
from statistics import fmean
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
class Speeds:
    """Of the six lines, in bit/s."""

    text: str
    of: dict[int, int]  # by port


def alike(baud: int) -> Speeds:
    return Speeds(f"{baud} bit/s", dict.fromkeys(PORTS, baud))


UNLIKE = Speeds(
    "4800 to 115200 bit/s", dict(zip(PORTS, (4800, 9600, 19200, 38400, 57600, 115200), strict=True))
)
SPEEDS = (*map(alike, (9600, 19200, 38400, 115200)), UNLIKE)


@dataclass(frozen=True)
class Amounts:
    speeds: tuple[Speeds, ...]
    seconds: float  # of one reading
    readings: int
    dead_seconds: float  # of one reading beside a dead device, which is probed less and less often
    dead_readings: int


FULL, QUICK = Amounts(SPEEDS, 4.0, 5, 20.0, 2), Amounts((alike(DEAD_BAUD),), 0.5, 1, 0.5, 1)


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


Plans = dict[int, list[Block]]  # by port: the requests of a scan


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


def configuration(speeds: Speeds, apart: bool = False) -> dict[str, Any]:
    """Six lines, in one process or each in its own."""
    tables = {
        name: [{"address": address} for address in addresses] for name, (_, addresses) in TABLES.items()
    }
    slaves = [{"id": unit, **tables} for unit in UNITS]
    line = {"active": 1, "data_bits": 8, "stop_bits": STOP_BITS, "parity": 0, "slaves": slaves}
    ports = [
        {"value": port, "baud_rate": baud, **line, "process": port if apart else 1}
        for port, baud in speeds.of.items()
    ]
    return {"iec104": {"address": "127.0.0.1", "port": free_port()}, "port": ports}


@contextlib.contextmanager
def devices(speeds: Speeds, directory: Path) -> Iterator[LineSim]:
    config = directory / "devices.json"
    config.write_text(json.dumps(configuration(speeds)))
    with LineSim(config, None, directory / "dev", latency_us=LATENCY_US, trace=False) as lines:
        yield lines


@contextlib.contextmanager
def our_lines(name: str, speeds: Speeds, directory: Path) -> Iterator[list[int]]:
    with Gateway(configuration(speeds, name == APART), directory) as gateway:
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
def loops(name: str, speeds: Speeds, plans: Plans, directory: Path) -> Iterator[list[int]]:
    """A process a line."""
    with contextlib.ExitStack() as stack:
        pids = []
        for port, device in PORTS.items():
            line = [str(directory / "dev" / device), str(speeds.of[port]), str(STOP_BITS)]
            command = [*command_of(name), *line, *map(str, plans[port])]
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
def polling(name: str, speeds: Speeds, plans: Plans) -> Iterator[tuple[LineSim, list[int]]]:
    directory = run_directory()
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        lines = stack.enter_context(devices(speeds, directory))
        if name in (OURS, APART):
            yield lines, stack.enter_context(our_lines(name, speeds, directory))
        else:
            yield lines, stack.enter_context(loops(name, speeds, plans, directory))


# ---- what is measured --------------------------------------------------------------------------------


def plan_of(frames: list[bytes]) -> list[Block]:
    """Empty unless each request of a scan came twice, and some a third time."""
    if not frames or min(map(frames.count, set(frames))) < 2 or len(set(frames)) >= len(frames) // 2:
        return []
    return [Block.of_frame(frame) for frame in dict.fromkeys(frames)]


def plans_of(lines: LineSim) -> Plans:
    """As the devices see them."""
    lines.command("trace on")
    deadline = time.monotonic() + PLAN_TIMEOUT_S
    while time.monotonic() < deadline:
        received = [frame for frame in lines.frames() if frame.kind == "received"]
        plans = {port: plan_of([f.bytes for f in received if f.port == port]) for port in PORTS}
        if all(plans.values()):
            lines.command("trace off")
            return plans
        time.sleep(0.1)
    raise BenchError("no plan is to be seen on the lines")


@dataclass(frozen=True)
class Reading:
    """The six lines, over some seconds."""

    seconds: float
    requests: dict[int, int]  # by port
    busy_s: dict[int, float]  # by port: wire time of all octets
    cpu_s: float  # of all that poll
    switches: int  # to and from them

    @property
    def line_s(self) -> float:
        """Of all lines together."""
        return len(PORTS) * self.seconds

    def scans_s(self, plans: Plans) -> dict[int, float]:
        return {port: self.seconds * len(plan) / self.requests[port] for port, plan in plans.items()}

    def in_use(self, speeds: Speeds) -> dict[int, float]:
        """Part of the time: octets, and a silence behind request and answer."""
        return {
            port: (self.busy_s[port] + 2 * self.requests[port] * silence_s(baud)) / self.seconds
            for port, baud in speeds.of.items()
        }


def read(lines: LineSim, pids: list[int], seconds: float) -> Reading:
    def counters() -> tuple[int, dict[str, Any], int, int]:
        return time.monotonic_ns(), lines.stats(), sum(map(cpu_ns, pids)), sum(map(switches, pids))

    def counted(counter: str) -> dict[int, int]:
        return {port: stats[str(port)][counter] - stats_before[str(port)][counter] for port in PORTS}

    began_ns, stats_before, used_ns_before, switched_before = counters()
    time.sleep(seconds)
    ended_ns, stats, used_ns, switched = counters()
    requests = counted("requests")
    if not all(requests.values()):
        raise BenchError(f"requests by port: {requests}: the machine is too busy")
    return Reading(
        (ended_ns - began_ns) / 1e9,
        requests,
        {port: busy_ns / 1e9 for port, busy_ns in counted("busy_ns").items()},
        (used_ns - used_ns_before) / 1e9,
        switched - switched_before,
    )


def switches(pid: int) -> int:
    """How often it gave way or had to."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return sum(int(line.split()[1]) for line in lines if "ctxt_switches" in line)


def results_of(readings: list[Reading], plans: Plans, speeds: Speeds) -> dict[str, Spread]:
    """On average of the six lines."""
    limits = {port: limit_s(plan, speeds.of[port]) for port, plan in plans.items()}
    scans = [reading.scans_s(plans) for reading in readings]
    of_limits = [fmean(scan[port] / limits[port] for port in PORTS) for scan in scans]
    used = [fmean(reading.in_use(speeds).values()) for reading in readings]
    return {
        "requests of a scan": Spread("", [fmean(map(len, plans.values()))]),
        "scan": Spread("ms", [1000 * fmean(scan.values()) for scan in scans]),
        "scan / its limit": Spread("", of_limits),
        "line in use": Spread("%", [100 * part for part in used]),
        "values of a line": Spread("/s", [fmean(VALUES / each for each in scan.values()) for scan in scans]),
        "CPU of a line": Spread("ms/s", [1000 * r.cpu_s / r.line_s for r in readings]),
        "context switches of a line": Spread("/s", [r.switches / r.line_s for r in readings]),
    }


def read_anew(name: str, speeds: Speeds, plans: Plans, seconds: float) -> Reading:
    with polling(name, speeds, plans) as (lines, pids):
        return read(lines, pids, seconds)


def measured(speeds: Speeds, plans: dict[str, Plans], amounts: Amounts) -> list[dict[str, Spread]]:
    """Of each who polls. They take turns: what else the machine does meets them all."""
    readings: dict[str, list[Reading]] = {name: [] for name in NAMES}
    for turn in range(1, amounts.readings + 1):
        for name in NAMES:
            readings[name].append(read_anew(name, speeds, plans[name], amounts.seconds))
        print(f"  {speeds.text}: {turn} of {amounts.readings} readings", file=sys.stderr, flush=True)
    return [results_of(readings[name], plans[name], speeds) for name in NAMES]


def our_plans(speeds: Speeds) -> Plans:
    with polling(OURS, speeds, {}) as (lines, _):
        return plans_of(lines)


def cost_of_a_dead_device(name: str, plans: Plans, amounts: Amounts) -> Spread:
    """Of the line's time, in percent: what is left of the scans that the living could have."""
    plan = plans[min(PORTS)]
    living = [block for block in plan if block.unit != DEAD]
    with polling(name, alike(DEAD_BAUD), plans) as (lines, pids):
        before = read(lines, pids, amounts.seconds)
        for port in PORTS:
            lines.fault(f"{port}.{DEAD}", "mute")
        time.sleep(SETTLE_S)
        after = [read_living(lines, amounts.dead_seconds) for _ in range(amounts.dead_readings)]
    share = limit_s(living, DEAD_BAUD) / limit_s(plan, DEAD_BAUD)
    scan_s = fmean(before.scans_s(plans).values()) * share
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
    for speeds in amounts.speeds:
        ours = our_plans(speeds)
        plans = {name: dict.fromkeys(PORTS, each_point()) if name == REPORT else ours for name in NAMES}
        columns = measured(speeds, plans, amounts)
        for text in columns[0]:
            yield f"{speeds.text}: {text}", [column[text] for column in columns]
        if speeds == alike(DEAD_BAUD):
            costs = [cost_of_a_dead_device(name, plans[name], amounts) for name in NAMES]
            yield f"{speeds.text}: time lost to a dead device", costs


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
        f"{machine()}. Median (minimum..maximum) of {amounts.readings} readings of {amounts.seconds:g} s "
        f"by turns, with a dead device {amounts.dead_readings} of {amounts.dead_seconds:g} s."
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
