# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: our controlled station beside others with the same 5 000 points, asked by one bare socket, by
turns. What the rows mean: docs/bench.md. No time is asserted.
Exit codes: 0 done, 1 something did not work, 2 wrong usage or not built.
"""

from __future__ import annotations

import argparse
import contextlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from bare_client import Arrival, BenchError, Client, count_events, interrogate, read, receive_events
from station_contenders import (
    AWAY,
    AWAY_RING,
    EVENT_RING,
    EVENTS_MAX,
    POINTS,
    Contender,
    Station,
    c104,
    event_source,
    lib60870,
    our_memory,
    ours,
)
from stopwatch import Memory, Spread

from bench import machine
from lab.gateway import REPOSITORY

READS = 4000
RATES = tuple(1000 << n for n in range(10))  # events a second
SLOW, FAST = 4000, 64_000  # of these the CPU is measured; c104 makes the first at most
EVENT_TRIES = 2
ROOM = 65536  # places for events, more than come before they are taken
EVENT_ROWS = ((1, EVENT_RING), (8, EVENT_RING), (1, ROOM))  # masters, places for events
QUEUED = 10_000  # events that wait for a master
SOURCES = REPOSITORY / "package" / "openrtu" / "src"

FIRST_GI, GI, GI_CPU = "GI of 5 000 points, first on a connection", "GI again", "CPU of such a GI"
READ, READ_CPU = "read commands", "CPU of a read"
UNITS = {FIRST_GI: "ms", GI: "ms", GI_CPU: "ms", READ: "/s", READ_CPU: "µs"}
Row = dict[str, Spread | Memory]  # by contender
Cells = dict[str, Row]


@dataclass(frozen=True)
class Amounts:
    """How often each is repeated."""

    rounds: int
    interrogations: int
    event_rounds: int
    rates: tuple[int, ...]
    cpu_rates: tuple[int, ...]


FULL = Amounts(7, 10, 3, RATES, (SLOW, FAST))
QUICK = Amounts(1, 1, 1, (250,), ())


def by_turns(contenders: list[Contender], rounds: int) -> Iterator[Contender]:
    """So that whatever else the machine does falls on all of them: forwards, then backwards."""
    for number in range(rounds):
        for contender in contenders if number % 2 == 0 else contenders[::-1]:
            print(f"  turn {number + 1} of {rounds}: {contender.name}", flush=True)
            yield contender


# ---- interrogations and reads -----------------------------------------------------------------------


def one_turn(station: Station, interrogations: int) -> dict[str, float]:
    """On a new connection."""
    client = Client(station.address)
    found = {FIRST_GI: interrogate(client, POINTS) * 1000}
    begun = station.cpu_ns()
    found[GI] = statistics.median(interrogate(client, POINTS) * 1000 for _ in range(interrogations))
    found[GI_CPU] = (station.cpu_ns() - begun) / interrogations / 1e6
    begun, begun_s = station.cpu_ns(), time.perf_counter()
    read(client, READS)
    found[READ] = READS / (time.perf_counter() - begun_s)
    found[READ_CPU] = (station.cpu_ns() - begun) / READS / 1000
    client.socket.close()
    return found


def answers(contenders: list[Contender], amounts: Amounts) -> tuple[Cells, int]:
    """Also the size of our map."""
    values: dict[str, dict[str, list[float]]] = {}
    with contextlib.ExitStack() as stack:
        stations = {
            contender.name: stack.enter_context(contender.start(EVENT_RING)) for contender in contenders
        }
        for contender in by_turns(contenders, amounts.rounds):
            for row, value in one_turn(stations[contender.name], amounts.interrogations).items():
                values.setdefault(row, {}).setdefault(contender.name, []).append(value)
        cells: Cells = {row: spreads(UNITS[row], found) for row, found in values.items()}
        cells["memory of all processes"] = {name: each.memory() for name, each in stations.items()}
        return cells, max(each.map_octets() for each in stations.values())


# ---- events -----------------------------------------------------------------------------------------


@dataclass
class Race:
    """A contender at rates that double until it loses events at one."""

    contender: Contender
    places: int
    rates: list[int]  # that are left
    best: float = 0.0  # events a second, as they arrived
    tries: int = EVENT_TRIES
    station: Station | None = None
    running: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)

    def run(self, masters: int) -> None:
        """One rate, once. Who lost events starts anew: what is left of them is nobody's."""
        if self.station is None:
            self.station = self.running.enter_context(self.contender.start(self.places))
        arrival = attempt(self.station, masters, self.rates[0])
        if arrival:
            self.best = max(self.best, min(EVENTS_MAX, self.rates[0]) / arrival.seconds)
            self.tries = EVENT_TRIES
            self.rates.pop(0)
            return
        self.stop()
        self.tries -= 1
        if self.tries == 0:
            self.rates.clear()

    def stop(self) -> None:
        self.station = None
        self.running.close()


def attempt(station: Station, masters: int, rate: int) -> Arrival | None:
    """None: one was lost."""
    clients = [Client(station.address) for _ in range(masters)]
    try:
        return receive_events(clients, lambda: station.make_events(rate), rate, min(EVENTS_MAX, rate))
    except (BenchError, TimeoutError):
        return None
    finally:
        for client in clients:
            client.socket.close()


def sustained(contenders: list[Contender], masters: int, places: int, amounts: Amounts) -> Row:
    """The highest rate at which none was lost, as it arrived. Rate by rate, those that are left by turns."""
    best: dict[str, list[float]] = {contender.name: [] for contender in contenders}
    for _ in range(amounts.event_rounds):
        races = [Race(contender, places, list(amounts.rates)) for contender in contenders]
        try:
            while left := [race for race in races if race.rates]:
                for race in left:
                    race.run(masters)
        finally:
            for race in races:
                race.stop()
        for race in races:
            print(f"  to {masters}, {places} places: {race.contender.name} {race.best:.0f} /s", flush=True)
            best[race.contender.name].append(race.best)
    return {name: Spread("/s", values) for name, values in best.items()}


def event_costs(contenders: list[Contender], rate: int, rounds: int) -> tuple[Row, Row]:
    """CPU of all processes for an event to one master, and its wait. Nothing of who lost some each time."""
    costs: dict[str, list[float]] = {contender.name: [] for contender in contenders}
    waits: dict[str, list[float]] = {contender.name: [] for contender in contenders}
    for contender in by_turns(contenders, rounds):
        with contender.start(ROOM) as station:
            attempt(station, 1, rate)
            begun = station.cpu_ns()
            if arrival := attempt(station, 1, rate):
                costs[contender.name].append((station.cpu_ns() - begun) / min(rate, EVENTS_MAX) / 1000)
                waits[contender.name].append(arrival.wait_s * 1000)
    return spreads("µs", costs), spreads("ms", waits)


def spreads(unit: str, values: dict[str, list[float]]) -> Row:
    return {name: Spread(unit, found) for name, found in values.items() if found}


def events(contenders: list[Contender], amounts: Amounts) -> Cells:
    rows: Cells = {}
    for rate in amounts.cpu_rates:
        row, waits = event_costs(contenders, rate, amounts.event_rounds)
        rows[f"CPU of an event, {rate} a second"] = row
        rows[f"wait of an event, {rate} a second"] = waits
    for masters, places in EVENT_ROWS:
        text = f"events without loss, to {masters} master{'s' if masters > 1 else ''}, {places} places"
        rows[text] = sustained(contenders, masters, places, amounts)
    return rows


# ---- events of a master that is away ----------------------------------------------------------------


@dataclass(frozen=True)
class Queue:
    """What a station keeps of QUEUED events for a master that is away."""

    memory: Memory  # of all processes, while they keep them
    map_octets: int
    kept: int  # as the master counts when it comes


def queued(station: Station) -> Queue:
    """Another master, who is there, sees when all were made."""
    present = Client(station.address)
    station.make_events(QUEUED)
    count_events(present, QUEUED)
    memory = station.memory()
    away = Client(station.address, AWAY)
    kept = count_events(away, QUEUED)
    for client in (present, away):
        client.socket.close()
    return Queue(memory, station.map_octets(), kept)


def queue_rows(our_map_octets: int, queues: dict[str, Queue]) -> list[list[str]]:
    """The map's places for events beside those it had before are all that its growth is."""
    mine = queues["ours"]
    octets = (mine.map_octets - our_map_octets) / (AWAY_RING - EVENT_RING)
    kept = [str(queue.kept) for queue in queues.values()]
    rows = [
        [f"kept of {QUEUED} events for a master that is away", *kept],
        line("memory of all processes then", {name: queue.memory for name, queue in queues.items()}, queues),
        [f"our map, with {EVENT_RING} places for events", f"{our_map_octets / 1024:.0f} KiB"],
        [f"our map with these events, {AWAY_RING} places", f"{mine.map_octets / 1024:.0f} KiB"],
        ["our map for each event, whoever waits for it", f"{octets:.0f} octets"],
    ]
    return rows


def text_size(room: str) -> str:
    """Of a room at -Os, by the cross compiler for ARMv5, or this machine's when there is none."""
    tests = ("test_", "fuzz_", "fake_")
    sources = [file for file in (SOURCES / room).glob("*.c") if not file.name.startswith(tests)]
    defines = ["-D_GNU_SOURCE", "-D_TIME_BITS=64", "-D_FILE_OFFSET_BITS=64", '-DOPENRTU_VERSION=""']
    for prefix, target in (("arm-linux-gnueabi-", ["-march=armv5te", "-marm"]), ("", [])):
        if shutil.which(f"{prefix}gcc") is None:
            continue
        with tempfile.TemporaryDirectory() as folder:
            compiler = [f"{prefix}gcc", "-Os", *target, *defines, f"-I{SOURCES}", "-c", *sources]
            subprocess.run(compiler, cwd=folder, check=True)
            command = [f"{prefix}size", "-t", *Path(folder).glob("*.o")]
            total = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[
                -1
            ]
        return f"{int(total.split()[0]) / 1024:.1f} KiB, {'ARMv5' if prefix else 'this machine'}"
    return "no compiler"


# ---- the table --------------------------------------------------------------------------------------


def line(text: str, row: Row, names: Iterable[str]) -> list[str]:
    """Cells, and ours as a part of each other's."""
    others = [name for name in names if name != "ours"]
    mine = row.get("ours")
    ratios = [
        f"{mine.middle / row[name].middle:.2g}" if mine and name in row and row[name].middle else ""
        for name in others
    ]
    return [text, *(str(row.get(name, "")) for name in names), *ratios]


def table(lines: list[list[str]]) -> str:
    """Markdown; a line may lack its last cells."""
    width = len(lines[0])
    filled = [cells + [""] * (width - len(cells)) for cells in lines]
    filled.insert(1, ["---"] * width)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in filled)


def measured(contenders: list[Contender], amounts: Amounts) -> list[list[str]]:
    """The table's lines."""
    names = [contender.name for contender in contenders]
    cells, map_octets = answers(contenders, amounts)
    cells |= events(contenders, amounts)
    queues = {}
    for contender in contenders:
        with contender.start(AWAY_RING, AWAY) as station:
            queues[contender.name] = queued(station)
    return [
        ["measured", *names, *(f"ours / {name}" for name in names[1:])],
        *(line(text, row, names) for text, row in cells.items()),
        *queue_rows(map_octets, queues),
        ["our memory with rtu-modbus itself, all processes", str(our_memory())],
        ["text of iec104/ at -Os", text_size("iec104")],
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures our controlled station beside others.")
    parser.add_argument("--quick", action="store_true", help="a try of some ten seconds")
    parser.add_argument(
        "--lib60870", type=Path, metavar="FOLDER", help="a checkout of lib60870 in which it was built"
    )
    arguments = parser.parse_args()
    amounts = QUICK if arguments.quick else FULL
    if not event_source().exists():
        print(f"not built: {event_source()}; type `make bench`, which builds it", file=sys.stderr)
        return 2
    head = (
        f"{machine()}. Median (minimum..maximum) of {amounts.rounds} turns, of events {amounts.event_rounds}."
    )
    with tempfile.TemporaryDirectory() as directory:
        try:
            in_c = [lib60870(arguments.lib60870, Path(directory))] if arguments.lib60870 else []
        except BenchError as error:
            print(error, file=sys.stderr)
            return 2
        try:
            lines = measured([ours(), *in_c, c104()], amounts)
        except (BenchError, OSError) as error:
            print(f"the bench ended early: {error}", file=sys.stderr)
            return 1
    print(f"\n{head}\n\n{table(lines)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
