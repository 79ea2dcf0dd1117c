# SPDX-License-Identifier: GPL-3.0-or-later
"""Modbus TCP connections that go wrong, as the whole gateway sees them; no other line notices.

What servers of other makes say when all goes well is in test_modbus_peers.py.
"""

import contextlib
import dataclasses
import errno
import json
import re
import select
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import c104
import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.master import Master
from peers.device import BAUD_RATE, FIRST_ADDRESS, UNIT
from peers.line import line
from peers.pymodbus_device import PymodbusDevice
from rig.capture import recorded
from rig.desk import patience

READ_HOLDING, WRITE_REGISTER, ENCAPSULATED = 3, 6, 43
NO_TARGET = 11
NEIGHBOUR = f"p1.{UNIT}.*"
NOTICE_S = 15.0
RECONNECT_S = 25.0  # of a host that does not answer: 3 s of trying, some of waiting, and a loaded host
FRESH_S = (
    4.0  # on a loaded host; a call that blocks would hold up a neighbour for minutes, or rtud end the module
)
ASKED_AGAIN_MS = 10  # a connection asks a device no sooner
LATE = 8  # answers are late; each costs a time-out


@dataclass(frozen=True)
class Request:
    transaction: int
    unit: int
    function: int
    address: int
    value: int  # a read's count

    def frame(self, pdu: bytes) -> bytes:
        """An answer to it."""
        return struct.pack(">HHHB", self.transaction, 0, 1 + len(pdu), self.unit) + pdu

    def answer(self) -> bytes:
        """Holding register n has n + 1; a write is confirmed and forgotten. Nobody says what it is."""
        if self.function == ENCAPSULATED:
            return self.exception(1)
        if self.function != READ_HOLDING:
            return self.frame(struct.pack(">BHH", self.function, self.address, self.value))
        values = range(self.address + 1, self.address + 1 + self.value)
        return self.frame(struct.pack(f">BB{self.value}H", self.function, 2 * self.value, *values))

    def exception(self, code: int) -> bytes:
        return self.frame(bytes([self.function | 0x80, code]))


def request_of(frame: bytes) -> Request:
    transaction, _, _, unit, function, address = struct.unpack(">HHHBBH", frame[:10])
    return Request(transaction, unit, function, address, int.from_bytes(frame[10:12]))


class Server:
    """A Modbus TCP server in the test's hands, for one connection: `respond` says what a request gets."""

    def __init__(self, address: str = "127.0.0.1") -> None:
        self.address = address
        with socket.create_server((address, 0), family=self._family()) as probe:
            self.port: int = probe.getsockname()[1]
        self.respond: Callable[[Request], bytes] = Request.answer
        self.connections = 0
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def _family(self) -> socket.AddressFamily:
        return socket.AF_INET6 if ":" in self.address else socket.AF_INET

    def __enter__(self) -> "Server":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def listen(self, backlog: int = 1) -> socket.socket:
        return socket.create_server((self.address, self.port), family=self._family(), backlog=backlog)

    def start(self, listener: socket.socket | None = None) -> None:
        self._stop.clear()
        self._thread = threading.Thread(target=self._serve, args=(listener or self.listen(),))
        self._thread.start()

    def stop(self) -> None:
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        self._thread = None

    def _serve(self, listener: socket.socket) -> None:
        with listener:
            while not self._stop.is_set():
                if select.select([listener], [], [], 0.02)[0]:
                    connection, _ = listener.accept()
                    self.connections += 1
                    with connection, contextlib.suppress(OSError):
                        self._talk(connection)

    def _talk(self, connection: socket.socket) -> None:
        """Until the peer hangs up, or `respond` raises OSError to do so itself."""
        came = b""
        while not self._stop.is_set():
            while len(came) >= 6 and len(came) >= (whole := 6 + int.from_bytes(came[4:6])):
                frame, came = came[:whole], came[whole:]
                connection.sendall(self.respond(request_of(frame)))
            if select.select([connection], [], [], 0.02)[0]:
                chunk = connection.recv(4096)
                if not chunk:
                    return
                came += chunk


def tcp_port(value: int, server: Server, slaves: list[dict[str, Any]]) -> dict[str, Any]:
    host = {"host": server.address, "tcp_port": server.port}
    return {"value": value, "active": 1, **host, "slaves": slaves}


def slave(unit: int, *addresses: int, timeout_ms: int = 1000) -> dict[str, Any]:
    registers = [{"address": address} for address in addresses]
    return {"id": unit, "response_timeout_ms": timeout_ms, "holding_registers": registers}


@contextlib.contextmanager
def gateway_of(programs: Path, *ports: dict[str, Any]) -> Iterator[Gateway]:
    """With a serial line beside the connections, port 1, all in one process."""
    directory = run_directory()
    (directory / "dev").mkdir()
    serial = {"value": 1, "active": 1, "baud_rate": BAUD_RATE, "data_bits": 8, "stop_bits": 1, "parity": 0}
    neighbours = [slave(UNIT, FIRST_ADDRESS) | patience(2000)]
    config = {"port": [{**serial, "slaves": neighbours}, *ports]}
    config = listening_on(config, free_port())
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        stack.enter_context(line(directory / "dev" / "ttyS1", directory / "neighbour"))
        neighbour = PymodbusDevice(directory / "neighbour")
        neighbour.start()
        stack.callback(neighbour.stop)
        gateway = stack.enter_context(Gateway(config, directory, programs))
        stack.enter_context(recorded(gateway))
        wait_good(gateway, NEIGHBOUR)
        yield gateway


def all_are(gateway: Gateway, pattern: str, quality: str) -> bool:
    points = gateway.points(pattern)
    return bool(points) and {point["quality"] for point in points.values()} == {quality}


def wait_good(gateway: Gateway, pattern: str, timeout_s: float = NOTICE_S) -> None:
    gateway.wait_for(lambda: all_are(gateway, pattern, "good"), timeout_s, f"{pattern} is good")


def wait_invalid(gateway: Gateway, pattern: str, timeout_s: float = NOTICE_S) -> None:
    gateway.wait_for(lambda: all_are(gateway, pattern, "invalid"), timeout_s, f"{pattern} is invalid")


def counters(gateway: Gateway, port: int) -> dict[str, Any]:
    return next(row for row in gateway.query("lines") if row["port"] == port)


def device(gateway: Gateway, port: int, unit: int) -> dict[str, Any]:
    return next(row for row in counters(gateway, port)["devices"] if row["id"] == unit)


def is_fresh(gateway: Gateway, pattern: str) -> bool:
    points = gateway.points(pattern)
    return all(point["quality"] == "good" and point["age_s"] < FRESH_S for point in points.values())


def port_log(gateway: Gateway, port: int) -> list[str]:
    """What the log says of a port: connected, lost, … without the system's reason."""
    lines = re.findall(rf"port {port}: \S+ port \d+ (.*)$", gateway.log(1000), re.MULTILINE)
    return [re.sub("lost: (?!it sends).*", "lost", message) for message in lines]


def wait_port_log(gateway: Gateway, port: int, messages: list[str]) -> None:
    """Each change once; rtud writes it when it comes to it."""
    gateway.wait_for(lambda: port_log(gateway, port) == messages, NOTICE_S, f"{messages} of port {port}")


# ---- one device behind the connection --------------------------------------------------------------------


def ipv6() -> bool:
    try:
        with socket.create_server(("::1", 0), family=socket.AF_INET6):
            return True
    except OSError:
        return False


ADDRESSES = [
    "127.0.0.1",
    pytest.param("::1", marks=pytest.mark.skipif(not ipv6(), reason="this host has no IPv6")),
]


@pytest.mark.slow
@pytest.mark.parametrize("address", ADDRESSES)
def test_connection_is_a_line_like_others(programs: Path, address: str) -> None:
    with Server(address) as server, gateway_of(programs, tcp_port(7, server, [slave(255, 0, 4)])) as gateway:
        wait_good(gateway, "p7.255.*")
        values = {name: point["value"] for name, point in gateway.points("p7.255.*").items()}
        assert values == {"p7.255.h0": 1, "p7.255.h4": 5}
        row = counters(gateway, 7)
        assert (row["device"], row["format"], row["open"]) == (address, f"TCP {server.port}", True)
        faults = ("unasked_frames", "noise_bytes")  # a busy host may make an answer late
        assert sum(row[fault] for fault in faults) == 0
        wait_port_log(gateway, 7, ["is connected"])
        with Master(*gateway.address) as master:
            assert master.command(7255, 40001, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(7)))
        assert counters(gateway, 7)["commands"] == 1
        # No key makes a device faster than it may be asked; a busy host may make it slower.
        suggested = json.loads(gateway.ctl("lines", "--suggest"))["port"]
        slaves = [slave for port in suggested if port["value"] == 7 for slave in port["slaves"]]
        assert all(slave["reaction_ms"] >= ASKED_AGAIN_MS for slave in slaves)


@pytest.mark.slow
def test_lost_server_is_connected_again(programs: Path) -> None:
    server = Server()
    with gateway_of(programs, tcp_port(7, server, [slave(1, 0)])) as gateway:
        gateway.wait_for(
            lambda: counters(gateway, 7)["port_errors"] >= 3,
            NOTICE_S,
            "the connection is refused again and again",
        )
        with server:
            wait_good(gateway, "p7.1.*")
        wait_invalid(gateway, "p7.1.*")
        assert is_fresh(gateway, NEIGHBOUR)
        with Master(*gateway.address) as master:
            assert not master.command(7001, 40001, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(7)))
        with server:
            wait_good(gateway, "p7.1.*")
        refused = "cannot be connected: Connection refused"
        said = port_log(gateway, 7)
        assert said[0] == f"{refused}; trying again in 1 s"
        again = next(i for i, line in enumerate(said) if re.match("is connected, again after [1-9]", line))
        assert all(line.startswith(refused) for line in said[:again])


@pytest.mark.slow
def test_device_that_accepts_and_hangs_up_is_said_once(programs: Path) -> None:
    def hang_up(_: Request) -> bytes:
        raise OSError(errno.ECONNABORTED, "no further connection")

    with Server() as server, gateway_of(programs, tcp_port(7, server, [slave(1, 0)])) as gateway:
        wait_good(gateway, "p7.1.*")
        server.respond = hang_up
        begun = server.connections
        gateway.wait_for(lambda: server.connections >= begun + 4, NOTICE_S, "it is connected again and again")
        assert all_are(gateway, "p7.1.*", "invalid")
        said = port_log(gateway, 7)
        assert len(said) < server.connections
        assert said[:2] == ["is connected", "is lost"]
        server.respond = Request.answer
        wait_good(gateway, "p7.1.*")
        gateway.wait_for(
            lambda: re.match("is connected, again after [1-9]", port_log(gateway, 7)[-1]) is not None,
            NOTICE_S,
            "the log says so, and after how many failures",
        )


def end_of_connection(gateway: Gateway, server: Server, nonsense: bytes) -> None:
    begun, errors = server.connections, counters(gateway, 7)["port_errors"]
    server.respond = lambda _: nonsense
    gateway.wait_for(lambda: server.connections > begun, NOTICE_S, "there is a new connection")
    assert counters(gateway, 7)["port_errors"] > errors
    server.respond = Request.answer
    wait_good(gateway, "p7.1.*")


@pytest.mark.slow
def test_what_is_no_modbus_closes_the_connection(programs: Path) -> None:
    with Server() as server, gateway_of(programs, tcp_port(7, server, [slave(1, 0)])) as gateway:
        wait_good(gateway, "p7.1.*")
        end_of_connection(gateway, server, b"HTTP/1.1 400 Bad Request\r\n\r\n")
        end_of_connection(gateway, server, bytes.fromhex("000100000001"))
        lost = "is lost: it sends something that is not Modbus; trying again in 1 s"
        assert port_log(gateway, 7)[:2] == ["is connected", lost]
        assert re.match(r"is connected, again after \d failures? in ", port_log(gateway, 7)[2])


# ---- moods of a peer: what is made of each in virtual time is in src/modbus/test_line_connection.c ---------


class Moody(Server):
    """Hangs up behind each answer, or leaves a connection unanswered behind so many."""

    def __init__(self, hangs_up: bool = False, hangs_after: int = 0) -> None:
        super().__init__()
        self.hangs_up, self.hangs_after = hangs_up, hangs_after

    def _talk(self, connection: socket.socket) -> None:
        answered = 0
        while not self._stop.is_set():
            if not select.select([connection], [], [], 0.02)[0]:
                continue
            frame = connection.recv(4096)
            if not frame:
                return
            if self.hangs_after and answered >= self.hangs_after:
                continue
            connection.sendall(request_of(frame).answer())
            answered += 1
            if self.hangs_up:
                return


@pytest.mark.slow
def test_peer_that_hangs_up_behind_each_answer_is_good(programs: Path) -> None:
    with Moody(hangs_up=True) as server, gateway_of(programs, tcp_port(7, server, [slave(1, 0)])) as gateway:
        wait_good(gateway, "p7.1.*")
        with Master(*gateway.address) as master:
            since, begun = master.mark(), server.connections
            gateway.wait_for(lambda: server.connections >= begun + 20, NOTICE_S, "twenty connections more")
            assert all_are(gateway, "p7.1.*", "good")
            assert not [report for report in master.reports_since(since) if report.ca == 7001]
            assert master.command(7001, 40001, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(7)))
        assert port_log(gateway, 7) == ["is connected"]
        assert "is dead" not in gateway.log(1000)
        row = counters(gateway, 7)
        assert (row["port_errors"], row["open"]) == (0, True)
        assert row["closes"] >= 20


@pytest.mark.slow
def test_connection_that_brings_nothing_is_made_anew(programs: Path) -> None:
    with Moody(hangs_after=50) as server, gateway_of(programs, tcp_port(7, server, [slave(1, 0)])) as gateway:
        gateway.wait_for(lambda: server.connections >= 3, 2 * NOTICE_S, "it is made twice more")
        wait_good(gateway, "p7.1.*")
        gateway.wait_for(lambda: counters(gateway, 7)["hung"] >= 2, NOTICE_S, "both are counted")
        said = "answers nothing on its connection: making another"
        assert port_log(gateway, 7)[:2] == ["is connected", said]  # when again: src/map/test_repeats.c


# ---- late and wrong answers ------------------------------------------------------------------------------


@pytest.mark.slow
def test_device_that_never_answered_is_said_once(programs: Path) -> None:
    """One that says nothing; one that answers too late, with the number that helps; one of another unit; a
    meter whose registers have four octets."""
    took_s = 0.6

    def late(request: Request) -> bytes:
        time.sleep(took_s)
        return request.answer()

    def as_another(request: Request) -> bytes:
        return dataclasses.replace(request, unit=9).answer()

    def wide(request: Request) -> bytes:
        return request.frame(struct.pack(f">BB{request.value}I", READ_HOLDING, 4 * request.value, 1))

    with Server() as silent, Server() as slow, Server() as other, Server() as meter:
        silent.respond, slow.respond, other.respond = (lambda _: b""), late, as_another
        meter.respond = wide
        ports = [
            tcp_port(7, silent, [slave(1, 0, timeout_ms=200)]),
            tcp_port(8, slow, [slave(2, 0, timeout_ms=500)]),
            tcp_port(9, other, [slave(3, 0, timeout_ms=200)]),
            tcp_port(10, meter, [slave(4, 0, timeout_ms=200)]),
        ]
        with gateway_of(programs, *ports) as gateway:
            said = [
                "p7.1: unit 1 on port 7 has never answered within 200 ms",
                "p8.2: unit 2 on port 8 has never answered within 500 ms",
                "p9.3: unit 3 on port 9 has never answered within 200 ms",
                "p9.3: unit 3 was asked on port 9, and unit 9 answers",
                "p10.4: unit 4 on port 10 has never answered within 200 ms",
                "p10.4: unit 4 on port 10 answers with 4 octets of data, and 2 were asked for",
            ]
            number = re.compile(
                r"p8\.2: unit 2 answers after (\d+) ms, response_timeout_ms is 500$", re.MULTILINE
            )
            for line_ in said:
                gateway.wait_for(lambda line_=line_: line_ in gateway.log(), 60.0, line_)
            gateway.wait_for(lambda: number.search(gateway.log()) is not None, 60.0, "how late it is")
            later = counters(gateway, 8)["late_answers"] + 3
            gateway.wait_for(lambda: counters(gateway, 8)["late_answers"] >= later, 60.0, "it goes on")
            assert [gateway.log(1000).count(line_) for line_ in said] == [1] * len(said)
            (took_ms,) = map(int, number.findall(gateway.log(1000)))
            assert took_ms >= took_s * 1000
            assert all_are(gateway, "p8.2.*", "invalid")


@pytest.mark.slow
def test_device_that_comes_and_goes_is_no_flood_in_the_log(programs: Path) -> None:
    """It answers what comes a second after its last answer, and nothing sooner."""
    answered: list[float] = []

    def respond(request: Request) -> bytes:
        if answered and time.monotonic() - answered[-1] < 1.0:
            return b""
        answered.append(time.monotonic())
        return request.answer()

    with Server() as server:
        server.respond = respond
        device_ = slave(1, 0, timeout_ms=100) | {"retries": 0, "probe_max_s": 1}
        with gateway_of(programs, tcp_port(7, server, [device_])) as gateway:
            gateway.wait_for(lambda: len(answered) >= 10, 120.0, "it came and went ten times")
            log = gateway.log(1000)
            lines = re.findall(r"p7\.1: unit 1 on port 7 (?:answers|is dead).*", log)
            assert lines[:2] == [
                "p7.1: unit 1 on port 7 answers",
                "p7.1: unit 1 on port 7 is dead",
            ]
            assert len(lines) < len(answered), lines


@pytest.mark.slow
def test_late_answer_is_never_another_registers_value(programs: Path) -> None:
    """Each third request is answered behind the next one's time-out; all these answers look alike."""
    held: list[bytes] = []
    seen = 0

    def respond(request: Request) -> bytes:
        nonlocal seen
        seen += 1
        if seen % 3 == 0:
            held.append(request.answer())
            return b""
        late, held[:] = b"".join(held), []
        return late + request.answer()

    # So far apart that each has a request of its own.
    addresses = range(0, 500, 100)
    devices = [{**slave(1, *addresses, timeout_ms=300), "retries": 5}]
    with Server() as server, gateway_of(programs, tcp_port(7, server, devices)) as gateway:
        wait_good(gateway, "p7.1.*")
        with Master(*gateway.address) as master:
            since = master.mark()
            server.respond = respond
            gateway.wait_for(
                lambda: counters(gateway, 7)["late_answers"] >= LATE, 2 * NOTICE_S, "late answers come"
            )
            reports = [report for report in master.reports_since(since) if report.ca == 7001]
            assert not [report for report in reports if report.value != report.ioa - 40000]
            for report in master.interrogate(7001):
                assert (report.value, report.good) == (report.ioa - 40000, True)
        assert counters(gateway, 7)["unasked_frames"] == 0
        assert is_fresh(gateway, NEIGHBOUR)


def test_answers_of_no_request_are_counted(programs: Path) -> None:
    def twice(request: Request) -> bytes:
        stranger = Request(request.transaction + 1000 & 0xFFFF, *list(vars(request).values())[1:])
        return stranger.answer() + request.answer()

    with Server() as server, gateway_of(programs, tcp_port(7, server, [slave(1, 0)])) as gateway:
        wait_good(gateway, "p7.1.*")
        server.respond = twice
        gateway.wait_for(lambda: counters(gateway, 7)["unasked_frames"] >= 10, NOTICE_S, "they are counted")
        assert all_are(gateway, "p7.1.*", "good")
        assert counters(gateway, 7)["port_errors"] == 0


# ---- a gateway with two units ----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("word", ["exception", "silence"])
def test_dead_unit_does_not_take_its_neighbour_with_it(programs: Path, word: str) -> None:
    def one_is_dead(request: Request) -> bytes:
        if request.unit == 1:
            return request.answer()
        return request.exception(NO_TARGET) if word == "exception" else b""

    slaves = [slave(1, 0), slave(2, 0, 100, 200)]
    with Server() as server, gateway_of(programs, tcp_port(7, server, slaves)) as gateway:
        wait_good(gateway, "p7.*")
        server.respond = one_is_dead
        wait_invalid(gateway, "p7.2.*")
        gateway.wait_for(
            lambda: device(gateway, 7, 2)["next_probe_ms"] >= 2000,
            2 * NOTICE_S,
            "it is asked less and less often",
        )
        assert is_fresh(gateway, "p7.1.*")
        assert device(gateway, 7, 1)["alive"]
        assert not device(gateway, 7, 2)["alive"]
        assert (device(gateway, 7, 2)["exceptions"] > 0) is (word == "exception")
        server.respond = Request.answer
        wait_good(gateway, "p7.2.*", 2 * NOTICE_S)
        assert counters(gateway, 7)["port_errors"] == 0


# ---- a host that does not answer -------------------------------------------------------------------------


@contextlib.contextmanager
def full(listener: socket.socket) -> Iterator[None]:
    """Clients nobody accepts: the next SYN gets no answer, as from a host that is not there."""
    with contextlib.ExitStack() as stack:
        while True:
            client = stack.enter_context(socket.socket(listener.family))
            client.setblocking(False)
            client.connect_ex(listener.getsockname())
            if not select.select([], [client], [], 0.3)[1]:
                break
        yield


@pytest.mark.slow
def test_host_that_does_not_answer_delays_nobody(programs: Path) -> None:
    server, living = Server(), Server()
    ports = [tcp_port(7, server, [slave(1, 0)]), tcp_port(8, living, [slave(1, 0)])]
    listener = server.listen(backlog=0)
    with living, contextlib.ExitStack() as until_full:
        until_full.enter_context(full(listener))
        with gateway_of(programs, *ports) as gateway:
            wait_good(gateway, "p8.*")
            looks: list[bool] = []

            def tried_twice() -> bool:
                looks.append(all(is_fresh(gateway, name) for name in (NEIGHBOUR, "p8.*")))
                return bool(counters(gateway, 7)["port_errors"] >= 2)

            gateway.wait_for(tried_twice, 2 * RECONNECT_S, "it was tried twice")
            # A busy host tears a frame of the serial line now and then; a call that blocks costs minutes.
            assert looks.count(True) > len(looks) / 2
            assert {module["restarts"] for module in gateway.modules().values()} == {0}
            assert all_are(gateway, "p7.*", "invalid")
            assert port_log(gateway, 7)[0] == "does not answer; trying again in 1 s"
            until_full.close()
            server.start(listener)
            try:
                wait_good(gateway, "p7.*", RECONNECT_S)
            finally:
                server.stop()
