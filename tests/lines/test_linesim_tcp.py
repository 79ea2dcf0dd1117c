# SPDX-License-Identifier: GPL-3.0-or-later
"""linesim behind Modbus TCP, against a master that is not ours (pymodbus)."""

from __future__ import annotations

import json
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymodbus.client import ModbusTcpClient

from lab.gateway import free_port
from lab.linesim import LineSim, LineSimError

UNIT = 5
PATIENCE_S = 30.0
READ = bytes([0, 7, 0, 0, 0, 6, UNIT, 4, 0, 0, 0, 1])
SLAVE = {"id": UNIT, "coils": [{"address": 0}], "input_registers": [{"address": 0}]}


def config_of(path: Path, **port: object) -> Path:
    path.write_text(json.dumps({"port": [{"value": 7, "active": 1, "slaves": [SLAVE], **port}]}))
    return path


@pytest.fixture(scope="module")
def port() -> int:
    return free_port()


@pytest.fixture(scope="module")
def sim(linesim_program: Path, port: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[LineSim]:
    folder = tmp_path_factory.mktemp("tcp")
    config = config_of(folder / "config.json", host="127.0.0.1", tcp_port=port)
    with LineSim(config, None, folder / "lines", serves_tcp=True, program=linesim_program) as running:
        yield running


@pytest.fixture
def session(sim: LineSim, port: int) -> Iterator[socket.socket]:
    sim.command("session 7 clear")
    sim.fault("7.5", "clear")
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as one:
        yield one


def received(session: socket.socket, count: int) -> bytes:
    """So many octets: MSG_WAITALL does not wait where a socket has a time-out."""
    octets = b""
    while len(octets) < count and (more := session.recv(count - len(octets))):
        octets += more
    return octets


def ask(session: socket.socket, request: bytes = READ) -> bytes:
    """The answer; nothing when the session is closed."""
    session.sendall(request)
    return session.recv(300)


def test_another_makers_master_reads_and_writes(sim: LineSim, port: int) -> None:
    sim.set("7.5", "input_registers", 0, 1234)
    with ModbusTcpClient("127.0.0.1", port=port, timeout=PATIENCE_S, retries=0) as client:
        assert client.read_input_registers(0, count=1, device_id=UNIT).registers == [1234]
        assert not client.write_coil(0, True, device_id=UNIT).isError()
        assert client.read_holding_registers(0, count=1, device_id=UNIT).exception_code == 2
    assert sim.get("7.5", "coils", 0) == 1


def test_an_answer_repeats_the_transaction(session: socket.socket) -> None:
    assert ask(session)[:9] == bytes([0, 7, 0, 0, 0, 5, UNIT, 4, 2])


def test_a_request_in_pieces_and_two_at_once(session: socket.socket) -> None:
    session.sendall(READ[:5])
    session.sendall(READ[5:] + READ)
    assert len(received(session, 22)) == 22


def test_a_session_that_hangs_takes_all_and_a_new_one_answers(
    sim: LineSim, session: socket.socket, port: int
) -> None:
    ask(session)
    sim.command("session 7 hang")
    session.sendall(READ)
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as other:
        assert len(ask(other)) == 11
    session.setblocking(False)
    with pytest.raises(BlockingIOError):
        session.recv(300)


def test_a_session_that_is_closed_behind_each_answer(sim: LineSim, session: socket.socket) -> None:
    sim.command("session 7 close")
    assert len(ask(session)) == 11
    assert session.recv(300) == b""


def test_a_session_that_is_idle_is_closed(sim: LineSim, session: socket.socket) -> None:
    ask(session)
    sim.command("session 7 idle 20")
    assert session.recv(300) == b""


def test_a_session_that_is_closed_in_the_place_of_an_answer(sim: LineSim, port: int) -> None:
    sim.command("session 7 clear")
    sim.command("session 7 tear 1")
    write = bytes([0, 9, 0, 0, 0, 6, UNIT, 5, 0, 0, 0, 0])
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as session:
        sim.set("7.5", "coils", 0, 1)
        assert ask(session, write) == b""
    assert sim.get("7.5", "coils", 0) == 0


def test_who_wants_to_see_the_writes_sees_no_reads(sim: LineSim, port: int) -> None:
    sim.command("session 7 clear")
    with socket.socket(socket.AF_UNIX) as control, control.makefile() as lines:
        control.settimeout(PATIENCE_S)
        control.connect(str(sim.directory / "control"))
        control.sendall(b"trace writes\n")
        assert lines.readline() == "ok\n"
        with ModbusTcpClient("127.0.0.1", port=port, timeout=PATIENCE_S, retries=0) as client:
            client.read_input_registers(0, count=1, device_id=UNIT)
            client.write_coil(0, True, device_id=UNIT)
        told = json.loads(lines.readline())
        assert (told["kind"], told["table"], told["value"]) == ("writing", "coils", 1)
        control.sendall(b"trace off\n")
        assert lines.readline() == "ok\n"


def test_what_is_no_modbus_ends_the_session(session: socket.socket) -> None:
    assert ask(session, b"GET / HTTP/1.0\r\n\r\n") == b""


def test_a_device_that_is_late_answers_in_the_order_of_its_requests(
    sim: LineSim, session: socket.socket
) -> None:
    sim.command("fault 7.5 late 50 count 1")
    session.sendall(READ + bytes([0, 8]) + READ[2:])
    got = received(session, 22)
    assert (got[1], got[12]) == (7, 8)


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("session 7 sleep", "usage: session PORT hang"),
        ("session 7 idle 0", "usage: session PORT hang"),
        ("jam 7", "no serial line"),
        ("say 7 1", "no serial line"),
    ],
)
def test_a_command_that_is_none_of_a_tcp_line(sim: LineSim, command: str, said: str) -> None:
    with pytest.raises(LineSimError, match=said):
        sim.command(command)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"host": "device.example"}, "host: expected an IPv4 address of this machine"),
        ({"host": "127.0.0.1", "framing": "rtu"}, "framing: only Modbus TCP is served here"),
        ({"host": "127.0.0.1", "tcp_port": 0}, "tcp_port: expected an integer 1 to 65535"),
    ],
)
def test_a_port_that_is_not_served(
    linesim_program: Path, tmp_path: Path, keys: dict[str, object], said: str
) -> None:
    config = config_of(tmp_path / "config.json", **keys)
    words = [linesim_program, "--tcp", "--config", config, "--dir", tmp_path]
    result = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert (result.returncode, said in result.stderr) == (2, True), result.stderr
