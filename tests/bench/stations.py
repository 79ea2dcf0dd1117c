# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: our controlled station beside a c104 server (lib60870) with the same 5 000 points, asked by one
bare socket, one after the other. What the rows mean: docs/bench.md. No time is asserted.
Exit codes: 0 done, 1 something did not work, 2 not built.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import selectors
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from contenders import report_program
from stopwatch import Memory, Spread
from stopwatch import _memory as memory_of

from bench import machine
from lab.gateway import REPOSITORY, Gateway, default_build, free_port, remove, run_directory

UNIT, CA = 1, 1001
BITS, REGISTERS = 1500, 1000  # coils and discrete inputs; input and holding registers
POINTS = 2 * BITS + 2 * REGISTERS
FIRST = {"coils": 1, "discrete_inputs": 10001, "input_registers": 30001, "holding_registers": 40001}
SIZE = {"coils": BITS, "discrete_inputs": BITS, "input_registers": REGISTERS, "holding_registers": REGISTERS}
READS = 4000
EVENTS_MAX = 100_000
RATES = (250, 500, 1000, 2000, 4000, 8000, 16000, 32000, 64000, 128000, 256000)  # events a second
W = 8
EVENT_TRIES = 2
PATIENCE_S = 3.0
EVENT_RING = 4096  # places for events in the map, as a configuration without it has
AWAY, AWAY_RING, QUEUED = "127.0.0.2", 16384, 10_000  # a master, and the events that wait for it
SOURCES = REPOSITORY / "package" / "openrtu" / "src"


@dataclass(frozen=True)
class Amounts:
    """How often each is repeated."""

    rounds: int
    event_rounds: int
    rates: tuple[int, ...]


FULL, QUICK = Amounts(7, 3, RATES), Amounts(1, 1, RATES[:1])


class BenchError(Exception):
    """A station did not do what is measured."""


# ---- the controlling station ------------------------------------------------------------------------


class Client:
    """Looks at no more of a frame than what is measured, so that it is not what is measured."""

    def __init__(self, address: tuple[str, int], source: str = "127.0.0.1") -> None:
        self.socket = socket.create_connection(address, 10, (source, 0))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._waiting = b""
        self._sent = self._taken = self._owed = 0
        self.socket.sendall(bytes.fromhex("680407000000"))
        while not self.frames():
            pass

    def frames(self) -> list[bytes]:
        """What one read brings, acknowledged at w; U frames among it."""
        octets = self.socket.recv(1 << 18)
        if not octets:
            raise BenchError("the station closed the connection")
        stream, at, frames = self._waiting + octets, 0, []
        while len(stream) - at >= 6 and len(stream) - at >= 2 + stream[at + 1]:
            frame = stream[at : at + 2 + stream[at + 1]]
            at += len(frame)
            frames.append(frame)
            if not frame[2] & 1:
                self._taken += 1
                self._owed += 1
            elif frame[2] == 0x43:
                self.socket.sendall(bytes.fromhex("680483000000"))
            if self._owed >= W:
                self.acknowledge()
        self._waiting = stream[at:]
        return frames

    def acknowledge(self) -> None:
        self._owed = 0
        self.socket.sendall(b"\x68\x04\x01\x00" + self._number(self._taken))

    def ask(self, *asdus: bytes) -> None:
        stream = b""
        for asdu in asdus:
            numbers = self._number(self._sent) + self._number(self._taken)
            stream += bytes((0x68, 4 + len(asdu))) + numbers + asdu
            self._sent += 1
        self._owed = 0
        self.socket.sendall(stream)

    @staticmethod
    def _number(count: int) -> bytes:
        return (count % 32768 << 1).to_bytes(2, "little")


def asdu(kind: int, cause: int, ioa: int, element: bytes) -> bytes:
    return bytes((kind, 1, cause, 0)) + CA.to_bytes(2, "little") + ioa.to_bytes(3, "little") + element


def interrogate(client: Client) -> float:
    """Seconds from sending it to its termination."""
    begun = time.perf_counter()
    client.ask(asdu(100, 6, 0, b"\x14"))
    objects = 0
    while True:
        for frame in client.frames():
            if not frame[2] & 1 and frame[8] == 20:
                objects += frame[7] & 0x7F
            if not frame[2] & 1 and frame[6] == 100 and frame[8] == 10:
                if objects != POINTS:
                    raise BenchError(f"an interrogation brought {objects} objects")
                client.acknowledge()
                return time.perf_counter() - begun


def read(client: Client, count: int) -> None:
    """Read commands, w of them under way."""
    for _ in range(count // W):
        client.ask(*(asdu(102, 5, 30001 + n, b"") for n in range(W)))
        answers = 0
        while answers < W:
            answers += sum(not f[2] & 1 and f[8] == 5 and f[6] == 11 for f in client.frames())
    client.acknowledge()


@dataclass
class Counted:
    """The events that one master has had; values and addresses count upwards."""

    events: int = 0
    last_s: float = 0.0

    def take(self, frame: bytes) -> None:
        if frame[2] & 1 or frame[8] != 3:
            return
        if int.from_bytes(frame[15:17], "little") != (self.events + 1) & 0xFFFF:
            raise BenchError(f"event {self.events} is missing")
        self.events += frame[7] & 0x7F
        self.last_s = time.perf_counter()


def receive_events(clients: list[Client], station: Station, rate: int) -> float:
    """Events a second at the slowest of the masters. Raises BenchError when one was lost."""
    events = min(EVENTS_MAX, rate)
    counted = {client: Counted() for client in clients}
    with selectors.DefaultSelector() as selector:
        for client in clients:
            selector.register(client.socket, selectors.EVENT_READ, client)
        begun = time.perf_counter()
        station.make_events(rate)
        while any(each.events < events for each in counted.values()):
            ready = selector.select(PATIENCE_S)
            if not ready:
                raise BenchError("events are missing")
            for key, _ in ready:
                for frame in key.data.frames():
                    counted[key.data].take(frame)
    for client in clients:
        client.acknowledge()
    return events / (max(each.last_s for each in counted.values()) - begun)


def count_events(client: Client, most: int) -> int:
    """Events of registers with a value, as the made ones have it: up to so many, or until no more come."""
    count = 0
    client.socket.settimeout(PATIENCE_S)
    with contextlib.suppress(TimeoutError):
        while count < most:
            count += sum(map(values_in, client.frames()))
    client.acknowledge()
    return count


def values_in(frame: bytes) -> int:
    """Objects of a spontaneous ASDU of scaled values, tagged or not, that are not 0."""
    if frame[2] & 1 or frame[8] != 3 or frame[6] not in (11, 35):
        return 0
    size = (len(frame) - 12) // (frame[7] & 0x7F)
    return sum(frame[at + 3 : at + 5] != b"\0\0" for at in range(12, len(frame), size))


# ---- the stations -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Station:
    """One that runs."""

    address: tuple[str, int]
    pid: int
    make_events: Callable[[int], None]  # at a rate, for a second, EVENTS_MAX at most
    map: Path | None = None

    def map_octets(self) -> int:
        return sum(file.stat().st_size for file in self.map.iterdir()) if self.map else 0

    def cpu_ns(self) -> int:
        """Of all its threads."""
        tasks = Path(f"/proc/{self.pid}/task").glob("*/schedstat")
        return sum(int(task.read_text().split()[0]) for task in tasks)


def event_source() -> Path:
    return report_program().with_name("event_source")


def configuration(port: int, **settings: object) -> dict[str, object]:
    tables = {table: [{"address": address} for address in range(size)] for table, size in SIZE.items()}
    line = {"value": 1, "active": 1, "baud_rate": 9600, "data_bits": 8, "stop_bits": 1, "parity": 0}
    station = {"address": "127.0.0.1", "port": port, "max_connections": 16, "connections_per_address": 16}
    return {"iec104": station, "port": [{**line, "slaves": [{"id": UNIT, **tables}]}], **settings}


@contextlib.contextmanager
def ours(**settings: object) -> Iterator[Station]:
    """rtud and rtu-iec104, with the source of events in the place of rtu-modbus; settings for its file."""
    directory = run_directory()
    try:
        build = directory / "build"
        (build / "modules").mkdir(parents=True)
        for name in ("rtud", "rtuctl"):
            (build / name).symlink_to(default_build().resolve() / name)
        (build / "modules" / "rtu-iec104").symlink_to(default_build().resolve() / "modules" / "rtu-iec104")
        (build / "modules" / "rtu-modbus").symlink_to(event_source().resolve())
        with Gateway(configuration(free_port(), **settings), directory, build) as gateway:
            gateway.wait_for(lambda: next(iter(gateway.points().values()))["quality"] == "good", 10, "good")
            pid = gateway.modules()["rtu-iec104"]["pid"]
            yield Station(gateway.address, pid, set_point_for(gateway.address), gateway.map)
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


@contextlib.contextmanager
def theirs() -> Iterator[Station]:
    """The c104 server, a process of its own."""
    port = free_port()
    command = [sys.executable, Path(__file__).with_name("c104_station.py"), str(port), str(CA)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdin is not None and process.stdout is not None
    points: dict[str, list[int]] = {"single": [], "scaled": []}
    for table, size in SIZE.items():
        kind = "single" if table in ("coils", "discrete_inputs") else "scaled"
        points[kind] += range(FIRST[table], FIRST[table] + size)

    def tell(what: object) -> None:
        print(json.dumps(what), file=process.stdin, flush=True)

    try:
        tell(points)
        tell([FIRST["input_registers"], REGISTERS])
        if process.stdout.readline() != "ready\n":
            raise BenchError("the c104 server did not start")
        yield Station(("127.0.0.1", port), process.pid, tell)
    finally:
        process.kill()
        process.wait()


# ---- what is measured -------------------------------------------------------------------------------


def measured(station: Station, rounds: int) -> dict[str, Spread | Memory]:
    times: dict[str, list[float]] = {"first": [], "again": [], "cpu": [], "reads": [], "read cpu": []}
    for _ in range(rounds):
        client = Client(station.address)
        times["first"].append(interrogate(client) * 1000)
        begun = station.cpu_ns()
        times["again"].append(interrogate(client) * 1000)
        times["cpu"].append((station.cpu_ns() - begun) / 1e6)
        begun, begun_s = station.cpu_ns(), time.perf_counter()
        read(client, READS)
        times["reads"].append(READS / (time.perf_counter() - begun_s))
        times["read cpu"].append((station.cpu_ns() - begun) / READS / 1000)
        client.socket.close()
    return {
        "GI of 5 000 points, first on a connection": Spread("ms", times["first"]),
        "GI again": Spread("ms", times["again"]),
        "CPU of such a GI": Spread("ms", times["cpu"]),
        "read commands": Spread("/s", times["reads"]),
        "CPU of a read": Spread("µs", times["read cpu"]),
        "memory of the process": memory_of(station.pid),
    }


@dataclass(frozen=True)
class Queue:
    """What a station keeps of QUEUED events for a master that is away."""

    memory: Memory  # of the process, while it keeps them
    map_octets: int
    kept: int  # as the master counts when it comes


def queued(station: Station) -> Queue:
    """Another master, who is there, sees when all were made."""
    present = Client(station.address)
    station.make_events(QUEUED)
    count_events(present, QUEUED)
    memory = memory_of(station.pid)
    away = Client(station.address, AWAY)
    kept = count_events(away, QUEUED)
    for client in (present, away):
        client.socket.close()
    return Queue(memory, station.map_octets(), kept)


def attempt(station: Station, masters: int, rate: int) -> float:
    """Events a second as they arrived, 0 when one was lost."""
    clients = [Client(station.address) for _ in range(masters)]
    try:
        return receive_events(clients, station, rate)
    except (BenchError, TimeoutError):
        return 0.0
    finally:
        for client in clients:
            client.socket.close()


def sustained(
    start: Callable[[], contextlib.AbstractContextManager[Station]], masters: int, amounts: Amounts
) -> Spread:
    """The highest rate at which none was lost, as it arrived: RATES upwards until one was."""
    best = []
    for _ in range(amounts.event_rounds):
        best.append(0.0)
        with start() as station:
            for rate in amounts.rates:
                arrived = next(
                    filter(None, (attempt(station, masters, rate) for _ in range(EVENT_TRIES))), 0.0
                )
                if not arrived:
                    break
                best[-1] = max(best[-1], arrived)
    return Spread("/s", best)


def queue_rows(our_map_octets: int, mine: Queue, other: Queue) -> list[str]:
    """The map's places for events beside those it had before are all that its growth is."""
    octets = (mine.map_octets - our_map_octets) / (AWAY_RING - EVENT_RING)
    ratio = f"{mine.memory.middle / other.memory.middle:.2g}"
    return [
        f"| kept of {QUEUED} events for a master that is away | {mine.kept} | {other.kept} | |",
        f"| memory of the process then | {mine.memory} | {other.memory} | {ratio} |",
        f"| the map, with {EVENT_RING} places for events | {our_map_octets / 1024:.0f} KiB | | |",
        f"| the map with these events, {AWAY_RING} places | {mine.map_octets / 1024:.0f} KiB | | |",
        f"| the map for each event, whoever waits for it | {octets:.0f} octets | | |",
    ]


def text_size() -> str:
    """Of iec104/ at -Os, by the cross compiler for ARMv5, or this machine's when there is none."""
    tests = ("test_", "fuzz_", "fake_")
    sources = [file for file in (SOURCES / "iec104").glob("*.c") if not file.name.startswith(tests)]
    wide_times = ["-D_GNU_SOURCE", "-D_TIME_BITS=64", "-D_FILE_OFFSET_BITS=64"]
    for prefix, target in (("arm-linux-gnueabi-", ["-march=armv5te", "-marm"]), ("", [])):
        if shutil.which(f"{prefix}gcc") is None:
            continue
        with tempfile.TemporaryDirectory() as folder:
            compiler = [f"{prefix}gcc", "-Os", *target, *wide_times, f"-I{SOURCES}", "-c", *sources]
            subprocess.run(compiler, cwd=folder, check=True)
            command = [f"{prefix}size", "-t", *Path(folder).glob("*.o")]
            total = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[
                -1
            ]
        return f"{int(total.split()[0]) / 1024:.1f} KiB, {'ARMv5' if prefix else 'this machine'}"
    return "no compiler"


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures our controlled station beside a c104 server.")
    parser.add_argument("--quick", action="store_true", help="a try of some ten seconds")
    amounts = QUICK if parser.parse_args().quick else FULL
    if not event_source().exists():
        print(f"not built: {event_source()}; type `make bench`, which builds it", file=sys.stderr)
        return 2
    head = f"{machine()}. Median (minimum..maximum) of {amounts.rounds}, of events {amounts.event_rounds}."
    results: list[dict[str, Spread | Memory]] = []
    queues: list[Queue] = []
    map_octets = 0
    try:
        for start in (ours, theirs):
            with start() as station:
                results.append(measured(station, amounts.rounds))
                map_octets = max(map_octets, station.map_octets())
            for masters in (1, 8):
                text = f"events without loss, to {masters} master{'s' if masters > 1 else ''}"
                results[-1][text] = sustained(start, masters, amounts)
        away = [{"name": "away", "masters": [AWAY]}]
        for begin in (lambda: ours(event_ring=AWAY_RING, redundancy_groups=away), theirs):
            with begin() as station:
                queues.append(queued(station))
    except (BenchError, OSError) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1
    print(f"\n{head}\n\n| measured | ours | c104 2.2.1 | ours / c104 |\n|---|---|---|---|")
    for text, mine in results[0].items():
        other = results[1][text]
        ratio = f"{mine.middle / other.middle:.2g}" if other.middle else ""
        print(f"| {text} | {mine} | {other} | {ratio} |")
    print(*queue_rows(map_octets, *queues), sep="\n")
    print(f"| text of iec104/ at -Os | {text_size()} | | |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
