# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: our server of IEC 61850 beside libiec61850's with the same 5 000 points, asked by one client,
by turns; then how long a change takes to its GOOSE message, and a message to the point. What the rows mean:
docs/bench.md. No time is asserted.
Exit codes: 0 done, 1 something did not work, 2 not built.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import os
import re
import select
import shutil
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bare_client import BenchError
from station_contenders import EVENTS_MAX, PROCESS_CLOCK, event_source, pids_of, set_point_for
from stations import line, spreads, table, text_size
from stopwatch import Memory, Spread
from stopwatch import _memory as memory_of

from bench import machine
from lab.gateway import REPOSITORY, Gateway, GatewayError, default_build, free_port, remove, run_directory
from lab.modules import compiled, place

sys.path.insert(0, str(REPOSITORY / "tests"))
from peers import mms

HERE = Path(__file__).parent
DEVICES, STATES, MEASURED = 50, 60, 39  # and a register that is set: 5 000 points
READS, LISTS, LIST = 1000, 100, 100
RATES = tuple(1000 << n for n in range(7))  # events a second
QUIET_S = 3.0  # without an octet: no more comes
TRIES = 2  # of a rate: a busy host may hold up either end
PLACES = 65536
CHANGES, PERIOD_MS = 2000, 5  # that GOOSE tells
APP_ID, CONTROL = 0x3001, "BENCHLD0/LLN0$GO$changed"
PEER_APP_ID, PEER = 0x3002, "PEERLD0/LLN0$GO$changed"
CHANGE, RELAY = "change to GOOSE frame", "GOOSE frame to its point in another one"
ETHERTYPE, ALL_FRAMES = 0x88B8, 3
YES = bytes.fromhex("8301ff")
OURS, THEIRS = "ours", "libiec61850 (C)"
PROGRAMS = REPOSITORY / "build/arm-release-tls"

ASSOCIATE, ASSOCIATE_CPU = "association, with its end", "CPU of such an association"
BROWSE, BROWSE_CPU = "browse: all names and types", "CPU of such a browse"
READ, READ_CPU = "read of a data object", "CPU of such a read"
READ_MANY, READ_MANY_CPU = f"read of {LIST} data objects", "CPU of that"
UNITS = dict.fromkeys((ASSOCIATE, BROWSE, BROWSE_CPU), "ms") | dict.fromkeys(
    (ASSOCIATE_CPU, READ, READ_CPU, READ_MANY, READ_MANY_CPU), "µs"
)


@dataclass(frozen=True)
class Amounts:
    rounds: int
    associations: int
    reads: int
    rates: tuple[int, ...]
    changes: int


FULL = Amounts(5, 50, READS, RATES, CHANGES)
QUICK = Amounts(1, 3, 50, RATES[:1], 50)


# ---- the servers -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Server:
    """One that runs."""

    port: int
    pid: int
    others: tuple[int, ...]  # what works for it besides
    make_events: Callable[[int], None]  # at a rate, for a second

    def cpu_us(self) -> float:
        return cpu_us(self.pid)

    def cpu_of_all_us(self) -> float:
        return sum(map(cpu_us, (self.pid, *self.others)))


def cpu_us(pid: int) -> float:
    """Of all its threads."""
    return time.clock_gettime_ns(~pid << 3 | PROCESS_CLOCK) / 1000


def configuration(port: int, mms_port: int, places: int = 0) -> dict[str, Any]:
    """places: for events, other than a configuration without it has."""
    tables = {"discrete_inputs": STATES, "input_registers": MEASURED, "holding_registers": 1}
    slaves = [
        {"id": unit} | {name: [{"address": each} for each in range(size)] for name, size in tables.items()}
        for unit in range(1, DEVICES + 1)
    ]
    pace = {"baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    server: dict[str, Any] = {"address": "127.0.0.1", "port": mms_port, "max_pdu": 65000}
    return {
        "iec104": {"address": "127.0.0.1", "port": port},
        "iec61850": server | ({"report_buffer": places} if places else {}),
        "port": [{"value": 1, "active": 1, **pace, "slaves": slaves}],
        **({"event_ring": places} if places else {}),
    }


@contextlib.contextmanager
def ours(places: int = 0) -> Iterator[Server]:
    """rtud, rtu-iec61850 and rtu-iec104, with the source of events in the place of rtu-modbus."""
    directory = run_directory()
    try:
        build = directory / "build"
        (build / "modules").mkdir(parents=True)
        for name in ("rtud", "rtuctl", "modules/rtu-iec104", "modules/rtu-iec61850"):
            (build / name).symlink_to(default_build().resolve() / name)
        (build / "modules/rtu-modbus").symlink_to(event_source().resolve())
        config = configuration(free_port(), free_port(), places)
        with Gateway(config, directory, build) as gateway:
            points = gateway.points
            gateway.wait_for(lambda: next(iter(points().values()))["quality"] == "good", 10, "good")
            modules = gateway.modules()
            source = next(module["pid"] for name, module in modules.items() if name.startswith("rtu-modbus"))
            pid = modules["rtu-iec61850"]["pid"]
            assert pid in pids_of(gateway)
            yield Server(config["iec61850"]["port"], pid, (source,), set_point_for(gateway.address))
    finally:
        remove(directory)


def library() -> Path:
    """That of the package pyiec61850-ng."""
    package = importlib.util.find_spec("pyiec61850")
    if package is None or not package.submodule_search_locations:
        raise BenchError("the package pyiec61850-ng is not installed")
    return Path(package.submodule_search_locations[0]) / "libiec61850.so"


@contextlib.contextmanager
def theirs() -> Iterator[Server]:
    port = free_port()
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "libiec61850_server"
        source = HERE / "libiec61850_server.c"
        flags = ["-O2", f"-Wl,-rpath,{library().parent}"]
        subprocess.run(["cc", *flags, "-o", program, source, library()], check=True)
        sizes = map(str, (port, DEVICES, STATES, MEASURED + 1))
        process = subprocess.Popen(
            [program, *sizes], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert process.stdin is not None and process.stdout is not None

        def make_events(rate: int) -> None:
            print(rate, file=process.stdin, flush=True)

        try:
            if process.stdout.readline() != "ready\n":
                raise BenchError("libiec61850's server did not start")
            yield Server(port, process.pid, (), make_events)
        finally:
            process.kill()
            process.wait()


# ---- association, browse, reads --------------------------------------------------------------------


def device(number: int) -> str:
    return f"OpenRTUCA{1001 + number}"


def browse(client: mms.Client) -> int:
    """How many names there are. The types are those of logical nodes."""
    count = 0
    for name in client.names(9):
        names = client.names(0, name)
        count += len(names)
        for node in (each for each in names if "$" not in each):
            tag, _ = client.ask(mms.element(mms.TYPE, mms.element(0xA0, mms.name(name, node))))
            if tag != mms.RESPONSE:
                raise BenchError(f"{name}/{node} has no type")
    return count


def measured_names(client: mms.Client) -> list[tuple[str, str]]:
    """The measured values of the first device that has so many, and of the next."""
    found: list[tuple[str, str]] = []
    for number in range(DEVICES):
        found += [(device(number), name) for name in client.members(device(number), "LLN0$measured")]
        if len(found) >= LIST:
            break
    return found[:LIST]


def answer_of(client: mms.Client, request: bytes) -> bytes:
    client.send(request)
    return client.message()


def timed(server: Server, deed: Callable[[], object], count: int) -> tuple[float, float]:
    """Median µs, and the server's CPU in µs, of a deed."""
    begun, times = server.cpu_us(), []
    for _ in range(count):
        at = time.perf_counter()
        deed()
        times.append((time.perf_counter() - at) * 1e6)
    return statistics.median(times), (server.cpu_us() - begun) / count


def associate(server: Server) -> None:
    with mms.Client(server.port) as client:
        client.send(mms.tpkt(mms.data(bytes([mms.CONCLUDE, 0]))))
        client.message()


def one_turn(server: Server, amounts: Amounts) -> dict[str, float]:
    found: dict[str, float] = {}
    us, found[ASSOCIATE_CPU] = timed(server, lambda: associate(server), amounts.associations)
    found[ASSOCIATE] = us / 1000
    with mms.Client(server.port) as client:
        us, cpu = timed(server, lambda: browse(client), 1)
        found |= {BROWSE: us / 1000, BROWSE_CPU: cpu / 1000}
        names = measured_names(client)
        one, many = (mms.tpkt(mms.data(mms.request(1, mms.read(*wanted)))) for wanted in (names[:1], names))
        for request, count, rows in (
            (one, amounts.reads, (READ, READ_CPU)),
            (many, amounts.reads * LISTS // READS, (READ_MANY, READ_MANY_CPU)),
        ):
            us, cpu = timed(server, lambda request=request: answer_of(client, request), count)
            found |= dict(zip(rows, (us, cpu), strict=True))
    return found


# ---- reports ---------------------------------------------------------------------------------------


class Heard(mms.Client):
    """What a client has received, to be looked at when it is all there."""

    def __init__(self, received: bytes) -> None:
        self.received, self.at = received, 0

    def octets(self, count: int) -> bytes:
        octets = self.received[self.at : self.at + count]
        if len(octets) < count:
            raise EOFError
        self.at += count
        return octets

    def events(self) -> int:
        """Values in all reports. libiec61850 sets BufOvfl in the first one after a purge: it is not asked."""
        count = 0
        with contextlib.suppress(EOFError):
            while True:
                tag, pdu = self.mms()
                if tag != mms.REPORT:
                    continue
                included = mms.report_of(pdu)[6][1][1:]
                count += sum(octet.bit_count() for octet in included)
        return count


def enable(client: mms.Client) -> None:
    for number in range(DEVICES):
        block = "LLN0$BR$brcbMeasured01"
        for attribute in ("PurgeBuf", "RptEna"):
            if client.write(device(number), (f"{block}${attribute}", YES)) != [mms.DONE]:
                raise BenchError(f"{block} of {device(number)} is not enabled")


def reported(server: Server, rate: int) -> tuple[float, float] | None:
    """Events a second as they arrived, and CPU of an event in µs. None: some were lost."""
    wanted = min(rate, EVENTS_MAX)
    with mms.Client(server.port) as client:
        enable(client)
        begun, cpu = time.perf_counter(), server.cpu_of_all_us()
        server.make_events(rate)
        pieces, last = [], begun
        while select.select([client.socket], [], [], QUIET_S if pieces else 3 * QUIET_S)[0]:
            pieces.append(client.socket.recv(1 << 20))
            if not pieces[-1]:
                return None
            last = time.perf_counter()
        cpu = server.cpu_of_all_us() - cpu
    found = Heard(b"".join(pieces)).events()
    return (wanted / (last - begun), cpu / wanted) if found == wanted else None


def best_of(
    start: Callable[[], contextlib.AbstractContextManager[Server]], rates: tuple[int, ...]
) -> tuple[float, float]:
    """The highest rate without loss, as it arrived, and CPU of an event at the lowest."""
    best, cost, tries = 0.0, 0.0, TRIES
    left = list(rates)
    while left and tries:
        with start() as server:
            found = reported(server, left[0])
        if found is None:
            tries -= 1
            continue
        best, cost, tries = max(best, found[0]), cost or found[1], TRIES
        left.pop(0)
    return best, cost


# ---- GOOSE -----------------------------------------------------------------------------------------


@contextlib.contextmanager
def cable() -> Iterator[tuple[str, str]]:
    """Two interfaces of this machine, the gateway's and its partner's, that carry nobody else's frames."""
    near, far = (f"{end}{os.getpid()}" for end in ("near", "far"))
    subprocess.run(["ip", "link", "add", near, "type", "veth", "peer", "name", far], check=True)
    try:
        for end in (near, far):
            subprocess.run(["ip", "link", "set", end, "up"], check=True)
        yield near, far
    finally:
        subprocess.run(["ip", "link", "del", near], check=True)


def goose_site(interface: str, goose: dict[str, Any]) -> dict[str, Any]:
    """A gateway that tells a point's changes."""
    told = {"name": "bench", "control_block": CONTROL, "data_set": "BENCHLD0/LLN0$changed", "app_id": APP_ID}
    return {
        "iec104": {"address": "127.0.0.1", "port": free_port()},
        "port": [],
        "goose": {"interface": interface, "publish": [told | {"points": ["changed"]}]} | goose,
    }


def changing_site(directory: Path, interface: str) -> dict[str, Any]:
    module = {
        "name": "changer",
        "program": compiled(directory, "changer", HERE / "goose_module.c"),
        "period_ms": PERIOD_MS,
        "heartbeat_limit_ms": 5000,
        "ca": 900,
        "points": [{"name": "changed", "type": "integer", "ioa": 1}],
    }
    return goose_site(interface, {}) | {"modules": [module]}


def relaying_site(interface: str) -> dict[str, Any]:
    peer = {"name": "peer", "control_block": PEER, "app_id": PEER_APP_ID, "ca": 900}
    data = [{"name": "changed", "type": "integer", "ioa": 1}]
    return goose_site(interface, {"subscribe": [peer | {"data": data}]})


@contextlib.contextmanager
def frames_of(interface: str) -> Iterator[socket.socket]:
    """Those that come, and those that go."""
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0) as wire:
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        wire.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        wire.bind((interface, ALL_FRAMES))
        wire.settimeout(20)
        yield wire


def hear_state(wire: socket.socket, arrived: dict[int, dict[int, int]]) -> None:
    """The next frame: if it is the first message of a state, when the kernel had it, by APPID and value."""
    frame, ancillary, *_ = wire.recvmsg(2048, 64)
    if frame[12:14] != ETHERTYPE.to_bytes(2, "big"):
        return
    ((_, pdu),) = mms.elements(frame[22:])
    fields = dict(mms.elements(pdu))
    if any(fields[0x86]):  # sqNum
        return
    seconds, ns = struct.unpack("qq", ancillary[0][2])
    (_, value), *_ = mms.elements(fields[0xAB])
    app_id = int.from_bytes(frame[14:16], "big")
    of = arrived.setdefault(app_id, {})
    of.setdefault(int.from_bytes(value, "big", signed=True), seconds * 1_000_000_000 + ns)


def between(begun: dict[int, int], ended: dict[int, int]) -> list[float]:
    """µs, ascending."""
    return sorted((ended[value] - begun[value]) / 1000 for value in begun.keys() & ended.keys())


def change_delays(changes: int) -> list[float]:
    """From before a change is published to its frame."""
    directory = run_directory()
    arrived: dict[int, dict[int, int]] = {APP_ID: {}}
    try:
        place(directory, default_build())
        with (
            cable() as (near, _),
            frames_of(near) as wire,
            Gateway(changing_site(directory, near), directory) as gateway,
        ):
            while len(arrived[APP_ID]) < changes:
                hear_state(wire, arrived)
            log = gateway.log_file.read_text(errors="replace")
    finally:
        remove(directory)
    begun = {int(value): int(ns) for value, ns in re.findall(r"BENCH change (\d+) (\d+)", log)}
    return between(begun, arrived[APP_ID])


def message_of_peer(state: int) -> bytes:
    """The first message of a state whose value is its number."""
    texts = {0x80: PEER.encode(), 0x82: b"PEERLD0/LLN0$changed", 0x83: b"peer", 0x84: bytes(8)}
    numbers = {0x81: 2000, 0x85: state, 0x86: 0, 0x88: 1, 0x8A: 1}
    fields = texts | {tag: number.to_bytes(4, "big") for tag, number in numbers.items()}
    fields |= {0x87: b"\0", 0x89: b"\0"}  # simulation, ndsCom
    fields[0xAB] = mms.element(0x85, state.to_bytes(4, "big"))
    pdu = mms.element(0x61, b"".join(mms.element(tag, fields[tag]) for tag in sorted(fields)))
    head = struct.pack(">HHHI", ETHERTYPE, PEER_APP_ID, len(pdu) + 8, 0)
    return bytes.fromhex("010ccd010000 020000000001") + head + pdu


def relay_delays(changes: int) -> list[float]:
    """From the frame that brings a value to the frame that tells the point with it."""
    directory = run_directory()
    arrived: dict[int, dict[int, int]] = {APP_ID: {}, PEER_APP_ID: {}}
    try:
        with (
            cable() as (near, far),
            frames_of(near) as wire,
            socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0) as peer,
            Gateway(relaying_site(near), directory) as gateway,
        ):
            peer.bind((far, 0))
            gateway.wait_for(lambda: gateway.modules()["rtu-goose"]["state"] == "running", 20, "it runs")
            for state in range(1, changes + 1):
                peer.send(message_of_peer(state))
                give_up = time.monotonic() + 20
                while state not in arrived[APP_ID]:
                    hear_state(wire, arrived)
                    if time.monotonic() > give_up:
                        raise BenchError("rtu-goose does not tell what it was told")
                time.sleep(PERIOD_MS / 1000)
    finally:
        remove(directory)
    return between(arrived[PEER_APP_ID], arrived[APP_ID])


SO_TIMESTAMPNS = 35


def goose_rows(changes: int) -> list[list[str]]:
    if os.geteuid() != 0:
        return [[CHANGE, "only root has frames"]]
    rows = []
    for text, delays in ((CHANGE, change_delays(changes)), (RELAY, relay_delays(changes))):
        p50, p99 = (delays[min(len(delays) - 1, len(delays) * part // 100)] for part in (50, 99))
        rows.append([text, f"p50 {p50:.0f} µs, p99 {p99:.0f} µs, max {delays[-1]:.0f} µs of {len(delays)}"])
    return rows


# ---- the table -------------------------------------------------------------------------------------


def text_kib(program: Path, size: str = "size") -> str:
    listed = subprocess.run([size, program], check=True, capture_output=True, text=True).stdout
    return f"{int(listed.splitlines()[1].split()[0]) / 1024:.0f} KiB"


def measured(amounts: Amounts) -> list[list[str]]:
    starts = {OURS: ours, THEIRS: theirs}
    values: dict[str, dict[str, list[float]]] = {}
    memory: dict[str, Spread | Memory] = {}
    with contextlib.ExitStack() as stack:
        servers = {name: stack.enter_context(start()) for name, start in starts.items()}
        for number in range(amounts.rounds):
            for name in list(servers) if number % 2 == 0 else list(servers)[::-1]:
                for row, value in one_turn(servers[name], amounts).items():
                    values.setdefault(row, {}).setdefault(name, []).append(value)
        for name, server in servers.items():
            memory[name] = memory_of(server.pid)
    rows = [line(row, spreads(UNITS[row], found), starts) for row, found in values.items()]
    rows.append(line("memory of the server", memory, starts))
    best = {OURS: best_of(lambda: ours(PLACES), amounts.rates), THEIRS: best_of(theirs, amounts.rates)}
    for text, unit, at in (
        ("events in buffered reports, without loss", "/s", 0),
        (f"CPU of an event, {amounts.rates[0]} a second", "µs", 1),
    ):
        rows.append(line(text, spreads(unit, {name: [found[at]] for name, found in best.items()}), starts))
    return [
        ["measured", *starts, f"ours / {THEIRS}"],
        *rows,
        *goose_rows(amounts.changes),
        ["text, this machine", text_kib(default_build() / "modules/rtu-iec61850"), text_kib(library())],
        ["text of iec61850/ at -Os", text_size("iec61850")],
        *arm_rows(),
    ]


def arm_rows() -> list[list[str]]:
    program = PROGRAMS / "modules/rtu-iec61850"
    if not program.exists() or shutil.which("arm-linux-gnueabi-size") is None:
        return []
    return [["text of rtu-iec61850 as the image has it, ARMv5", text_kib(program, "arm-linux-gnueabi-size")]]


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures our server of IEC 61850 beside libiec61850's.")
    parser.add_argument("--quick", action="store_true", help="a try of some seconds")
    amounts = QUICK if parser.parse_args().quick else FULL
    missing = [
        file for file in (default_build() / "modules/rtu-iec61850", event_source()) if not file.exists()
    ]
    if missing:
        print(
            f"not built: {', '.join(map(str, missing))}; type `make bench`, which builds it", file=sys.stderr
        )
        return 2
    head = f"{machine()}. Median (minimum..maximum) of {amounts.rounds} turns."
    try:
        lines = measured(amounts)
    except (BenchError, GatewayError, OSError, subprocess.SubprocessError) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1
    print(f"\n{head}\n\n{table(lines)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
