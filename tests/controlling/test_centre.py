# SPDX-License-Identifier: GPL-3.0-or-later
"""rtu-centre between a consumer and stations: ours, lib60870's, hostile ones, a thousand simulated ones."""

import asyncio
import contextlib
import datetime
import json
import os
import re
import signal
import socket
import ssl
import struct
import subprocess
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import c104
import pytest

from lab.gateway import free_port, remove, run_directory
from openrtu_tools.centre.codes import Ask, Kind, Link, Result, State
from peers.centre_consumer import Consumer, Flag, Record
from peers.outstation import ACT, ACT_CON, INTERROGATED, NEGATIVE, Outstation, asdu
from peers.tls_gateway import STATION, Pki, gateway_with, public_keys
from rig.centre import LIMIT_S, Centre
from rig.desk import Desk

CA = 47
STARTDT_CON = bytes.fromhex("68040b000000")
PAGE = Path(__file__).resolve().parents[2] / "docs" / "centre.md"
K = 12  # of centre-rtus
POSITION = (522190650, 210108517, 0)
WITHOUT_CONFIRMATION = 15  # enum iec104_closing: STARTDT act not confirmed in t1


def station(name: str, port: int, address: str = "127.0.0.1", **keys: object) -> dict[str, object]:
    return {"name": name, "address": address, "port": port, "common_addresses": [CA], **keys}


Start = Callable[..., Centre]


@pytest.fixture
def centre(programs: Path, tmp_path: Path) -> Iterator[Start]:
    made: list[Centre] = []

    def start(stations: list[dict[str, object]], **keys: object) -> Centre:
        made.append(Centre(programs / "centre" / "rtu-centre", tmp_path, stations, **keys))
        return made[-1]

    yield start
    for one in made:
        assert one.stop() in (0, -signal.SIGKILL)


@contextlib.contextmanager
def simulated(programs: Path, count: int, kinds: str, delay_ms: int = 0) -> Iterator[int]:
    """Stations of centre-rtus; their port."""
    port = free_port()
    command = [programs / "centre" / "centre-rtus", str(count), str(port), kinds, str(delay_ms), "one"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin
        assert process.stdout
        assert process.stdout.readline() == "ready\n"
        yield port
        process.stdin.close()
        process.wait(LIMIT_S)


def address(number: int) -> str:
    return f"127.1.{number // 250}.{1 + number % 250}"


def is_value(record: Record) -> bool:
    return record.kind in (Kind.INFORMATION, Kind.POSITION)


# ---- the file -----------------------------------------------------------------------------------


def check(programs: Path, folder: Path, content: object) -> subprocess.CompletedProcess[str]:
    file = folder / "centre.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    command = [programs / "centre" / "rtu-centre", "--check", file]
    return subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)


def test_check_says_what_stations_take(programs: Path, tmp_path: Path) -> None:
    done = check(programs, tmp_path, {"stations": [station("a", 2404), station("b", 2404)]})
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("stations: 2; polls of them: 2; memory: ")
    octets = int(done.stdout.split("memory: ")[1].split()[0])
    assert octets <= 4096


@pytest.mark.parametrize(
    ("content", "code", "message"),
    [
        ("{", 2, "centre.json:1:"),
        ({}, 1, "stations: is missing"),
        ({"stations": []}, 1, "stations: is empty"),
        ({"stations": [{"name": "a"}]}, 1, "stations[0].address: is missing"),
        ({"stations": [station("a", 0)]}, 1, "stations[0].port: 0 is out of range"),
        ({"stations": [station("a", 1, "example.org")]}, 1, "stations[0].address: is not an IP address"),
        ({"stations": [station("a", 1), station("a", 2)]}, 1, 'stations[1]: has the name "a" of stations[0]'),
        ({"stations": [station("a", 1, common_addresses=[0])]}, 1, "common_addresses[0]: is no common"),
        ({"stations": [station("a", 1, position_type=5)]}, 1, "position_type: 5 is out of range"),
        (
            {"stations": [station("a", 1, second_address="here")]},
            1,
            "stations[0].second_address: is not an IP",
        ),
        ({"stations": [station("a", 1, secure=True)]}, 1, "stations[0].secure: needs the certificate"),
        (
            {"stations": [station("a", 1, certificate="a")]},
            1,
            "stations[0].certificate: is of a station with TLS",
        ),
        ({"tls": {"certificate": "/a", "ca": "/b"}, "stations": [station("a", 1)]}, 1, "tls.key: is missing"),
        (
            {"stations": [station("a", 1, reads=[{"ioa": 1, "period_ms": 10}])]},
            1,
            "reads[0].common_address: is missing",
        ),
        ({"stations": [station("a", 1)], "w": 13}, 1, "w: 13 is too much, expected at most k (12)"),
        ({"stations": [station("a", 1)], "t2": 15}, 1, "t2: 15 is too much, expected less than t1 (15)"),
        ({"stations": [station("a", 1)], "batches": 5, "batch_records": 10}, 1, "batches: 5 of 10 records"),
        ({"stations": [station("a", 1)], "shards": 2}, 1, "shards: 2 are more than the stations (1)"),
        ({"stations": [station("a", 1)], "pols_at_once": 5}, 1, 'did you mean "polls_at_once"?'),
        (
            {"stations": [{"name": "a", "address": "::1"}], "defaults": {"name": "b"}},
            1,
            "defaults.name: unknown",
        ),
    ],
)
def test_check_names_each_mistake(
    programs: Path, tmp_path: Path, content: object, code: int, message: str
) -> None:
    done = check(programs, tmp_path, content)
    assert done.returncode == code
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_example_of_the_page_is_right(programs: Path, tmp_path: Path) -> None:
    example = PAGE.read_text().split("```json\n")[1].split("```")[0]
    done = check(programs, tmp_path, example)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("stations: 2; polls of them: 6;")


def test_defaults_are_each_stations(programs: Path, tmp_path: Path) -> None:
    reads = [{"common_address": 1, "ioa": 2, "period_ms": 1000}]
    stations = [{"name": "a", "address": "::1"}, {"name": "b", "address": "::1", "reads": []}]
    done = check(programs, tmp_path, {"defaults": {"reads": reads}, "stations": stations})
    assert "polls of them: 1;" in done.stdout


# ---- stations of others -------------------------------------------------------------------------


class Plant:
    """A station of lib60870's; what it is commanded."""

    def __init__(self) -> None:
        self.port = free_port()
        self.server = c104.Server(ip="127.0.0.1", port=self.port, tick_rate_ms=100)
        self.station = self.server.add_station(common_address=CA)
        self.commands: list[tuple[int, Any]] = []
        self.clocks = 0
        self.float = self.station.add_point(io_address=2, type=c104.Type.M_ME_NC_1)
        self.float.value = 1.5
        self.server.on_clock_sync(callable=self.on_clock)

    def on_clock(self, server: c104.Server, ip: str, date_time: datetime.datetime) -> c104.ResponseState:
        self.clocks += 1
        return c104.ResponseState.SUCCESS

    def on_command(
        self, point: c104.Point, previous_info: c104.Information, message: c104.IncomingMessage
    ) -> c104.ResponseState:
        self.commands.append((point.io_address, point.value))
        return c104.ResponseState.SUCCESS

    def add(self, io_address: int, name: str, select: bool = False) -> None:
        point = self.station.add_point(io_address=io_address, type=getattr(c104.Type, name))
        if select:
            point.command_mode = c104.CommandMode.SELECT_AND_EXECUTE
        point.on_receive(callable=self.on_command)


@pytest.fixture
def plant() -> Iterator[Plant]:
    made = Plant()
    yield made
    made.server.stop()


def test_lib60870s_server(plant: Plant, centre: Start) -> None:
    plant.add(30, "C_SC_NA_1", select=True)
    plant.server.start()
    reads = [{"common_address": CA, "ioa": 2, "period_ms": 50}]
    running = centre([station("c104", plant.port, reads=reads, clock_s=3600, terminates=False)])
    consumer = running.consumer()
    assert consumer.until_link(0, Link.CONNECTING).connection == 1
    assert consumer.stations == {0: "c104"}
    consumer.until_link(0, Link.UP)
    interrogated = consumer.until(lambda record: is_value(record) and record.cause == 20)
    assert (interrogated.type, interrogated.ca, interrogated.ioa) == (13, CA, 2)
    assert struct.unpack("<f", interrogated.rest[:4]) == (1.5,)
    assert consumer.until(lambda record: is_value(record) and record.cause == 5).ioa == 2
    assert plant.clocks == 1
    consumer.send(Ask.COMMAND, id=7, ca=CA, ioa=30, value=1, flags=1)
    consumer.until_progress(7, State.SELECTION_REQUEST)
    consumer.until_progress(7, State.ACCEPTED_SELECTION)
    consumer.send(Ask.EXECUTE, id=7)
    consumer.until_progress(7, State.EXECUTION_REQUEST)
    assert consumer.until_progress(7, State.EXECUTED_COMMAND).progress[1] == Result.DONE
    assert plant.commands == [(30, True)]


def test_our_own_station(desk: Desk, centre: Start) -> None:
    ca, port = desk.ca("3.35"), desk.gateway.address[1]
    running = centre([station("gateway", port, common_addresses=[ca])])
    consumer = running.consumer()
    seen: list[Record] = []
    for record in consumer.records():
        seen.append(record)
        if record.kind == Kind.PROGRESS and record.type == 100:
            break
    assert seen[-1].progress[:2] == (State.EXECUTED_COMMAND, Result.DONE)
    assert [record for record in seen if is_value(record) and record.cause == 20 and record.ca == ca]
    consumer.send(Ask.READ, id=9, ca=ca, ioa=999_999)
    state, result, _ = consumer.until_progress(9, State.REFUSED_COMMAND).progress
    assert (state, result) == (State.REFUSED_COMMAND, Result.EXCEPTION)
    consumer.send(Ask.TEST_COMMAND, id=10, ca=ca, value=0xAA55)
    assert consumer.until_progress(10, State.EXECUTED_COMMAND).progress[1] == Result.DONE
    consumer.send(Ask.RESET, id=11, ca=ca, qualifier=99)  # there is none
    assert consumer.until_progress(11, State.REFUSED_COMMAND).progress[1] == Result.EXCEPTION


def test_reset_and_test_as_the_station_gets_them(centre: Start) -> None:
    with Outstation() as below:
        consumer = centre([station("a", below.port, interrogate_at_start=False)]).consumer()
        consumer.until_link(0, Link.UP)
        consumer.send(Ask.RESET, id=1, ca=CA, qualifier=1)
        consumer.send(Ask.TEST_COMMAND, id=2, ca=CA, value=0xAA55)
        for number in (1, 2):
            assert consumer.until_progress(number, State.EXECUTED_COMMAND).progress[1] == Result.DONE
        reset, test = below.asked
    assert (reset.type, reset.cause, reset.ca, reset.ioa, reset.element) == (105, ACT, CA, 0, b"\1")
    assert (test.type, test.cause, test.ca, test.ioa) == (107, ACT, CA, 0)
    assert (test.element[:2], len(test.element)) == (b"\x55\xaa", 9)


@pytest.mark.slow
def test_interrogation_that_is_refused_is_repeated(centre: Start) -> None:
    with Outstation() as below:
        below.answer = lambda asked, octets: [octets[:2] + bytes((NEGATIVE | ACT_CON,)) + octets[3:]]
        below.interrogated = [asdu(1, INTERROGATED, CA, (1, b"\x01"))]
        consumer = centre([station("a", below.port)]).consumer()
        consumer.until_progress(0, State.REFUSED_COMMAND)
        below.answer = below.usual
        told = consumer.until(is_value)
    assert (told.ca, told.ioa, told.cause) == (CA, 1, INTERROGATED)


# ---- commands -----------------------------------------------------------------------------------


def test_commands_that_are_not_sent(programs: Path, centre: Start) -> None:
    with simulated(programs, 2, "hd") as port:
        running = centre([station(str(i), port, address(i)) for i in range(2)])
        consumer = running.consumer()
        consumer.until_link(0, Link.UP)
        refused = [
            (Result.NOT_UP, {"station": 1, "value": 1}),
            (Result.NOT_KNOWN, {"station": 2, "value": 1}),
            (Result.OUT_OF_RANGE, {"value": 2}),
            (Result.BUSY, {"value": 1, "ca": 0}),
        ]
        for number, (result, keys) in enumerate(refused, 1):
            consumer.send(Ask.COMMAND, id=number, ioa=5, **keys)  # type: ignore[arg-type]
            assert consumer.until_progress(number).progress[:2] == (State.REFUSED_COMMAND, result)
        consumer.send(Ask.EXECUTE, id=99)
        assert consumer.until_progress(99).progress[:2] == (State.REFUSED_COMMAND, Result.NOT_KNOWN)
        consumer.send(Ask.COMMAND, id=50, ioa=5, value=1, flags=1)
        consumer.until_progress(50, State.ACCEPTED_SELECTION)
        consumer.send(Ask.COMMAND, id=50, ioa=6, value=1)
        assert consumer.until_progress(50).progress[1] == Result.INTERLOCK
        consumer.send(Ask.CANCEL, id=50)
        consumer.until_progress(50, State.INTERRUPTED_SELECTION)


def test_every_kind_of_request(programs: Path, centre: Start) -> None:
    with simulated(programs, 1, "h") as port:
        consumer = centre([station("a", port, address(0))]).consumer()
        consumer.until_link(0, Link.UP)
        asked = {
            Ask.INTERROGATE: {"qualifier": 21},
            Ask.COUNTERS: {"qualifier": 5},
            Ask.READ: {"ioa": 77},
            Ask.SET_CLOCK: {},
        }
        for number, (kind, keys) in enumerate(asked.items(), 1):
            consumer.send(kind, id=number, **keys)  # type: ignore[arg-type]
            state, result, _ = consumer.until_progress(
                number, State.EXECUTED_COMMAND, State.REFUSED_COMMAND
            ).progress
            assert (state, result) == (State.EXECUTED_COMMAND, Result.DONE), kind


def test_fate_of_a_command_is_unknown_when_the_connection_ends(centre: Start) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(LIMIT_S)
        keys = {"interrogate_at_start": False}
        consumer = centre([station("a", server.getsockname()[1], **keys)]).consumer()
        with server.accept()[0] as connection:
            connection.sendall(STARTDT_CON)
            consumer.until_link(0, Link.UP)
            consumer.send(Ask.COMMAND, id=3, ca=CA, ioa=5, value=1)
            consumer.until_progress(3, State.EXECUTION_REQUEST)
        ended = consumer.until_progress(3, State.REFUSED_COMMAND)
        assert ended.progress[1] == Result.UNKNOWN_FATE
        # The next connection is not sent what the last one did not get.
        with server.accept()[0] as connection:
            connection.settimeout(LIMIT_S)
            assert connection.recv(6) == bytes.fromhex("680407000000")
            connection.sendall(STARTDT_CON)
            consumer.until_link(0, Link.UP)
            consumer.send(Ask.COMMAND, id=4, ca=CA, ioa=6, value=0)
            frame = connection.recv(100)
            assert frame[:6] + frame[12:15] == bytes.fromhex("680e00000000060000")


# ---- TLS ----------------------------------------------------------------------------------------

NOT_SECURE = 11  # enum iec104_closing


@pytest.fixture(scope="module")
def pki() -> Iterator[Pki]:
    folder = run_directory()  # the station's user may enter it
    yield public_keys(folder)
    remove(folder)


def secured(pki: Pki, **keys: Any) -> dict[str, Any]:
    """The object "tls" of the centre."""
    files = {"certificate": pki.centre.certificate, "key": pki.centre.key, "ca": pki.ours.certificate}
    return {"tls": {name: str(path) for name, path in files.items()} | keys}


@pytest.mark.slow
@pytest.mark.parametrize("version", ["1.2", "1.3"])
def test_our_own_station_on_tls(programs: Path, centre: Start, pki: Pki, version: str) -> None:
    """5 000 points; beside it a station without TLS; when the connection ends, the next one is resumed."""
    with gateway_with(pki, programs, masters=["centre 1"]) as gateway, simulated(programs, 1, "h") as port:
        secure = station(
            "secure", gateway.address[1], secure=True, certificate="substation 7", common_addresses=[STATION]
        )
        reads = [{"common_address": CA, "ioa": 1, "period_ms": 20}]
        stations = [secure, station("plain", port, address(0), reads=reads)]
        consumer = centre(stations, **secured(pki, versions=[version])).consumer()
        seen: list[int] = []
        for record in consumer.records():
            if record.station == 0 and is_value(record) and record.cause == 20:
                seen.append(record.ioa)
            if record.station == 0 and record.kind == Kind.PROGRESS:
                break
        assert seen == list(range(30001, 35001))
        consumer.until(lambda record: record.kind == Kind.POSITION and record.station == 1)
        gateway.wait_log(rf"TLSv{version}, \"centre 1\"")
        gateway.kill("rtu-iec104")  # its sessions go with it
        consumer.until_link(0, Link.DOWN)
        consumer.until_link(0, Link.UP)


@pytest.mark.slow
@pytest.mark.parametrize("version", ["1.2", "1.3"])
def test_session_is_resumed(programs: Path, centre: Start, pki: Pki, version: str) -> None:
    """The consumer goes, and with it all connections; the next one finds the sessions there."""
    with gateway_with(pki, programs) as gateway:
        secure = station("secure", gateway.address[1], secure=True, common_addresses=[STATION])
        running = centre([secure], **secured(pki, versions=[version]))
        consumer = running.consumer()
        consumer.until(lambda record: is_value(record) and record.cause == 20)
        consumer.close()
        running.wait_logged("consumer")
        consumer = running.consumer()
        consumer.until(lambda record: is_value(record) and record.cause == 20)
        gateway.wait_log(rf"TLSv{version} resumed, \"centre 1\"")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "keys", "message"),
    [
        ({}, {"certificate": "substation 8"}, "not the certificate of this station"),
        ({"ca": "theirs"}, {}, "certificate is not from a known CA"),
        ({"crl": "crl"}, {}, "certificate revoked"),
    ],
)
def test_station_that_is_another_is_refused(
    programs: Path, centre: Start, pki: Pki, change: dict[str, str], keys: dict[str, str], message: str
) -> None:
    known = {"theirs": pki.ours.folder.parent / "theirs/ca.pem"}
    if "crl" in change:
        known["crl"] = pki.ours.revoke(pki.station)
    with gateway_with(pki, programs) as gateway:
        secure = station("secure", gateway.address[1], secure=True, common_addresses=[STATION], **keys)
        running = centre([secure], **secured(pki, **{key: str(known[name]) for key, name in change.items()}))
        consumer = running.consumer()
        assert consumer.until_link(0, Link.DOWN).link[1] == NOT_SECURE
        assert message in running.wait_logged("secure: refused")


def test_station_without_tls_is_refused_and_reaches_no_other(programs: Path, centre: Start, pki: Pki) -> None:
    with simulated(programs, 2, "hh") as port:
        reads = [{"common_address": CA, "ioa": 1, "period_ms": 20}]
        stations = [
            station("secure", port, address(0), secure=True, reads=reads),
            station("plain", port, address(1), reads=reads),
        ]
        consumer = centre(stations, connect_ms=300, **secured(pki)).consumer()
        consumer.until_link(0, Link.DOWN)
        consumer.until(lambda record: record.kind == Kind.POSITION and record.station == 1)


@pytest.mark.slow
def test_centre_that_the_station_does_not_know(programs: Path, centre: Start, pki: Pki) -> None:
    stranger = {"certificate": str(pki.stranger.certificate), "key": str(pki.stranger.key)}
    with gateway_with(pki, programs) as gateway:
        secure = station("secure", gateway.address[1], secure=True, common_addresses=[STATION])
        consumer = centre([secure], **secured(pki, **stranger)).consumer()
        consumer.until_link(0, Link.DOWN)
        gateway.wait_log("refused, certificate is not from a known CA")


def test_lib60870s_server_on_tls(centre: Start, pki: Pki) -> None:
    security = c104.TransportSecurity(validate=True, only_known=False)
    security.set_certificate(cert=str(pki.station.certificate), key=str(pki.station.key))
    security.set_ca_certificate(cert=str(pki.ours.certificate))
    server = c104.Server(ip="127.0.0.1", port=free_port(), tick_rate_ms=100, transport_security=security)
    point = server.add_station(common_address=CA).add_point(io_address=2, type=c104.Type.M_ME_NC_1)
    point.value = 1.5
    server.start()
    try:
        secure = station("c104", server.port, secure=True, certificate=pki.station.fingerprint)
        consumer = centre([secure], **secured(pki)).consumer()
        seen = consumer.until(lambda record: is_value(record) and record.cause == 20)
        assert (seen.ioa, struct.unpack("<f", seen.rest[:4])) == (2, (1.5,))
    finally:
        server.stop()


async def confirm(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """STARTDT, and nothing more."""
    with contextlib.suppress(OSError, asyncio.IncompleteReadError):
        await reader.readexactly(6)
        writer.write(STARTDT_CON)
        await reader.read()
    writer.close()


@contextlib.contextmanager
def confirming(pki: Pki) -> Iterator[int]:
    """A server of Python's ssl for any number of connections; its port."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(pki.station.certificate, pki.station.key)
    context.load_verify_locations(pki.ours.certificate)
    context.verify_mode = ssl.CERT_REQUIRED
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    serving = asyncio.start_server(confirm, "127.0.0.1", 0, ssl=context)
    server = asyncio.run_coroutine_threadsafe(serving, loop).result(LIMIT_S)
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()


@pytest.mark.slow
@pytest.mark.parametrize("version", ["1.2", "1.3"])
def test_memory_of_a_connection_with_tls(centre: Start, pki: Pki, version: str) -> None:
    """docs/centre.md says it: what a hundred more take, of the pages of the process alone."""
    taken = {}
    with confirming(pki) as port:
        for count in (20, 120):
            stations = [station(f"s{number}", port, secure=True) for number in range(count)]
            defaults = {"interrogate_at_start": False}
            running = centre(stations, defaults=defaults, **secured(pki, versions=[version]))
            consumer = running.consumer()
            up: set[int] = set()
            while len(up) < count:
                record = consumer.until(lambda each: each.kind == Kind.LINK and each.link[0] == Link.UP)
                up.add(record.station)
            rollup = Path(f"/proc/{running.process.pid}/smaps_rollup").read_text()
            taken[count] = int(re.search(r"^Private_Dirty: +(\d+) kB", rollup, re.MULTILINE)[1])  # type: ignore[index]
            consumer.close()
            running.process.kill()
    each = (taken[120] - taken[20]) / 100
    print(f"TLS {version}: {each:.0f} KiB a connection")
    assert 5 < each < 60


def test_files_of_tls_that_are_not_there(programs: Path, tmp_path: Path, pki: Pki) -> None:
    file = tmp_path / "centre.json"
    wanted = {"stations": [station("a", 1, secure=True)], **secured(pki, key="/not/there.key")}
    file.write_text(json.dumps(wanted))
    command = [programs / "centre" / "rtu-centre", "--socket", tmp_path / "consumer", file]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 1
    assert "the key /not/there.key: No such file or directory" in done.stderr


# ---- redundant links ----------------------------------------------------------------------------


@pytest.fixture
def pair() -> Iterator[tuple[Outstation, Outstation]]:
    """One station at two addresses."""
    with Outstation() as first, Outstation(first.port, "127.0.0.2") as second:
        for one in (first, second):
            one.interrogated = [asdu(1, INTERROGATED, CA, (1, b"\x01"))]
        yield first, second


def redundant(port: int) -> dict[str, object]:
    return station("pair", port, second_address="127.0.0.2")


def test_one_link_is_started_and_the_other_takes_over(
    centre: Start, pair: tuple[Outstation, Outstation]
) -> None:
    consumer = centre([redundant(pair[0].port)]).consumer()
    standby = consumer.until_link(0, Link.STANDBY)
    active, other = (pair[0], pair[1]) if standby.detail == 1 else (pair[1], pair[0])
    active.wait(lambda: any(asked.type == 100 for asked in active.asked), "it is interrogated")
    assert (active.started, other.started) == (1, 0)
    consumer.send(Ask.COMMAND, id=5, ca=CA, ioa=9, value=1)
    consumer.until_progress(5, State.EXECUTED_COMMAND)
    active.answer = lambda asked, octets: []
    consumer.send(Ask.COMMAND, id=6, ca=CA, ioa=9, value=1)
    active.wait(lambda: len(active.executions()) == 2, "it is commanded")
    active.die()
    assert consumer.until_progress(6, State.REFUSED_COMMAND).progress[1] == Result.UNKNOWN_FATE
    up = consumer.until_link(0, Link.UP)
    assert (up.connection, up.detail) == (standby.connection, standby.detail)
    told = consumer.until(lambda record: is_value(record) and record.cause == 20)
    assert told.connection == up.connection
    consumer.send(Ask.COMMAND, id=7, ca=CA, ioa=9, value=1)
    consumer.until_progress(7, State.EXECUTED_COMMAND)
    assert [asked.cause for asked in other.executions()] == [ACT]  # the lost one was not sent again
    active.listen()
    assert consumer.until_link(0, Link.STANDBY).detail != up.detail


@pytest.mark.slow
def test_link_that_hangs_is_left_by_test_and_time_out(
    centre: Start, pair: tuple[Outstation, Outstation]
) -> None:
    consumer = centre([redundant(pair[0].port)], t1=2, t2=1, t3=1).consumer()
    standby = consumer.until_link(0, Link.STANDBY)
    active, other = (pair[0], pair[1]) if standby.detail == 1 else (pair[1], pair[0])
    active.deaf = True
    other.wait(lambda: other.started == 1, "it takes over")
    assert consumer.until_link(0, Link.UP).detail in (0, 1)


# ---- hostile and dead stations ------------------------------------------------------------------

GARBAGE = b"GET / HTTP/1.1\r\n\r\n"
HOSTILE = {
    "garbage": (GARBAGE, 1),
    "data before STARTDT con": (bytes.fromhex("680e0000000001010300010001000001"), 5),
    "STARTDT act": (bytes.fromhex("680407000000"), 16),
    "a frame is missing": (STARTDT_CON + bytes.fromhex("680e0200000001010300010001000001"), 3),
    "acknowledges what was never sent": (STARTDT_CON + bytes.fromhex("68040100fe00"), 4),
    "an ASDU that is too short": (STARTDT_CON + bytes.fromhex("680a00000000010203000100"), 2),
    "half a frame": (STARTDT_CON + b"\x68\x0e\x00", 13),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_station(programs: Path, centre: Start, name: str) -> None:
    octets, reason = HOSTILE[name]
    with simulated(programs, 1, "h") as port, socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(LIMIT_S)
        reads = [{"common_address": CA, "ioa": 1, "period_ms": 20}]
        hostile = station("hostile", server.getsockname()[1], interrogate_at_start=False)
        running = centre([hostile, station("good", port, address(0), reads=reads)])
        consumer = running.consumer()
        with server.accept()[0] as connection:
            connection.sendall(octets)
            connection.shutdown(socket.SHUT_WR)
            down = consumer.until_link(0, Link.DOWN)
        assert down.link[1] == reason
        consumer.until(lambda record: record.kind == Kind.POSITION and record.station == 1)


@pytest.mark.slow
def test_slow_loris(programs: Path, centre: Start) -> None:
    """Octet by octet, for ever: it holds nobody up, and t1 ends it."""
    stop = threading.Event()

    def drip(server: socket.socket) -> None:
        with server.accept()[0] as connection, contextlib.suppress(OSError):
            for octet in STARTDT_CON[:-1]:
                connection.sendall(bytes([octet]))
                stop.wait(0.2)
            stop.wait(LIMIT_S)

    with simulated(programs, 1, "h") as port, socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(LIMIT_S)
        thread = threading.Thread(target=drip, args=(server,), daemon=True)
        thread.start()
        reads = [{"common_address": CA, "ioa": 1, "period_ms": 20}]
        slow, good = station("slow", server.getsockname()[1]), station("good", port, address(0), reads=reads)
        consumer = centre([slow, good], t1=2, t2=1, retry_ms=60000, retry_max_ms=60000).consumer()
        down = consumer.until_link(0, Link.DOWN)
        assert down.link[1] == WITHOUT_CONFIRMATION
        assert consumer.counts[1, Kind.POSITION] > 1
        stop.set()
        thread.join(LIMIT_S)


@pytest.mark.slow
def test_dead_station_is_tried_less_and_less_often(centre: Start) -> None:
    consumer = centre([station("dead", free_port())], retry_ms=10, retry_max_ms=100).consumer()
    pauses = [consumer.until_link(0, Link.DOWN).link for _ in range(6)]
    assert [retry for *_, retry in pauses] == [10, 20, 40, 80, 100, 100]
    assert {(reason, os.strerror(error)) for _, reason, error, _ in pauses} == {(0, "Connection refused")}


@pytest.mark.slow
def test_the_slowness_of_some_does_not_reach_the_others(programs: Path, centre: Start) -> None:
    """1 000 stations, of which 100 are dead, 50 mute and 50 slow, by windows that hold fewer than these."""
    count, kinds, polls = 1000, "hhhhhhhhdshhhhhhhhdm", 5
    with simulated(programs, count, kinds, delay_ms=5000) as port:
        reads = [{"common_address": CA, "ioa": 1, "period_ms": 500}]
        stations = [station(str(i), port, address(i), interrogate_at_start=False) for i in range(count)]
        running = centre(
            stations, defaults={"reads": reads}, connections_at_once=20, polls_at_once=20, slow_ms=100
        )
        consumer = running.consumer()
        healthy = [i for i in range(count) if kinds[i % len(kinds)] == "h"]
        waiting = set(healthy)
        while waiting:
            for record in consumer.packet():
                if consumer.counts[record.station, Kind.POSITION] >= polls:
                    waiting.discard(record.station)
        counts = Counter({i: consumer.counts[i, Kind.POSITION] for i in range(count)})
        slow = [i for i in range(count) if kinds[i % len(kinds)] == "s"]
        assert max(counts[i] for i in slow) < polls  # the healthy ones did not wait for them
        assert all(counts[i] == 0 for i in range(count) if kinds[i % len(kinds)] in "dm")


# ---- the consumer -------------------------------------------------------------------------------


def numbers(record: Record) -> list[int]:
    return [record.unsigned] if record.kind == Kind.INFORMATION and record.type == 15 else []


def test_consumer_that_does_not_acknowledge_stops_the_stations(programs: Path, centre: Start) -> None:
    """A station has k frames under way; it sends the next ones when the consumer has taken these."""
    with simulated(programs, 1, "x") as port:
        running = centre([station("x", port, address(0), interrogate_at_start=False)])
        consumer = running.consumer(acknowledges=False)
        seen: list[int] = []
        for record in consumer.records():
            seen += numbers(record)
            if len(seen) == K:
                break
        consumer.send(Ask.READ, id=5, ioa=1)
        late = consumer.until_progress(5)
        assert late.progress[0] == State.EXECUTION_REQUEST
        assert consumer.counts[0, Kind.INFORMATION] == K
        consumer.acknowledges = True
        consumer.acknowledge()
        for record in consumer.records():
            seen += numbers(record)
            if len(seen) >= 2000:
                break
        assert seen == list(range(len(seen)))


@pytest.mark.slow
def test_consumer_that_is_slower_than_the_stations(programs: Path, centre: Start) -> None:
    """They have more to say than there is room for: reading stops and goes on, and nothing is lost."""
    count, events = 400, 60
    with simulated(programs, count, "x") as port:
        stations = [station(str(i), port, address(i), interrogate_at_start=False) for i in range(count)]
        consumer = centre(stations, batches=60, batch_records=64, batches_in_flight=2).consumer()
        seen: list[list[int]] = [[] for _ in range(count)]
        while min(map(len, seen)) < events:
            for record in consumer.packet():
                seen[record.station] += numbers(record)
        assert all(had == list(range(len(had))) for had in seen)


def test_events_outlive_consumers_and_the_process(programs: Path, centre: Start) -> None:
    """Consumers and the process are killed; what a consumer has not acknowledged is sent again."""
    with simulated(programs, 3, "x") as port:
        stations = [station(str(i), port, address(i), interrogate_at_start=False) for i in range(3)]
        had: dict[int, set[int]] = {i: set() for i in range(3)}
        running = centre(stations)
        for turn in range(8):
            consumer = running.consumer(acknowledges=False)
            for _ in range(30):
                records = consumer.packet()
                for record in records:
                    had[record.station].update(numbers(record))
                consumer.acknowledge()
            if turn % 4 == 3:
                running.process.kill()
                running.process.wait()
                consumer.close()
                running = centre(stations)
            else:
                consumer.close()
                assert "which their stations keep" in running.wait_logged("consumer gone")
        for station_numbers in had.values():
            assert len(station_numbers) > 100
            assert station_numbers == set(range(max(station_numbers) + 1))


def test_every_asdu_ends_with_one_record(programs: Path, centre: Start) -> None:
    with simulated(programs, 1, "h") as port:
        consumer = centre([station("a", port, address(0))]).consumer()
        seen = [consumer.until(lambda record: Flag.LAST in record.flags) for _ in range(3)]
        assert [(record.kind, record.type) for record in seen] == [
            (Kind.OTHER, 100),
            (Kind.INFORMATION, 1),
            (Kind.PROGRESS, 100),
        ]


@pytest.mark.parametrize(
    "packet",
    [b"x", bytes(32), bytes([9]) + bytes(31), bytes(4096), struct.pack("<BBHIQ16x", 1, 0, 0, 0, 1000)],
    ids=["one octet", "zeros", "no such kind", "too long", "acknowledges what was not sent"],
)
def test_consumer_that_speaks_another_protocol(centre: Start, packet: bytes) -> None:
    running = centre([station("dead", free_port())])
    consumer = running.consumer()
    consumer.socket.send(packet)
    running.wait_logged("consumer gone, it sent what is no request")
    with pytest.raises((EOFError, ConnectionError)):
        while True:
            consumer.packet()
    running.consumer().until_link(0, Link.DOWN)


def test_consumer_that_only_asks(centre: Start) -> None:
    """It acknowledges nothing: its answers have an end, and so has it."""
    running = centre([station("dead", free_port())], batches=60, batch_records=64, batches_in_flight=2)
    consumer = running.consumer(acknowledges=False)
    with pytest.raises(OSError):
        for number in range(1, 100_000):
            consumer.send(Ask.READ, id=number, ioa=1)
    running.wait_logged("consumer gone")


def test_second_consumer_is_turned_away(centre: Start) -> None:
    running = centre([station("dead", free_port())])
    first = running.consumer()
    second = Consumer(running.socket)
    running.wait_logged("a second consumer was turned away")
    with pytest.raises((EOFError, ConnectionError)):
        second.packet()
    first.until_link(0, Link.DOWN)


def test_no_consumer_no_connection(centre: Start) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(LIMIT_S)
        running = centre([station("a", server.getsockname()[1])])
        consumer = running.consumer()
        with server.accept()[0] as connection:
            connection.sendall(STARTDT_CON)
            consumer.until_link(0, Link.UP)
            consumer.close()
            connection.settimeout(LIMIT_S)
            while connection.recv(4096):
                pass


def test_socket_left_over_is_taken_and_a_live_one_is_not(
    programs: Path, centre: Start, tmp_path: Path
) -> None:
    stations = [station("dead", free_port())]
    dead = centre(stations).process
    dead.kill()
    dead.wait(LIMIT_S)
    running = centre(stations)
    command = [programs / "centre" / "rtu-centre", "--socket", running.socket, tmp_path / "centre.json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 1
    assert "cannot be bound: Address already in use" in done.stderr
    assert running.stop() == 0
    assert not running.socket.exists()


# ---- shards -------------------------------------------------------------------------------------

SHARDS = 3


@contextlib.contextmanager
def sharded(programs: Path, centre: Start) -> Iterator[tuple[Centre, list[Consumer]]]:
    """Two stations of each shard, and a consumer that has their first positions."""
    reads = [{"common_address": CA, "ioa": 1, "period_ms": 20}]
    with simulated(programs, 2 * SHARDS, "h") as port:
        stations = [station(str(i), port, address(i), reads=reads) for i in range(2 * SHARDS)]
        running = centre(stations, shards=SHARDS)
        consumers = [Consumer(socket_of(running, shard)) for shard in range(SHARDS)]
        for shard, consumer in enumerate(consumers):
            all_polled(consumer, shard)
        yield running, consumers
        for consumer in consumers:
            consumer.close()


def socket_of(running: Centre, shard: int) -> Path:
    return running.socket.with_name(f"{running.socket.name}.{shard}")


def all_polled(consumer: Consumer, shard: int, more: int = 1) -> None:
    """So many more positions of each of its stations, and nothing of another."""
    places = {shard, shard + SHARDS}
    wanted = {place: consumer.counts[place, Kind.POSITION] + more for place in places}
    while any(consumer.counts[place, Kind.POSITION] < count for place, count in wanted.items()):
        assert {record.station for record in consumer.packet()} <= places
    assert consumer.stations == {place: str(place) for place in places}


def shards_of(running: Centre) -> list[int]:
    """Their processes, as they were started."""
    pid = running.process.pid
    return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@pytest.mark.slow
def test_killed_shard_takes_no_other_with_it(programs: Path, centre: Start) -> None:
    with sharded(programs, centre) as (running, consumers):
        os.kill(shards_of(running)[1], signal.SIGKILL)
        running.wait_logged("shard 1 was ended by signal 9")
        with pytest.raises((EOFError, ConnectionError)):
            while True:
                consumers[1].packet()
        for shard in (0, 2):
            all_polled(consumers[shard], shard, more=5)
            assert max(record.connection for record in consumers[shard].packet()) == 1
        consumers[1].close()
        consumers[1] = Consumer(socket_of(running, 1))  # its socket was there all the time
        all_polled(consumers[1], 1)
        assert running.stop() == 0
        assert not any(socket_of(running, shard).exists() for shard in range(SHARDS))


@pytest.mark.slow
def test_hung_shard_is_killed_and_begins_again(programs: Path, centre: Start) -> None:
    with sharded(programs, centre) as (running, consumers):
        os.kill(shards_of(running)[1], signal.SIGSTOP)
        running.wait_logged("shard 1 has made no turn for 10 s and is killed")
        running.wait_logged("shard 1 was ended by signal 9")
        all_polled(consumers[0], 0)
        consumers[1].close()
        consumers[1] = Consumer(socket_of(running, 1))
        all_polled(consumers[1], 1)


@pytest.mark.slow
def test_hung_shard_does_not_hold_up_the_end(programs: Path, centre: Start) -> None:
    with sharded(programs, centre) as (running, _):
        os.kill(shards_of(running)[2], signal.SIGSTOP)
        assert running.stop() == 0


def test_shard_takes_requests_of_its_stations_only(programs: Path, centre: Start) -> None:
    with sharded(programs, centre) as (_, consumers):
        for place, result in (
            (1, Result.DONE),
            (4, Result.DONE),
            (0, Result.NOT_KNOWN),
            (7, Result.NOT_KNOWN),
        ):
            consumers[1].send(Ask.INTERROGATE, place, id=100 + place, ca=CA, qualifier=20)
            ends = State.EXECUTED_COMMAND, State.REFUSED_COMMAND
            assert consumers[1].until_progress(100 + place, *ends).progress[1] == result


@pytest.mark.slow
def test_shards_end_with_the_process_that_keeps_them(programs: Path, centre: Start) -> None:
    with sharded(programs, centre) as (running, consumers):
        running.process.kill()
        for consumer in consumers:
            with pytest.raises((EOFError, ConnectionError)):
                while True:
                    consumer.packet()
