# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: the control centre as a store. What an event costs it, by itself; and RTUs polled at 1 Hz by
rtu-centre, through the centre to its database and to a page that watches.
What the rows mean: docs/bench.md. No time is asserted.
Exit codes: 0 done, 1 something did not work, 2 not built.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import datetime
import json
import os
import resource
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import aiohttp
from polls import PROGRAM, RTUS, PollError, simulated
from stopwatch import cpu_ns

from bench import machine
from lab.gateway import REPOSITORY, free_port

sys.path.insert(0, str(REPOSITORY))
from openrtu_tools.centre.codes import TAGGED, Cause, Content, Kind
from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.intake import Intake
from openrtu_tools.centre.records import Record
from openrtu_tools.centre.settings import StationSettings
from openrtu_tools.centre.sqlite import SqliteStore
from openrtu_tools.centre.store import Store

TRANSACTION = 4096  # records: what the centre takes at most
USER, PASSWORD = "bench", "correct horse battery"
STARTS_S = 120.0  # for a hang only
EVENTS, POSITIONS = "events", "positions"


def records(what: str, stations: int, number: int, at_ns: int) -> list[Record]:
    """So many of different stations, one after the other."""
    made = []
    for each in range(TRANSACTION):
        at_ns += 1000  # no two are the same
        station = (number * TRANSACTION + each) % stations
        place = {
            "ca": 1,
            "station": station,
            "connection": 1,
            "ioa": 1,
            "received_ns": at_ns,
            "tag_ns": at_ns,
        }
        of_all = {"flags": TAGGED, "cause": Cause.SPONTANEOUS, **place}
        value = (at_ns // 1000 % 2**31).to_bytes(4, "little")
        rest = value + bytes([0, 0, Content.SCALED]) + bytes(5) if what == EVENTS else value * 3
        kind = Kind.INFORMATION if what == EVENTS else Kind.POSITION
        made.append(Record(kind=kind, type=35 if what == EVENTS else 201, rest=rest, **of_all))
    return made


@dataclass(frozen=True)
class Cost:
    """Of one event."""

    what: str
    stations: int
    cpu_us: float
    wall_us: float
    octets: float  # of the database

    def __str__(self) -> str:
        return (
            f"{self.what} of {self.stations} stations: {self.cpu_us:.1f} µs of CPU and"
            f" {self.octets:.0f} octets each; {1e6 / self.wall_us:.0f} a second stored by itself"
        )


def octets_of(store: Store) -> int:
    """Of the database on the disk."""
    if isinstance(store, SqliteStore):
        store.database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        return store.path.stat().st_size
    sql = "SELECT pg_database_size(current_database())"
    return int(store.transaction(lambda database: database.execute(sql).fetchone()[0]))


def intake(what: str, stations: int, transactions: int, where: Path | str) -> Cost:
    """`where`: a folder for files of SQLite, or the address of a server."""
    store = open_store(where / f"{what}-{stations}.db" if isinstance(where, Path) else where, alone=True)
    settings = {f"rtu{number}": StationSettings(f"rtu{number}") for number in range(stations)}
    taker = store.transaction(lambda database: Intake(database, settings))
    taker.stored()
    named = [
        Record(Kind.STATION, 0, 0, number, 0, 0, name=f"rtu{number}", received_ns=1)
        for number in range(stations)
    ]

    def put(batch: list[Record]) -> None:
        taker.begin()
        store.transaction(lambda database: taker.take(database, batch))
        taker.stored()

    put(named)
    rounds = -(-stations // TRANSACTION)  # in which each station is there the first time
    batches = [
        records(what, stations, number, time.time_ns() + number * 10**9)
        for number in range(rounds + transactions)
    ]
    for batch in batches[:rounds]:
        put(batch)
    size = octets_of(store)
    begun, used = time.perf_counter(), time.process_time()
    for batch in batches[rounds:]:
        put(batch)
    used, begun = time.process_time() - used, time.perf_counter() - begun
    count = transactions * TRANSACTION
    cost = Cost(what, stations, used / count * 1e6, begun / count * 1e6, (octets_of(store) - size) / count)
    store.close()
    return cost


# ---- the whole way -------------------------------------------------------------------------------


def configuration(count: int, port: int, of_rtus: int, folder: Path) -> Path:
    stations = [
        {"name": f"rtu{number}", "address": f"127.1.{number // 250}.{1 + number % 250}"}
        for number in range(count)
    ]
    reads = [{"common_address": 1, "ioa": 1, "period_ms": 1000}]
    defaults = {"port": of_rtus, "common_addresses": [1], "interrogate_at_start": False, "reads": reads}
    file = folder / "centre.json"
    content = {"defaults": defaults, "stations": stations, "polls_at_once": 1024, "centre": {"port": port}}
    file.write_text(json.dumps(content))
    return file


def told(file: Path, *words: str, stdin: str = "") -> str:
    command = [sys.executable, "-m", "openrtu_tools", "centre", file, *words]
    done = subprocess.run(
        command, input=stdin, cwd=REPOSITORY / "scripts", capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise PollError(done.stderr.strip())
    return done.stdout


@dataclass
class Seen:
    """By a page."""

    ages_ms: list[float]
    messages: int = 0
    octets: int = 0


async def log_in(session: aiohttp.ClientSession, address: str) -> None:
    """Once the centre answers; with many at once, when it is one's turn."""
    end = time.monotonic() + STARTS_S
    while True:
        try:
            body = {"name": USER, "password": PASSWORD}
            async with session.post(f"{address}/api/login", json=body) as response:
                if response.status == 200:
                    return
                said = await response.text()
        except aiohttp.ClientConnectionError as error:
            said = str(error)
        if time.monotonic() > end:
            raise PollError(f"nobody gets in: {said}")
        await asyncio.sleep(0.1)


async def watch(port: int, count: int, seconds: float) -> tuple[Seen, int, int]:
    """A page at the map: how old a position is when it comes; the times between which that was, in ns."""
    address = f"http://127.0.0.1:{port}"
    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
        await log_in(session, address)
        async with session.ws_connect(f"{address}/api/stream", max_msg_size=0) as socket:
            await socket.send_json({"view": "map"})
            known: set[int] = set()
            while len(known) < count:  # all are there
                known |= {point["id"] for point in (await socket.receive_json(timeout=STARTS_S))["points"]}
            seen, begun = Seen([]), time.time_ns()
            while time.time_ns() < begun + seconds * 1e9:
                message = await socket.receive(timeout=STARTS_S)
                now_ms = time.time_ns() / 1e6
                seen.ages_ms += [now_ms - point["at"] for point in json.loads(message.data)["points"]]
                seen.messages += 1
                seen.octets += len(message.data)
            return seen, begun, time.time_ns()


def resident_mib(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


@contextlib.contextmanager
def running(count: int, port: int, folder: Path, kind: str = "h") -> Iterator[tuple[int, int]]:
    """RTUs of a kind, rtu-centre, and the centre at that port: the processes of the last two."""
    with simulated(count, kind) as of_rtus:
        file = configuration(count, port, of_rtus, folder)
        told(file, "user", USER, stdin=PASSWORD)
        (folder / "rtu-centre.json").write_text(told(file, "collector"))
        quiet: Any = {"stderr": subprocess.DEVNULL}
        collector = subprocess.Popen([PROGRAM, folder / "rtu-centre.json"], **quiet)
        serving = [sys.executable, "-m", "openrtu_tools", "centre", file, "serve"]
        centre = subprocess.Popen(serving, cwd=REPOSITORY / "scripts", **quiet)
        try:
            yield collector.pid, centre.pid
        finally:
            for process in (centre, collector):
                process.terminate()
                process.wait()


def whole(count: int, seconds: float) -> str:
    with tempfile.TemporaryDirectory(prefix="store-") as name:
        folder, port = Path(name), free_port()
        with running(count, port, folder) as processes:
            began = [*map(cpu_ns, processes)], time.monotonic()
            seen, begun, ended = asyncio.run(watch(port, count, seconds))
            passed = time.monotonic() - began[1]
            used = [cpu_ns(pid) - before for pid, before in zip(processes, began[0], strict=True)]
            memory = [*map(resident_mib, processes)]
        with sqlite3.connect(folder / "centre.db") as database:
            sql = "SELECT count(*) FROM track WHERE at_ns BETWEEN ? AND ?"
            stored = database.execute(sql, (begun, ended)).fetchone()[0]
    ages = sorted(seen.ages_ms)
    middle, last = ages[len(ages) // 2], ages[len(ages) * 99 // 100]
    span = (ended - begun) / 1e9
    return (
        f"{count} RTUs polled at 1 Hz for {span:.0f} s: {stored / span:.0f} positions a second stored;"
        f" wire to page {middle:.0f} ms (median), {last:.0f} ms (p99),"
        f" of which the page's own second is a part; {seen.octets / span / 1024:.0f} KiB/s to the page;"
        f" from the start on, rtu-centre {used[0] / passed / 1e7:.0f} % of a core and {memory[0]:.0f} MiB,"
        f" the centre {used[1] / passed / 1e7:.0f} % and {memory[1]:.0f} MiB"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description="The control centre as a store.")
    parser.add_argument("--quick", action="store_true", help="a try of some ten seconds")
    parser.add_argument("--output", type=Path, default=REPOSITORY / "build", help="folder for the text")
    parser.add_argument("--database", default="", help="only what it costs a server, by its address")
    arguments = parser.parse_args()
    if arguments.database:
        for what in (EVENTS, POSITIONS):
            print(intake(what, 100, 3 if arguments.quick else 30, arguments.database), flush=True)
        return 0
    missing = [str(program) for program in (RTUS, PROGRAM) if not program.exists()]
    if missing:
        print(f"not built: {', '.join(missing)}; type `make bench`, which builds them", file=sys.stderr)
        return 2
    lines = [f"{machine()}; load {os.getloadavg()[0]:.1f}; {datetime.date.today()}."]
    print(lines[0], flush=True)
    try:
        with tempfile.TemporaryDirectory(prefix="store-") as name:
            for what in (EVENTS, POSITIONS):
                for stations in (100,) if arguments.quick else (100, 10_000):
                    lines.append(str(intake(what, stations, 3 if arguments.quick else 30, Path(name))))
                    print(lines[-1], flush=True)
        for count in (100,) if arguments.quick else (1000, 10_000):
            lines.append(whole(count, 3 if arguments.quick else 20))
            print(lines[-1], flush=True)
    except (PollError, OSError, sqlite3.Error, TimeoutError) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1
    arguments.output.mkdir(parents=True, exist_ok=True)
    (arguments.output / "store.txt").write_text("\n\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
