# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make cost`: what a piece of work costs the board's core, counted under QEMU as code for ARMv5: instructions,
system calls, octets between the cache for data and memory. Compared with what cost.json has: a count is no
time, and no host is judged. What the rows mean: docs/bench.md.
Exit codes: 0 done, 1 one costs more than cost.json allows, or something did not work, 2 wrong usage or not
built.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from bare_client import BenchError, Client, asdu, interrogate, read, receive_events
from emulated import ARM, Counts, Emulated, missing
from managers import IMAGE, TABLES, Asker, ours
from station_contenders import POINTS, set_point_for

from lab.errors import LabError
from lab.gateway import Gateway, remove, run_directory
from lab.manager import free_udp_port

FILE = Path(__file__).with_suffix(".json")
ALLOWED = 1.02  # of the instructions of cost.json
WHERE_WORK_MEETS = 1.15  # how much of it a wake-up takes is the host's affair
STATION, AGENT = "rtu-iec104", "rtu-snmp"
GATEWAY = ("rtud", STATION, AGENT)  # what idles; the source of values stands for the lines
ROUNDS = 5
COMMANDS, READS, EVENTS = 400, 800, 8_000
IDLE_S = 2
NOTHING_A_SECOND = b"\0\0\0"  # the set-point of the source that makes no event


@dataclass(frozen=True)
class Row:
    """A piece of work, done so many times by one call of work."""

    name: str
    programs: tuple[str, ...]  # that it is counted of
    times: int
    work: Callable[[], object]
    allowed: float = ALLOWED


def command(client: Client) -> None:
    """A set-point from its octets to the answer of who executes it."""
    client.ask(asdu(49, 6, 40001, NOTHING_A_SECOND))
    done = False
    while not done:
        done = any(not each[2] & 1 and (each[6], each[8]) == (49, 10) for each in client.frames())
    client.acknowledge()


def repeat(times: int, work: Callable[[], object]) -> None:
    for _ in range(times):
        work()


def events(gateway: Gateway, masters: int) -> None:
    clients = [Client(gateway.address) for _ in range(masters)]
    try:
        receive_events(clients, lambda: set_point_for(gateway.address)(EVENTS), EVENTS, EVENTS)
    finally:
        for client in clients:
            client.socket.close()


@contextlib.contextmanager
def connected(gateway: Gateway) -> Iterator[Client]:
    client = Client(gateway.address)
    try:
        yield client
    finally:
        client.socket.close()


def answers(gateway: Gateway, port: int) -> Iterator[Row]:
    with connected(gateway) as client:
        yield Row("GI of 5 000 points by 104", (STATION,), 1, lambda: interrogate(client, POINTS))
        yield Row("read command", (STATION,), READS, partial(read, client, READS), WHERE_WORK_MEETS)
        commands = partial(repeat, COMMANDS, partial(command, client))
        yield Row("set-point", (STATION,), COMMANDS, commands, WHERE_WORK_MEETS)
    with contextlib.closing(Asker(port)) as asker:
        for way, columns in (("tables", TABLES), ("image", IMAGE)):
            work = partial(asker.interrogate, columns)
            yield Row(f"GI of 5 000 points by SNMP, {way}", (AGENT,), 1, work, WHERE_WORK_MEETS)
    yield Row("idle second", GATEWAY, IDLE_S, lambda: time.sleep(IDLE_S))


def reports(gateway: Gateway, _port: int) -> Iterator[Row]:
    """To the most masters first: a connection in a place that is new gets what is kept for its address."""
    for masters, to in ((8, "eight masters"), (1, "one master")):
        work = partial(events, gateway, masters)
        yield Row(f"event to {to}", (STATION,), EVENTS, work, WHERE_WORK_MEETS)


def counted(programs: Emulated, row: Row) -> Counts:
    """The least of some rounds: what else a process has to do meanwhile comes on top."""

    def now() -> Counts:
        return sum((programs.counts(name) for name in row.programs), Counts())

    found = []
    for _ in range(ROUNDS):
        before = now()
        row.work()
        found.append((now() - before) / row.times)
    return min(found, key=lambda each: each.instructions)


def measured() -> Iterator[tuple[Row, Counts]]:
    """Of a gateway for each kind of work: what is kept for masters that have left is looked at, too."""
    for rows in (answers, reports):
        folder = run_directory()
        try:
            programs = Emulated(folder / "arm", "count_memory.c")
            programs.add_gateway()
            with ours(POINTS, folder, free_udp_port(), programs.folder) as (gateway, port):
                for row in rows(gateway, port):
                    yield row, counted(programs, row)
        finally:
            remove(folder)


def compiler() -> str:
    return subprocess.run(
        [ARM[0], "-dumpfullversion"], check=True, capture_output=True, text=True
    ).stdout.strip()


@dataclass
class Table:
    """What was counted, beside what cost.json has of this compiler."""

    known: dict[str, Any]
    found: dict[str, Counts] = field(default_factory=dict)
    dearer: list[str] = field(default_factory=list)  # than cost.json allows, in words

    @property
    def comparable(self) -> bool:
        return bool(self.known["compiler"] == compiler())

    def add(self, row: Row, counts: Counts) -> str:
        """Its line."""
        self.found[row.name] = counts
        before = self.known["counts"].get(row.name, [0])[0] if self.comparable else 0
        change = f"{counts.instructions / before - 1:+.1%}" if before else "new"
        if before and counts.instructions > row.allowed * before:
            self.dearer.append(
                f"{row.name}: {before} instructions became {round(counts.instructions)}, {change}"
            )
        cells = [row.name, *(f"{round(each):_}".replace("_", " ") for each in astuple(counts)), change]
        return f"| {' | '.join(cells)} |"

    def write(self) -> None:
        counts = {name: [round(each) for each in astuple(found)] for name, found in self.found.items()}
        FILE.write_text(json.dumps({"compiler": compiler(), "counts": counts}, indent=1) + "\n")


def known() -> dict[str, Any]:
    return json.loads(FILE.read_text())  # type: ignore[no-any-return]


def main() -> int:
    parser = argparse.ArgumentParser(prog="make cost", description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--write", action="store_true", help="take the counts as they are into cost.json")
    write = parser.parse_args().write
    if not_built := missing():
        print(
            f"not built: {', '.join(map(str, not_built))}; type `make cost`, which builds it", file=sys.stderr
        )
        return 2
    table = Table(known())
    print("| work | instructions | system calls | octets | instructions, since cost.json |")
    print("|---|---|---|---|---|")
    try:
        for row, counts in measured():
            print(table.add(row, counts), flush=True)
    except (BenchError, LabError, OSError, subprocess.SubprocessError) as error:
        print(f"ended early: {error}", file=sys.stderr)
        return 1
    if write:
        table.write()
        return 0
    if not table.comparable:
        print(f"cost.json is of gcc {table.known['compiler']}, this is {compiler()}: nothing is compared")
    for text in table.dearer:
        print(f"dearer than cost.json allows: {text}; worth it? `make cost WRITE=1`", file=sys.stderr)
    return 1 if table.dearer else 0


if __name__ == "__main__":
    sys.exit(main())
