# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: what a manager of SNMPv3 costs the station, beside a controlling station and beside Net-SNMP's
own table helper with as many rows. What the rows mean: docs/bench.md. No time is asserted.
Exit codes: 0 done, 1 something did not work, 2 wrong usage or not built.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import emulated
import station_contenders
from bare_client import BenchError, Client, interrogate
from pysnmp.hlapi.v3arch.asyncio import (
    USM_AUTH_HMAC192_SHA256,
    USM_PRIV_CFB128_AES,
    ContextData,
    SnmpEngine,
    UdpTransportTarget,
    UsmUserData,
    bulk_cmd,
)
from pysnmp.proto.rfc1902 import Null, ObjectName
from station_contenders import PROCESS_CLOCK, event_source, set_point_for
from stopwatch import Spread
from stopwatch import _memory as memory_of

from bench import machine
from lab.gateway import Gateway, GatewayError, default_build, free_port, remove, run_directory
from lab.manager import CENTRE, USERS, Manager, environment, free_udp_port, make_keys, oid, receiver

# Coils, discrete inputs, input registers (the source of events needs 256), holding registers.
SIZES = {1000: (200, 200, 300, 300), 5000: (1500, 1500, 1000, 1000)}
ROUNDS, QUICK_ROUNDS = 5, 1
REPETITIONS = 12  # rows of three columns that fit into a message of 1 472 octets
EVENTS, RATES = 4000, (1000, 2000, 4000)
COLUMNS = ("Value", "Quality", "Time")
TABLES = [[oid(f"rtu{base}{column}") for column in COLUMNS] for base in ("Single", "Measured")]
ENTRY = [f"{oid('rtuMeasuredTable')}.1.{column}" for column in (1, 2, 3)]  # of the contender
IMAGE = [[oid(f"rtuImage{column}") for column in ("Event", "Data")]]


def cpu_ms(pid: int) -> float:
    return time.clock_gettime_ns(~pid << 3 | PROCESS_CLOCK) / 1e6


# ---- the manager ---------------------------------------------------------------------------------


class Asker:
    """pysnmp, with one engine for all."""

    def __init__(self, port: int) -> None:
        self.loop = asyncio.new_event_loop()
        self.engine = SnmpEngine()
        self.port = port
        self.user = UsmUserData(
            CENTRE.name,
            CENTRE.authentication,
            CENTRE.encryption,
            authProtocol=USM_AUTH_HMAC192_SHA256,
            privProtocol=USM_PRIV_CFB128_AES,
        )

    async def _walk(self, columns: list[str]) -> tuple[int, int]:
        """GETBULK over columns until the first one ends. Returns the instances of it, and the requests."""
        target = await UdpTransportTarget.create(("127.0.0.1", self.port), timeout=10, retries=0)
        first, names, rows, requests = columns[0], columns, 0, 0
        while True:
            pairs = [(ObjectName(name), Null("")) for name in names]
            failure, status, _, found = await bulk_cmd(
                self.engine, self.user, target, ContextData(), 0, REPETITIONS, *pairs, lookupMib=False
            )
            if failure or status:
                raise BenchError(f"a GETBULK failed: {failure or status}")
            requests += 1
            whole = [str(name) for name, _ in found[: len(found) // len(columns) * len(columns)]]
            here = [name for name in whole[:: len(columns)] if name.startswith(f"{first}.")]
            rows += len(here)
            if len(here) < len(whole) // len(columns) or not whole:
                return rows, requests
            names = whole[-len(columns) :]

    def close(self) -> None:
        self.engine.close_dispatcher()
        self.loop.run_until_complete(asyncio.sleep(0))
        self.loop.close()

    def interrogate(self, tables: list[list[str]]) -> tuple[int, int]:
        found = [self.loop.run_until_complete(self._walk(columns)) for columns in tables]
        return sum(rows for rows, _ in found), sum(requests for _, requests in found)


# ---- the contenders ------------------------------------------------------------------------------


@contextlib.contextmanager
def ours(
    points: int, folder: Path, sink_port: int, build: Path | None = None
) -> Iterator[tuple[Gateway, int]]:
    """rtud, rtu-iec104 and rtu-snmp, with the source of events as rtu-modbus; the agent's port."""
    port = free_udp_port()
    sizes = dict(zip(station_contenders.SIZE, SIZES[points], strict=True))
    tables = {table: [{"address": address} for address in range(size)] for table, size in sizes.items()}
    config = station_contenders.configuration(free_port(), event_ring=16384)
    config["port"][0]["slaves"][0] |= tables  # type: ignore[index]
    users = [{"name": user.name, "role": role} for user, role in USERS.items()]
    sink = {"name": "nms", "address": "127.0.0.1", "port": sink_port, "user": CENTRE.name, "window": 16}
    snmp = {"address": "127.0.0.1", "port": port, "users": users, "sinks": [sink], "rate": 100000}
    config["snmp"] = snmp | {"keys": str(folder / "keys"), "state": str(folder / "state")}
    make_keys(config, folder)
    if build is None:
        build = folder / "build"
        (build / "modules").mkdir(parents=True)
        for name in ("rtud", "rtuctl", "modules/rtu-iec104", "modules/rtu-snmp"):
            (build / name).symlink_to(default_build().resolve() / name)
        (build / "modules/rtu-modbus").symlink_to(event_source().resolve())
    with Gateway(config, folder, build) as gateway:
        gateway.wait_for(lambda: next(iter(gateway.points().values()))["quality"] == "good", 10, "good")
        gateway.wait_for(lambda: gateway.modules()["rtu-snmp"]["alive"], 10, "the agent runs")
        yield gateway, port


@contextlib.contextmanager
def theirs(rows: int, folder: Path, program: Path | None = None) -> Iterator[tuple[int, int]]:
    """The contender's process and port."""
    port = free_udp_port()
    command = [program or event_source().with_name("default_agent"), str(port), str(rows)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment(folder)
    )
    try:
        assert process.stdout is not None
        if process.stdout.readline() != b"ready\n":
            raise BenchError(f"{command} did not start")
        yield process.pid, port
    finally:
        process.kill()
        process.wait()


# ---- what is measured ----------------------------------------------------------------------------


def cost(read: Callable[[], float], ask: Callable[[], object], rounds: int, unit: str = "ms") -> Spread:
    ask()
    found = []
    for _ in range(rounds):
        begun = read()
        ask()
        found.append(read() - begun)
    return Spread(unit, found)


def expect(found: int, wanted: int) -> None:
    if found != wanted:
        raise BenchError(f"an interrogation brought {found} rows of {wanted}")


def costs(contenders: list[tuple[int, Callable[[], object]]], rounds: int) -> list[Spread]:
    """CPU of each, by turns: whatever else this machine does meets all of them alike."""
    found: list[list[float]] = [[] for _ in contenders]
    for _, ask in contenders:
        ask()
    for _ in range(rounds):
        for (pid, ask), times in zip(contenders, found, strict=True):
            begun = cpu_ms(pid)
            ask()
            times.append(cpu_ms(pid) - begun)
    return [Spread("ms", times) for times in found]


def interrogations(points: int, rounds: int) -> Iterator[tuple[str, Any]]:
    folder, other_folder = run_directory(), run_directory()
    try:
        with (
            ours(points, folder, free_udp_port()) as (gateway, port),
            theirs(points, other_folder) as (other_agent, other_port),
        ):
            asker, other_asker, pids = Asker(port), Asker(other_port), gateway.modules()
            agent, station = (pids[name]["pid"] for name in ("rtu-snmp", "rtu-iec104"))
            rows, requests = asker.interrogate(TABLES)
            expect(rows, points)
            _, image_requests = asker.interrogate(IMAGE)
            other_rows, other_requests = other_asker.interrogate([ENTRY])
            expect(other_rows, points)
            tables, image, other = costs(
                [
                    (agent, lambda: asker.interrogate(TABLES)),
                    (agent, lambda: asker.interrogate(IMAGE)),
                    (other_agent, lambda: other_asker.interrogate([ENTRY])),
                ],
                rounds,
            )
            yield f"GI of {points} by tables, {requests} requests", tables
            yield f"GI of {points} by image, {image_requests} requests", image
            client = Client(gateway.address)
            iec104 = cost(lambda: cpu_ms(station), lambda: interrogate(client, points), rounds)
            client.socket.close()
            yield f"GI of {points} by IEC 60870-5-104", iec104
            yield f"memory of rtu-snmp with {points}", memory_of(agent)
            yield f"GI of {points}, Net-SNMP's table helper, {other_requests} requests", other
            yield "of that: ours by tables, by image", f"{ratio(tables, other)}, {ratio(image, other)}"
            asker.close()
            other_asker.close()
    finally:
        remove(folder)
        remove(other_folder)


def counted(points: int, rounds: int) -> Iterator[tuple[str, Any]]:
    """The same as code for the board, under QEMU: they are as many whatever else this machine does."""
    folder = run_directory()
    programs = emulated.Emulated(folder / "arm")
    unit = "million instructions"

    def of(name: str, ask: Callable[[], object]) -> Spread:
        return cost(lambda: programs.millions(name), ask, rounds, unit)

    try:
        programs.add_gateway()
        with ours(points, folder, free_udp_port(), programs.folder) as (gateway, port):
            asker = Asker(port)
            tables = of("rtu-snmp", lambda: asker.interrogate(TABLES))
            image = of("rtu-snmp", lambda: asker.interrogate(IMAGE))
            client = Client(gateway.address)
            station = of("rtu-iec104", lambda: interrogate(client, points))
            client.socket.close()
            asker.close()
        with theirs(points, folder, programs.add_agent()) as (_, port):
            asker = Asker(port)
            other = of("default_agent", lambda: asker.interrogate([ENTRY]))
            asker.close()
    finally:
        remove(folder)
    yield f"ARMv5: GI of {points} by tables", f"{tables}, {ratio(tables, other)} of the table helper"
    yield f"ARMv5: GI of {points} by image", f"{image}, {ratio(image, other)}"
    yield f"ARMv5: GI of {points} by IEC 60870-5-104", station
    yield f"ARMv5: GI of {points}, Net-SNMP's table helper", other


def ratio(one: Spread, other: Spread) -> str:
    return f"1/{other.middle / one.middle:.1f}"


def informs(rates: tuple[int, ...]) -> Iterator[tuple[str, Any]]:
    """Events of one second, until the sink has confirmed all."""
    folder = run_directory()
    sink_port = free_udp_port()
    try:
        with (
            tempfile.TemporaryDirectory() as received,
            receiver(sink_port, Path(received)),
            ours(station_contenders.POINTS, folder, sink_port) as (gateway, port),
        ):
            manager = Manager(port, folder)
            for rate in rates:
                (before,) = manager.get("rtuEventLast.0")
                assert isinstance(before, int)
                begun = time.monotonic()
                set_point_for(gateway.address)(rate)
                wanted = before + min(rate, EVENTS)
                gateway.wait_for(lambda wanted=wanted: confirmed(manager) >= wanted, 60, "confirmed")
                seconds = time.monotonic() - begun
                (lost,) = manager.get("rtuSinkLost.1")
                told = confirmed(manager) - before
                yield (
                    f"{rate} events in a second",
                    f"all told after {seconds:.2f} s, {told / seconds:.0f}/s, {lost} lost",
                )
    finally:
        remove(folder)


def confirmed(manager: Manager) -> int:
    (number,) = manager.get("rtuSinkConfirmed.1")
    assert isinstance(number, int)
    return number


# ------------------------------------------------------------------------------------------------


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures what managers of SNMPv3 cost.")
    parser.add_argument("--quick", action="store_true", help="a try of some ten seconds")
    quick = parser.parse_args().quick
    sizes, rounds = ([1000], QUICK_ROUNDS) if quick else (list(SIZES), ROUNDS)
    needed = (default_build() / "modules/rtu-snmp", event_source().with_name("default_agent"))
    missing = [file for file in needed if not file.exists()]
    missing += [] if quick else emulated.missing(emulated.AGENT_LIBRARY)
    if missing:
        print(
            f"not built: {', '.join(map(str, missing))}; type `make bench`, which builds it", file=sys.stderr
        )
        return 2
    what = "SNMPv3 authPriv, SHA-256 and AES-128: CPU of the agent, median (minimum..maximum)"
    head = f"{machine()}. {what} of {rounds}."
    try:
        print(f"\n{head}\n\n| of SNMPv3 | |\n|---|---|")
        for points in sizes:
            for text, value in interrogations(points, rounds):
                print(f"| {text} | {value} |", flush=True)
        for points in [] if quick else sizes:
            for text, value in counted(points, rounds):
                print(f"| {text} | {value} |", flush=True)
        for text, value in informs(RATES[:1] if quick else RATES):
            print(f"| {text} | {value} |", flush=True)
    except (BenchError, GatewayError, OSError, subprocess.SubprocessError) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
