# SPDX-License-Identifier: GPL-3.0-or-later
"""Our controlling station (the test program iec104-ask) against lib60870's server (c104), over TCP."""

import datetime
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import c104
import pytest

from lab.gateway import free_port
from rig.asking import LIMIT_S, Asking

CA = 47
STARTDT_CON = bytes((0x68, 4, 0x0B, 0, 0, 0))
CONFIRMATION_MS = 20_000
TERMINATION_MS = 20_000


@pytest.fixture
def asking(programs: Path) -> Iterator[Callable[..., Asking]]:
    made: list[Asking] = []

    def make(
        port: int, confirmation_ms: int = CONFIRMATION_MS, termination_ms: int = TERMINATION_MS
    ) -> Asking:
        made.append(Asking(programs, port, confirmation_ms, termination_ms))
        return made[-1]

    yield make
    for one in made:
        one.close()


class Plant:
    """A station of lib60870's with points of each kind; what it is commanded."""

    def __init__(self) -> None:
        self.port = free_port()
        self.server = c104.Server(ip="127.0.0.1", port=self.port, tick_rate_ms=100)
        self.station = self.server.add_station(common_address=CA)
        self.commands: list[tuple[int, Any]] = []
        self.clocks: list[datetime.datetime] = []
        self.refuses = False
        self.single = self.station.add_point(io_address=1, type=c104.Type.M_SP_NA_1)
        self.float = self.station.add_point(io_address=2, type=c104.Type.M_ME_NC_1)
        self.single.value = True
        self.float.value = 1.5
        self.server.on_clock_sync(callable=self.on_clock)

    def on_clock(self, server: c104.Server, ip: str, date_time: datetime.datetime) -> c104.ResponseState:
        self.clocks.append(date_time)
        return c104.ResponseState.SUCCESS

    def on_command(
        self, point: c104.Point, previous_info: c104.Information, message: c104.IncomingMessage
    ) -> c104.ResponseState:
        self.commands.append((point.io_address, point.value))
        return c104.ResponseState.FAILURE if self.refuses else c104.ResponseState.SUCCESS

    def add(self, address: int, name: str, select: bool = False) -> None:
        point = self.station.add_point(io_address=address, type=getattr(c104.Type, name))
        if select:
            point.command_mode = c104.CommandMode.SELECT_AND_EXECUTE
        point.on_receive(callable=self.on_command)


@pytest.fixture
def plant() -> Iterator[Plant]:
    made = Plant()
    yield made
    made.server.stop()


def started(plant: Plant, asking: Callable[..., Asking], **times: int) -> Asking:
    plant.server.start()
    one = asking(plant.port, **times)
    one.until(lambda seen: "started" in seen)
    return one


# Of each kind of command: the line for iec104-ask, c104's type, what its callback sees as text.
COMMANDS = [
    ("single", "C_SC_NA_1", 1, "True"),
    ("double", "C_DC_NA_1", 2, "Double.ON"),
    ("step", "C_RC_NA_1", 1, "Step.HIGHER"),
    ("normalized", "C_SE_NA_1", -16384, "-0.5"),
    ("scaled", "C_SE_NB_1", -7, "-7"),
    ("float", "C_SE_NC_1", 2.5, "2.5"),
    ("bits", "C_BO_NA_1", 77, "1001101"),
    ("single", "C_SC_TA_1", 1, "True"),
    ("double", "C_DC_TA_1", 2, "Double.ON"),
    ("step", "C_RC_TA_1", -1, "Step.LOWER"),
    ("normalized", "C_SE_TA_1", -16384, "-0.5"),
    ("scaled", "C_SE_TB_1", -7, "-7"),
    ("float", "C_SE_TC_1", 2.5, "2.5"),
    ("bits", "C_BO_TA_1", 77, "1001101"),
]


def test_interrogation(plant: Plant, asking: Callable[..., Asking]) -> None:
    one = started(plant, asking)
    assert one.result(f"interrogate {CA} 20")["state"] == "executed command"
    found = {seen["ioa"]: seen for seen in one.information()}
    assert {address: seen["cause"] for address, seen in found.items()} == {1: 20, 2: 20}
    assert found[1]["u"] == 1
    assert found[2]["u"] == 0x3FC00000  # 1.5
    assert one.result(f"counters {CA} 5")["state"] == "executed command"


def test_read(plant: Plant, asking: Callable[..., Asking]) -> None:
    one = started(plant, asking)
    assert one.result(f"read {CA} 2")["state"] == "executed command"
    assert [(seen["ioa"], seen["cause"]) for seen in one.information()] == [(2, 5)]
    assert one.result(f"read {CA} 99")["state"] == "refused command"


def test_clock_synchronisation(plant: Plant, asking: Callable[..., Asking]) -> None:
    one = started(plant, asking)
    before = datetime.datetime.now(datetime.UTC).replace(tzinfo=None) - datetime.timedelta(milliseconds=1)
    assert one.result(f"clock {CA}")["state"] == "executed command"
    after = datetime.datetime.now(datetime.UTC).replace(tzinfo=None)
    [clock] = plant.clocks
    assert before <= clock.replace(tzinfo=None) <= after


def test_spontaneous_value(plant: Plant, asking: Callable[..., Asking]) -> None:
    one = started(plant, asking)
    plant.float.value = 2.5
    assert plant.float.transmit(cause=c104.Cot.SPONTANEOUS)
    seen = one.until(lambda seen: seen.get("ioa") == 2)
    assert (seen["type"], seen["cause"], seen["u"]) == (13, 3, 0x40200000)


def test_commands(plant: Plant, asking: Callable[..., Asking]) -> None:
    for number, (_, name, _, _) in enumerate(COMMANDS, 11):
        plant.add(number, name)
    one = started(plant, asking, termination_ms=0)  # c104 2.2.1 sends no termination of a command
    for number, (word, name, value, _) in enumerate(COMMANDS, 11):
        line = f"{word} {CA} {number} {value} 0 {int('_T' in name)}"
        assert one.result(line)["state"] == "executed command", line
    assert [address for address, _ in plant.commands] == [*range(11, 11 + len(COMMANDS))]
    for (_, name, _, expected), (_, value) in zip(COMMANDS, plant.commands, strict=True):
        assert expected in str(value), name


def test_select_and_execute(plant: Plant, asking: Callable[..., Asking]) -> None:
    plant.add(30, "C_SC_NA_1", select=True)
    plant.add(31, "C_SE_TC_1", select=True)
    one = started(plant, asking, termination_ms=0)
    assert one.result(f"single {CA} 30 1 0 0")["state"] == "refused command"  # not selected
    for line in (f"single {CA} 30 1 1 0", f"float {CA} 31 3.5 1 1"):
        request = one.ask(line)
        one.state(request, "accepted selection")
        assert one.ask(f"execute {request}") == request
        assert one.state(request, "executed command", "refused command")["state"] == "executed command"
    assert plant.commands == [(30, True), (31, 3.5)]


def test_refused_command(plant: Plant, asking: Callable[..., Asking]) -> None:
    plant.add(11, "C_SC_NA_1")
    plant.refuses = True
    one = started(plant, asking)
    ended = one.result(f"single {CA} 11 1 0 0")
    assert (ended["state"], ended["result"]) == ("refused command", "exception")
    assert plant.commands == [(11, True)]


def test_server_that_does_not_terminate(plant: Plant, asking: Callable[..., Asking]) -> None:
    plant.add(11, "C_SC_NA_1")
    one = started(plant, asking, termination_ms=100)
    request = one.ask(f"single {CA} 11 1 0 0")
    one.state(request, "executing command")
    assert one.state(request, "refused command", "executed command")["result"] == "time-out"


def test_server_that_ends_in_the_middle(plant: Plant, asking: Callable[..., Asking]) -> None:
    plant.add(11, "C_SC_NA_1")
    one = started(plant, asking)
    request = one.ask(f"single {CA} 11 1 0 0")
    one.state(request, "executing command")
    plant.server.stop()
    assert one.state(request, "refused command")["result"] == "unknown fate"
    assert one.until(lambda seen: "closed" in seen)["closed"] == "closed by the peer"


def test_server_that_never_confirms(asking: Callable[..., Asking]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(LIMIT_S)
        one = asking(server.getsockname()[1], confirmation_ms=100)
        with server.accept()[0] as connection:
            connection.sendall(STARTDT_CON)
            one.until(lambda seen: "started" in seen)
            ended = one.result(f"interrogate {CA} 20")
            assert (ended["state"], ended["result"]) == ("refused command", "time-out")
            connection.sendall(b"GET / HTTP/1.1\r\n\r\n")
            assert "not an APDU" in one.until(lambda seen: "closed" in seen)["closed"]
