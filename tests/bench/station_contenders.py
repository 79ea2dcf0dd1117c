# SPDX-License-Identifier: GPL-3.0-or-later
"""The controlled stations that are compared: ours, lib60870 in C where a user has it, and c104."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from bare_client import CA, BenchError, Client, asdu, interrogate
from contenders import report_program
from stopwatch import Memory
from stopwatch import _memory as memory_of

from lab.gateway import Gateway, default_build, free_port, remove, run_directory

UNIT = 1
BITS, REGISTERS = 1500, 1000  # coils and discrete inputs; input and holding registers
POINTS = 2 * BITS + 2 * REGISTERS
FIRST = {"coils": 1, "discrete_inputs": 10001, "input_registers": 30001, "holding_registers": 40001}
SIZE = {"coils": BITS, "discrete_inputs": BITS, "input_registers": REGISTERS, "holding_registers": REGISTERS}
EVENTS_MAX = 100_000
EVENTS_AN_ASDU = 16  # scaled values with time tag
EVENT_RING = 4096  # places for events in the map, as a configuration without it has
AWAY, AWAY_RING = "127.0.0.2", 16384  # a master, and the places for events while it is away
PROCESS_CLOCK = 2  # with ~pid << 3: what clock_getcpuclockid(3) gives for another process
HERE = Path(__file__).parent


@dataclass(frozen=True)
class Station:
    """One that runs."""

    address: tuple[str, int]
    pids: tuple[int, ...]  # all that it consists of
    make_events: Callable[[int], None]  # at a rate, for a second, EVENTS_MAX at most
    map: Path | None = None

    def map_octets(self) -> int:
        return sum(file.stat().st_size for file in self.map.iterdir()) if self.map else 0

    def cpu_ns(self) -> int:
        """Of all threads of all processes, those that have ended included."""
        return sum(time.clock_gettime_ns(~pid << 3 | PROCESS_CLOCK) for pid in self.pids)

    def memory(self) -> Memory:
        return sum(map(memory_of, self.pids), start=Memory(0, 0, 0))


class Start(Protocol):
    def __call__(self, places: int, away: str = "") -> contextlib.AbstractContextManager[Station]:
        """Starts a station with places for so many events, and with a queue for this master if named."""


@dataclass(frozen=True)
class Contender:
    name: str
    start: Start


# ---- ours -------------------------------------------------------------------------------------------


def event_source() -> Path:
    return report_program().with_name("event_source")


def configuration(port: int, **settings: object) -> dict[str, object]:
    tables = {table: [{"address": address} for address in range(size)] for table, size in SIZE.items()}
    line = {"value": 1, "active": 1, "baud_rate": 9600, "data_bits": 8, "stop_bits": 1, "parity": 0}
    station = {"address": "127.0.0.1", "port": port, "max_connections": 16, "connections_per_address": 16}
    return {"iec104": station, "port": [{**line, "slaves": [{"id": UNIT, **tables}]}], **settings}


def our_memory() -> Memory:
    """Of the gateway as it is, with a line on which nobody answers; after an interrogation."""
    directory = run_directory()
    try:
        with Gateway(configuration(free_port()), directory) as gateway:
            # By then rtu-modbus has locked its memory.
            gateway.wait_for(lambda: all(line["port_errors"] for line in gateway.query("lines")), 10, "line")
            client = Client(gateway.address)
            interrogate(client, POINTS)
            return Station(gateway.address, pids_of(gateway), lambda rate: None).memory()
    finally:
        remove(directory)


def pids_of(gateway: Gateway) -> tuple[int, ...]:
    return tuple(module["pid"] for module in gateway.modules().values() if module["pid"])


@contextlib.contextmanager
def our_station(places: int, away: str = "") -> Iterator[Station]:
    """rtud and rtu-iec104, with the source of events in the place of rtu-modbus."""
    groups = {"redundancy_groups": [{"name": "away", "masters": [away]}]} if away else {}
    directory = run_directory()
    try:
        build = directory / "build"
        (build / "modules").mkdir(parents=True)
        for name in ("rtud", "rtuctl"):
            (build / name).symlink_to(default_build().resolve() / name)
        (build / "modules" / "rtu-iec104").symlink_to(default_build().resolve() / "modules" / "rtu-iec104")
        (build / "modules" / "rtu-modbus").symlink_to(event_source().resolve())
        config = configuration(free_port(), event_ring=places, **groups)
        with Gateway(config, directory, build) as gateway:
            gateway.wait_for(lambda: next(iter(gateway.points().values()))["quality"] == "good", 10, "good")
            yield Station(gateway.address, pids_of(gateway), set_point_for(gateway.address), gateway.map)
    finally:
        remove(directory)


def set_point_for(address: tuple[str, int]) -> Callable[[int], None]:
    """The set-point that starts our source, by a master that leaves at once."""

    def make_events(rate: int) -> None:
        control = Client(address)
        control.ask(asdu(49, 6, 40001, (rate // 10).to_bytes(2, "little") + b"\x00"))
        while not any(frame[6:7] == b"\x31" for frame in control.frames()):
            pass
        control.socket.close()

    return make_events


def ours() -> Contender:
    return Contender("ours", our_station)


# ---- the others: a process that takes the rates of its events from standard input -----------------------


@contextlib.contextmanager
def program(port: int, command: list[str | Path], *lines: object) -> Iterator[Station]:
    """Lines are told first, as JSON."""
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdin is not None and process.stdout is not None

    def tell(what: object) -> None:
        print(json.dumps(what), file=process.stdin, flush=True)

    try:
        for line in lines:
            tell(line)
        if process.stdout.readline() != "ready\n":
            raise BenchError(f"{command} did not start")
        yield Station(("127.0.0.1", port), (process.pid,), tell)
    finally:
        process.kill()
        process.wait()


def c104_station(places: int, away: str = "") -> contextlib.AbstractContextManager[Station]:
    """It has a queue for each connection only, of a size that it does not tell."""
    del places, away
    port = free_port()
    points: dict[str, list[int]] = {"single": [], "scaled": []}
    for table, size in SIZE.items():
        kind = "single" if table in ("coils", "discrete_inputs") else "scaled"
        points[kind] += range(FIRST[table], FIRST[table] + size)
    command = [sys.executable, HERE / "c104_station.py", str(port), str(CA)]
    return program(port, command, points, [FIRST["input_registers"], REGISTERS])


def c104() -> Contender:
    return Contender("c104 (Python)", c104_station)


def lib60870_library(checkout: Path) -> tuple[Path, Path]:
    """The folder lib60870-C of a checkout and the static library that was built there. Raises BenchError."""
    folder = next((d for d in (checkout, checkout / "lib60870-C") if (d / "src/inc/api").is_dir()), None)
    if folder is None:
        raise BenchError(f"{checkout} is no checkout of lib60870: it has no src/inc/api")
    for built in sorted(folder.glob("build*/**/*60870.a")):
        return folder.resolve(), built.resolve()
    raise BenchError(
        f"{folder} has no library in build: type `cmake -S {folder} -B {folder}/build "
        f"-DCMAKE_BUILD_TYPE=Release && cmake --build {folder}/build --target lib60870`"
    )


def lib60870(checkout: Path, directory: Path) -> Contender:
    """Compiles lib60870_station.c with the bench's flags against a user's checkout. Raises BenchError."""
    folder, library = lib60870_library(checkout)
    executable = directory / "lib60870_station"
    headers = [f"-I{folder}/src/{part}" for part in ("inc/api", "common/inc", "hal/inc")]
    source = HERE / "lib60870_station.c"
    command = ["cc", "-O2", *headers, source, library, "-lpthread", "-lm", "-lrt", "-o", executable]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    if run.returncode != 0:
        raise BenchError(f"{source.name} cannot be built with {library}:\n{run.stderr}")

    def start(places: int, away: str = "") -> contextlib.AbstractContextManager[Station]:
        port = free_port()
        # The first scaled values are the input registers, as ours.
        kinds = {"coils": "single", "discrete_inputs": "single"}
        points = [f"{kinds.get(table, 'scaled')}:{FIRST[table]}:{size}" for table, size in SIZE.items()]
        asdus = str(places // EVENTS_AN_ASDU)
        return program(port, [executable, str(port), str(CA), asdus, away or "-", *points])

    return Contender("lib60870 (C)", start)
