# SPDX-License-Identifier: GPL-3.0-or-later
"""What is measured, and how: each function measures one quantity of a running contender."""

from __future__ import annotations

import itertools
import random
import statistics
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from contenders import BITS, DEVICE, FIRST_IOA, OURS, STATION, UNIT, Contender, values_of_the_device

from lab.linesim import Frame
from lab.raw_master import Object, RawMaster, StationError

START_TIMEOUT_S = 20.0
EVENT_TIMEOUT_S = 20.0
PAUSE_S = 0.05  # longest pause between two interrogations
CHANGE_PAUSE_S = 1.0  # longest time to the next change whose event is timed


@dataclass(frozen=True)
class Spread:
    """A quantity that was measured several times."""

    unit: str
    values: list[float]

    @property
    def middle(self) -> float:
        return statistics.median(self.values)

    def __str__(self) -> str:
        middle = f"{_number(self.middle)} {self.unit}"
        if len(self.values) == 1:
            return middle
        return f"{middle} ({_number(min(self.values))}..{_number(max(self.values))})"

    def record(self) -> dict[str, object]:
        least, most = min(self.values), max(self.values)
        return {"unit": self.unit, "n": len(self.values), "median": self.middle, "min": least, "max": most}


@dataclass(frozen=True)
class Memory:
    """Resident memory in KiB, of one process or a sum."""

    rss: int  # a page that several processes share counts in each of them
    pss: int  # a page that n processes share counts 1/n in each
    private: int

    @property
    def middle(self) -> float:
        return self.pss

    def __str__(self) -> str:
        return f"PSS {self.pss} KiB (RSS {self.rss}, private {self.private})"

    def __add__(self, other: Memory) -> Memory:
        return Memory(self.rss + other.rss, self.pss + other.pss, self.private + other.private)

    def record(self) -> dict[str, object]:
        return {"unit": "KiB", "rss": self.rss, "pss": self.pss, "private": self.private}


def _number(value: float) -> str:
    """Three digits: the spread allows no more."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


@dataclass
class Session:
    """A contender, the controlling station that measures it, and what device 67 holds now."""

    contender: Contender
    master: RawMaster
    stations: list[int]
    random: random.Random
    values: dict[str, list[int]] = field(default_factory=values_of_the_device)

    def wait_until_good(self) -> None:
        """Until every object of every station has been read from its device."""
        deadline = time.monotonic() + START_TIMEOUT_S
        for station in self.stations:
            while any(found.quality for found in self.interrogate(station)):
                if time.monotonic() > deadline:
                    raise StationError(f"CA {station} is not good after {START_TIMEOUT_S} s")
                time.sleep(PAUSE_S)

    def interrogate(self, station: int) -> list[Object]:
        objects = self.master.interrogate(station).objects
        if not objects:
            raise StationError(f"the interrogation of CA {station} brought nothing")
        return objects

    def pause(self, longest_s: float) -> None:
        time.sleep(self.random.uniform(0, longest_s))

    def renew(self, table: str, address: int) -> int:
        """Another value for an address than the device holds; it is not yet set."""
        old = self.values[table][address]
        self.values[table][address] = 1 - old if table in BITS else old + 1
        return self.values[table][address]

    def addresses(self) -> Iterator[tuple[str, int]]:
        return ((table, address) for table in self.values for address in range(len(self.values[table])))


# ---- (a) an interrogation ------------------------------------------------------------------------


def interrogation_times(session: Session, repetitions: int) -> Spread:
    """From sending it to its termination."""
    good = 0
    wanted = {
        FIRST_IOA[table] + address: (session.values[table][address], good)
        for table, address in session.addresses()
    }
    times = []
    for _ in range(repetitions):
        session.pause(PAUSE_S)
        interrogation = session.master.interrogate(STATION)
        brought = {found.ioa: (found.value, found.quality) for found in interrogation.objects}
        if brought != wanted:
            raise StationError(f"the device holds {wanted}, the interrogation brought {brought}")
        times.append(interrogation.seconds * 1000)
    return Spread("ms", times)


def interrogation_cpu(session: Session, rounds: int, repetitions: int) -> Spread:
    """CPU time of the process that answers, an interrogation of several in a row; a value for each round."""
    pids = session.contender.pids
    pid = pids["rtu-iec104"] if session.contender.name == OURS else next(iter(pids.values()))
    costs = []
    for _ in range(rounds):
        begun = cpu_ns(pid)
        for _ in range(repetitions):
            session.interrogate(STATION)
        costs.append((cpu_ns(pid) - begun) / repetitions / 1e6)
    return Spread("ms", costs)


def watching_cpu(session: Session, seconds: int) -> Spread:
    """
    CPU time of all processes in each of some seconds, while every change at every device arrives: ours
    polls the line and sends events, the report's method is interrogated without a pause.
    """
    pids = session.contender.pids.values()
    stations = itertools.cycle(session.stations)
    costs = []
    for _ in range(seconds):
        begun, begun_ns = sum(map(cpu_ns, pids)), time.monotonic_ns()
        if session.contender.name == OURS:
            time.sleep(1)
        while time.monotonic_ns() < begun_ns + 1e9:
            session.interrogate(next(stations))
        costs.append((sum(map(cpu_ns, pids)) - begun) / (time.monotonic_ns() - begun_ns) * 1000)
    return Spread("ms/s", costs)


def cpu_ns(pid: int) -> int:
    """CPU time used by a process of one thread; utime and stime of its stat count in ticks of 10 ms."""
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[0])


# ---- (b) the age of data -------------------------------------------------------------------------


@dataclass(frozen=True)
class Reading:
    """One value of device 67 on its way."""

    value: int
    read_ns: int  # the device read it, for its answer
    sent_ns: int  # the answer was on the line: only from here on anybody can know it


def ages(session: Session, repetitions: int) -> Spread:
    """
    From a device reading its value for the answer, to the arrival of the object in an interrogation. All
    values change before each interrogation, so that a value tells which reading it comes from.
    """
    lines = session.contender.lines
    mark = lines.mark()
    lines.command("trace on")
    _wait_until_all_was_read(session)
    arrived: list[Object] = []
    for _ in range(repetitions):
        for table, values in session.values.items():
            lines.set(DEVICE, table, 0, *(session.renew(table, address) for address in range(len(values))))
        session.pause(PAUSE_S)
        arrived += session.interrogate(STATION)
    lines.command("trace off")  # its answer comes behind all that was traced
    readings = readings_of(lines.frames(mark))
    return Spread("ms", [age_ms(found, readings.get(found.ioa, [])) for found in arrived])


def _wait_until_all_was_read(session: Session) -> None:
    """
    So that what the next interrogation brings has its reading in the frame log. When an address is read
    for the second time, the answer to the first has been taken.
    """
    lines = session.contender.lines
    for _ in range(2):
        mark = lines.mark()
        session.interrogate(STATION)
        for table, address in session.addresses():
            wanted = ("reading", UNIT, table, address)
            lines.wait_frame(
                lambda f, wanted=wanted: (f.kind, f.unit, f.table, f.address) == wanted, START_TIMEOUT_S, mark
            )


def readings_of(frames: list[Frame]) -> dict[int, list[Reading]]:
    """The device's readings by IOA, in order."""
    readings: dict[int, list[Reading]] = {}
    waiting: list[Frame] = []
    for frame in (frame for frame in frames if frame.unit == UNIT):
        if frame.kind == "reading":
            waiting.append(frame)
        elif frame.kind == "sent":
            for read in waiting:
                reading = Reading(read.value, read.monotonic_ns, frame.monotonic_ns)
                readings.setdefault(FIRST_IOA[read.table] + read.address, []).append(reading)
            waiting.clear()
    return readings


def age_ms(found: Object, readings: list[Reading]) -> float:
    """
    From the newest reading that it can be. The time of sending is taken after it: a pause of the host between
    the two may put it behind the arrival. Then the object can only be of the first reading with its value.
    """
    value = found.value & 0xFFFF
    possible = [each for each in readings if each.value == value and each.read_ns < found.arrived_ns]
    if not possible:
        raise StationError(f"IOA {found.ioa} = {found.value}: the device never gave this value")
    sent = [each for each in possible if each.sent_ns < found.arrived_ns]
    return (found.arrived_ns - (sent[-1] if sent else possible[0]).read_ns) / 1e6


# ---- (c) a change --------------------------------------------------------------------------------


def change_times(session: Session, repetitions: int) -> Spread:
    """From a change at the device, at a random moment, to the arrival of the object."""
    arriving = _arriving(session)
    addresses = list(session.addresses())
    return Spread("ms", [_change_ms(session, arriving, addresses) for _ in range(repetitions)])


def _change_ms(session: Session, arriving: Iterator[Object], addresses: list[tuple[str, int]]) -> float:
    table, address = session.random.choice(addresses)
    value = session.renew(table, address)
    wanted = (STATION, FIRST_IOA[table] + address, value)

    def change() -> int:
        session.pause(CHANGE_PAUSE_S)
        changed_ns = time.monotonic_ns()
        session.contender.lines.set(DEVICE, table, address, value)
        return changed_ns

    with ThreadPoolExecutor(max_workers=1) as beside:
        changed_ns = beside.submit(change)
        found = next(found for found in arriving if (found.ca, found.ioa, found.value) == wanted)
        return (found.arrived_ns - changed_ns.result()) / 1e6


def _arriving(session: Session) -> Iterator[Object]:
    """
    Objects as they come, without end. Ours sends events. The report's method has none: its controlling
    station interrogates one station after the other, without a pause.
    """
    while session.contender.name == OURS:
        yield from session.master.spontaneous(time.monotonic() + EVENT_TIMEOUT_S)
    for station in itertools.cycle(session.stations):
        yield from session.interrogate(station)


# ---- (d) memory ----------------------------------------------------------------------------------


def memory(session: Session) -> dict[str, Memory]:
    """By process name."""
    return {name: _memory(pid) for name, pid in session.contender.pids.items()}


def _memory(pid: int) -> Memory:
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]
    kib = {line.split(":")[0]: int(line.split()[1]) for line in lines}
    return Memory(kib["Rss"], kib["Pss"], kib["Private_Clean"] + kib["Private_Dirty"])
