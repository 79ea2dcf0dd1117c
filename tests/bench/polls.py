# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: figure 9 of the positioning paper. Controlling stations poll n RTUs for a position, in turn and
all together, beside a bare loop that only sends and receives; rtu-centre also polls 10 000 by itself.
What the rows mean: docs/bench.md. No time is asserted.
Exit codes: 0 done, 1 something did not work, 2 wrong usage or not built.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stopwatch import Spread, cpu_ns

from bench import machine
from lab.gateway import REPOSITORY, Gateway, GatewayError, default_build, free_port, remove, run_directory

FLOOR, UVLOOP, ASYNCIO, C104 = "C loop", "uvloop", "asyncio", "c104"
CENTRE, PLAN, SHARDS = "rtu-centre", "rtu-centre, its plan", "rtu-centre, 2 shards"
TURN, TOGETHER = "turn", "together"
PROCESSES_MAX = 100  # RTUs that are a process each
GATEWAYS = 10
C104_MAX = 10  # more connections of c104 do not all start on a busy machine
SHARD_COUNT = 2
POLLED_SECONDS = 10
DUE_AT_ONCE = 1000  # polls of a plan that is never done: more than a machine sends in PLAN_MS
PLAN_MS = 10
READS_MAX = 64
PAPER_MS = 0.14  # of each RTU, by the paper's own sum: 764 ms = 750 ms + 100 times 0.14 ms
ROUNDS = REPOSITORY / "build" / "bench" / "poll_rounds"
RTUS = default_build() / "centre" / "centre-rtus"
PROGRAM = default_build() / "centre" / "rtu-centre"
CLIENTS = Path(__file__).with_name("poll_clients.py")
HEADINGS = ("RTUs", "polled", "by", "µs an RTU", "CPU µs a poll", "C loops")


class PollError(Exception):
    """A contender did not do its work."""


@dataclass(frozen=True)
class Case:
    """So many RTUs, polled so often."""

    count: int
    rounds: int
    wait_ms: int = 0
    real: bool = False  # rtu-iec104 instead of simulated ones

    @property
    def rtus(self) -> str:
        if self.real:
            return f"{self.count} rtu-iec104"
        return f"{self.count} processes" if self.count <= PROCESSES_MAX else f"{self.count} in one process"


FULL = (
    *(Case(count, 100) for count in (10, 25, 50, 100)),
    *(Case(100, 5, wait_ms) for wait_ms in (250, 500, 1000, 2000)),
    Case(GATEWAYS, 100, real=True),
    Case(1000, 20),
    Case(10_000, 5),
)
QUICK = (Case(5, 5), Case(100, 3, 10), Case(2, 5, real=True))


@dataclass(frozen=True)
class Row:
    case: Case
    mode: str
    name: str
    time: Spread  # µs an RTU, a value each round
    cpu_us: float  # of the controlling station's process, a poll

    def cells(self, floor: Row) -> tuple[str, ...]:
        pause = f", {self.case.wait_ms} ms between rounds" if self.case.wait_ms else ""
        ratio = f"{self.time.middle / floor.time.middle:.2f}"
        return (
            f"{self.case.rtus}{pause}",
            self.mode,
            self.name,
            str(self.time),
            f"{self.cpu_us:.1f}",
            ratio,
        )


# ---- RTUs ----------------------------------------------------------------------------------------------


@contextlib.contextmanager
def simulated(count: int, kind: str) -> Iterator[int]:
    port = free_port()
    command = [RTUS, str(count), str(port), kind, "0", "each" if count <= PROCESSES_MAX else "one"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin
        assert process.stdout
        if process.stdout.readline() != "ready\n":
            raise PollError("centre-rtus did not start: is the limit of open files high enough?")
        try:
            yield port
        finally:
            process.stdin.close()


@contextlib.contextmanager
def gateways(count: int) -> Iterator[int]:
    """Each with a receiver that says nothing: its position is invalid, and as long as any."""
    port = free_port()
    with contextlib.ExitStack() as stack:
        for number in range(count):
            directory = run_directory()
            stack.callback(remove, directory)
            (directory / "dev").mkdir()
            receiver = {"name": "van", "device": "gps1", "ca": 1, "ioa": 2, "position_ioa": 1}
            address = {"address": f"127.1.0.{1 + number}", "port": port}
            stack.enter_context(Gateway({"iec104": address, "port": [], "gps": [receiver]}, directory))
        yield port


# ---- contenders ----------------------------------------------------------------------------------------


def measured(command: list[Any], case: Case, processes: list[int] | None = None) -> tuple[list[int], float]:
    """Nanoseconds of each round; µs of CPU of all: of the processes named, or of the command's own."""
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdin
        assert process.stdout
        assert process.stderr
        if process.stdout.readline() != "ready\n":
            raise PollError(process.stderr.read().strip() or f"{command[0]} ended")
        pids = processes or [process.pid]
        used = sum(map(cpu_ns, pids))
        process.stdin.write("go\n")
        process.stdin.flush()
        times = [int(process.stdout.readline()) for _ in range(case.rounds)]
        used = sum(map(cpu_ns, pids)) - used
        process.stdin.close()
        process.stdout.read()
        process.stderr.read()
    return times, used / 1000


@dataclass(frozen=True)
class Centre:
    """The processes that poll, and the socket of each."""

    pids: list[int]
    sockets: list[Path]


@contextlib.contextmanager
def centre(
    case: Case, port: int, shards: int = 1, reads: Sequence[Any] = (), polls_at_once: int = 1024
) -> Iterator[Centre]:
    """rtu-centre, with these keys in its file."""
    stations = [
        {"name": f"rtu{number}", "address": f"127.1.{number // 250}.{1 + number % 250}"}
        for number in range(case.count)
    ]
    defaults = {"port": port, "common_addresses": [1], "interrogate_at_start": False, "reads": reads}
    settings = {"defaults": defaults, "stations": stations, "polls_at_once": polls_at_once, "shards": shards}
    with tempfile.TemporaryDirectory(prefix="polls-") as folder:
        file, path = Path(folder) / "centre.json", Path(folder) / "consumer"
        file.write_text(json.dumps(settings))
        sockets = [Path(f"{path}.{shard}") for shard in range(shards)] if shards > 1 else [path]
        with subprocess.Popen(
            [PROGRAM, "--socket", path, file], stderr=subprocess.PIPE, text=True
        ) as process:
            assert process.stderr
            for _ in sockets:
                if not any("waits for a consumer" in line for line in process.stderr):
                    raise PollError("rtu-centre does not take its consumer")
            rest = threading.Thread(target=process.stderr.read)  # what it says must not fill the pipe
            rest.start()
            children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text()
            try:
                yield Centre([int(pid) for pid in children.split()] or [process.pid], sockets)
            finally:
                process.terminate()
                rest.join()


def read_each(period_ms: int) -> dict[str, int]:
    return {"common_address": 1, "ioa": 1, "period_ms": period_ms}


def by_plan(case: Case, port: int) -> tuple[list[int], float]:
    """rtu-centre by itself: one poll under way, and always another that is due."""
    reads = [read_each(PLAN_MS)] * min(READS_MAX, math.ceil(DUE_AT_ONCE / case.count))
    with centre(case, port, reads=reads, polls_at_once=1) as ours:
        command = [ROUNDS, "plan", str(case.count), str(case.rounds), *ours.sockets]
        return measured(command, case, ours.pids)


def row(case: Case, mode: str, name: str, port: int) -> Row:
    amounts = [mode, str(case.count), str(case.rounds), str(case.wait_ms)]
    if name == PLAN:
        times, used = by_plan(case, port)
    elif name in (CENTRE, SHARDS):
        with centre(case, port, SHARD_COUNT if name == SHARDS else 1) as ours:
            times, used = measured([ROUNDS, "centre", *amounts, *ours.sockets], case, ours.pids)
    elif name == FLOOR:
        times, used = measured([ROUNDS, "floor", *amounts, str(port)], case)
    else:
        times, used = measured([sys.executable, CLIENTS, name, *amounts, str(port)], case)
    found = Row(
        case,
        mode,
        name,
        Spread("µs", [time / 1000 / case.count for time in times]),
        used / case.count / case.rounds,
    )
    print(f"  {case.rtus}, {mode}, {name}: {found.time}", flush=True)
    return found


def contenders(case: Case, mode: str) -> Iterator[str]:
    yield from (FLOOR, CENTRE)
    if mode == TOGETHER and case.count > PROCESSES_MAX:
        yield SHARDS
    if mode == TURN and not case.wait_ms:  # a pause is no part of a plan
        yield PLAN
    if case.count <= 1000:
        yield from (UVLOOP, ASYNCIO)
    if case.count <= C104_MAX and not case.real and mode == TURN:
        yield C104


def rows(cases: tuple[Case, ...]) -> Iterator[Row]:
    for case in cases:
        for mode in (TURN,) if case.wait_ms else (TURN, TOGETHER):  # the paper polls in turn
            for name in contenders(case, mode):
                kind = "f" if name == C104 else "h"  # which it knows
                try:
                    with gateways(case.count) if case.real else simulated(case.count, kind) as port:
                        yield row(case, mode, name, port)
                except PollError as error:
                    if name != C104:  # its connections do not all start on a busy machine
                        raise
                    print(f"  {case.rtus}, {mode}, {name}: left out: {error}", flush=True)


def polled_each_second(count: int, seconds: int, shards: int) -> str:
    """rtu-centre by itself, at 1 Hz."""
    case = Case(count, 1)
    with simulated(count, "h") as port, centre(case, port, shards, reads=[read_each(1000)]) as ours:
        command = [ROUNDS, "count", str(count), str(seconds), *ours.sockets]
        positions, used_us = measured(command, case, ours.pids)
    each_us = used_us / positions[0]
    processes = "one process" if shards == 1 else f"{shards} shards"
    return (
        f"rtu-centre, {processes}, polls {count} RTUs at 1 Hz for {seconds} s:"
        f" {positions[0] / seconds:.0f} positions"
        f" a second handed on, {used_us / seconds / 10_000:.1f} % of a core; {each_us:.1f} µs of CPU each,"
        f" so {count * each_us / 10_000:.1f} % of a core for all {count} each second"
    )


# ---- the table and the picture -------------------------------------------------------------------------


def table(found: list[Row]) -> str:
    floors = {(each.case, each.mode): each for each in found if each.name == FLOOR}
    cells = [HEADINGS, *(each.cells(floors[each.case, each.mode]) for each in found)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ["| " + " | ".join(map(str.ljust, line, widths)) + " |" for line in cells]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def picture(found: list[Row]) -> str:
    """The paper's figure 9: what a round takes by the number of RTUs, in turn."""
    colours = {
        "paper": "#888",
        FLOOR: "#333",
        CENTRE: "#0a7d3c",
        PLAN: "#5fb884",
        UVLOOP: "#5b4bb5",
        ASYNCIO: "#c26a00",
        C104: "#b3261e",
    }
    curves: dict[str, list[tuple[int, float]]] = {
        "paper": [(count, PAPER_MS * count) for count in (10, 25, 50, 100)]
    }
    for each in found:
        if each.mode == TURN and not each.case.real and not each.case.wait_ms and each.case.count <= 100:
            curves.setdefault(each.name, []).append(
                (each.case.count, each.time.middle * each.case.count / 1000)
            )
    times = [ms for points in curves.values() for _, ms in points]
    lowest = math.floor(math.log10(min(times)))
    highest = max(lowest + 1, math.ceil(math.log10(max(times))))

    def x(count: int) -> float:
        return 60 + 4.4 * count

    def y(ms: float) -> float:
        return 320 - 280 * (math.log10(ms) - lowest) / (highest - lowest)

    parts = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 640 370" font-family="sans-serif"',
        '  font-size="13">',
        "<!-- SPDX-License-Identifier: GPL-3.0-or-later -->",
        "<title>Milliseconds of a round of polls, in turn, by the number of RTUs</title>",
        '<rect width="640" height="370" fill="#fff"/>',
        '<path d="M60 320H510M60 320V30" stroke="#000" fill="none"/>',
    ]
    for count in (10, 25, 50, 75, 100):
        parts.append(f'<text x="{x(count):.1f}" y="338" text-anchor="middle">{count}</text>')
    for power in range(lowest, highest + 1):
        height = y(10.0**power)
        parts.append(f'<path d="M60 {height:.1f}H510" stroke="#ddd"/>')
        parts.append(f'<text x="54" y="{height + 4:.1f}" text-anchor="end">{10.0**power:g}</text>')
    parts.append('<text x="285" y="358" text-anchor="middle">RTUs, polled in turn</text>')
    parts.append('<text x="10" y="20">ms a round</text>')
    lone = {name: points[0] for name, points in curves.items() if len(points) == 1}
    heights = sorted(
        ((y(points[-1][1]), name) for name, points in curves.items() if name not in lone), reverse=True
    )
    at = 340.0
    for height, name in heights:
        at = min(height + 4, at - 16)
        line = " ".join(f"{x(count):.1f},{y(ms):.1f}" for count, ms in curves[name])
        text = "the paper's sum" if name == "paper" else name
        parts.append(f'<polyline points="{line}" fill="none" stroke="{colours[name]}" stroke-width="2"/>')
        parts += [
            f'<circle cx="{x(count):.1f}" cy="{y(ms):.1f}" r="3" fill="{colours[name]}"/>'
            for count, ms in curves[name]
        ]
        parts.append(f'<text x="512" y="{at:.1f}" fill="{colours[name]}">{text}</text>')
    for name, (count, ms) in lone.items():  # no curve: over the others, with its name beside it
        place = f'cx="{x(count):.1f}" cy="{y(ms):.1f}"'
        parts.append(f'<circle {place} r="6" fill="none" stroke="{colours[name]}" stroke-width="2"/>')
        at = f'x="{x(count):.1f}" y="{y(ms) + 21:.1f}"'
        parts.append(f'<text {at} text-anchor="middle" fill="{colours[name]}">{name}</text>')
    return "\n".join([*parts, "</svg>", ""])


def main() -> int:
    parser = argparse.ArgumentParser(description="Polls n RTUs, as figure 9 of the positioning paper.")
    parser.add_argument("--quick", action="store_true", help="a try of some ten seconds")
    parser.add_argument(
        "--output", type=Path, default=REPOSITORY / "build", help="folder for table and picture"
    )
    arguments = parser.parse_args()
    missing = [str(program) for program in (ROUNDS, RTUS, PROGRAM) if not program.exists()]
    if missing:
        print(f"not built: {', '.join(missing)}; type `make bench`, which builds them", file=sys.stderr)
        return 2
    head = f"{machine()}. Median (minimum..maximum) of the rounds."
    try:
        found = list(rows(QUICK if arguments.quick else FULL))
        amounts = (200, 2) if arguments.quick else (10_000, POLLED_SECONDS)
        each_second = "\n".join(polled_each_second(*amounts, shards) for shards in (1, SHARD_COUNT))
    except (PollError, GatewayError, OSError, ValueError) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1
    text = f"{head}\n\n{table(found)}\n\n{each_second}\n"
    arguments.output.mkdir(parents=True, exist_ok=True)
    (arguments.output / "polls.txt").write_text(text)
    (arguments.output / "polls.svg").write_text(picture(found))
    print(f"\n{text}\nAlso in {arguments.output}/polls.txt; the picture: polls.svg.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
