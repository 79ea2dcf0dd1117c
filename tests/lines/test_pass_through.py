# SPDX-License-Identifier: GPL-3.0-or-later
"""A maker's tool (pymodbus) whose requests the gateway passes on to a line that it polls.

Whose turn it is, and what is learned from it, is shown in simulated time: modbus/test_line_passed.c.
"""

import contextlib
import json
import socket
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from pymodbus.client import ModbusTcpClient

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim
from openrtu_tools.cli import main
from rig.configuration import check_document
from rig.desk import everything_read, patience

UNIT, BARE, FORBIDDEN, ABSENT = 5, 6, 7, 8  # polled and open; open; polled; open, and not there
DEVICE, TABLE = f"1.{UNIT}", "holding_registers"
NO_PATH, NO_TARGET = 10, 11
WAIT_S = 20.0
LIMIT = 2
LINE = {"value": 1, "active": 1, "baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0}
VALUES = {"0": 100, "1": 101, "40": 4000, "41": 4001}


def configuration(port: int) -> dict[str, Any]:
    tool = {
        "address": "127.0.0.1",
        "tcp_port": port,
        "units": [UNIT, BARE, ABSENT],
        "functions": [3, 17],
        "write_functions": [6],
        "connections": LIMIT,
        "share_percent": 50,
    }
    polled = {"holding_registers": [{"address": 0}, {"address": 1}], "identify": False, **patience()}
    slaves = [{"id": UNIT, **polled}, {"id": BARE, **patience()}, {"id": FORBIDDEN, **polled}]
    slaves.append({"id": ABSENT, "response_timeout_ms": 50})
    return {"port": [LINE | {"pass_through": tool, "slaves": slaves}]}


@dataclass
class Line:
    lines: LineSim
    gateway: Gateway
    port: int

    def tool(self) -> ModbusTcpClient:
        client = ModbusTcpClient("127.0.0.1", port=self.port, timeout=WAIT_S, retries=0)
        assert client.connect()
        return client

    def log_has(self, text: str) -> bool:
        return text in self.gateway.log(1000)


def devices() -> dict[str, Any]:
    """They have more than the gateway has points of."""
    objects = [{"address": int(address)} for address in VALUES]
    slaves = [{"id": unit, "holding_registers": objects} for unit in (UNIT, BARE, FORBIDDEN)]
    return {"port": [LINE | {"slaves": slaves}]}


@pytest.fixture(scope="module")
def line(programs: Path) -> Iterator[Line]:
    port, directory = free_port(), run_directory()
    held = {f"1.{unit}": {"holding_registers": VALUES} for unit in (UNIT, BARE, FORBIDDEN)}
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        file, values = directory / "linesim.json", directory / "values.json"
        file.write_text(json.dumps(devices()))
        values.write_text(json.dumps(held))
        lines = stack.enter_context(LineSim(file, values, directory / "dev"))
        config = listening_on(configuration(port), free_port())
        gateway = stack.enter_context(Gateway(config, directory, programs))
        gateway.wait_for(lambda: everything_read(gateway), WAIT_S, "all is read")
        yield Line(lines, gateway, port)


@pytest.fixture
def tool(line: Line) -> Iterator[ModbusTcpClient]:
    with line.tool() as client:
        yield client


@pytest.fixture
def as_before(line: Line) -> Iterator[None]:
    """What a test writes is undone."""
    yield
    line.lines.set(DEVICE, TABLE, 40, VALUES["40"], VALUES["41"])


@pytest.mark.parametrize("unit", [UNIT, BARE])
def test_a_tool_reads_what_is_in_no_point(tool: ModbusTcpClient, unit: int) -> None:
    assert tool.read_holding_registers(40, count=2, device_id=unit).registers == [4000, 4001]


def test_a_devices_refusal_reaches_the_tool(tool: ModbusTcpClient) -> None:
    assert tool.read_holding_registers(9000, count=1, device_id=UNIT).exception_code == 2


@pytest.mark.usefixtures("as_before")
def test_a_write_reaches_the_device_and_the_log(line: Line, tool: ModbusTcpClient) -> None:
    assert tool.write_register(40, 4010, device_id=UNIT).registers == [4010]
    assert line.lines.get(DEVICE, TABLE, 40) == 4010
    text = f"port 1: 127.0.0.1 writes unit {UNIT} function 6 at 40: done"
    line.gateway.wait_for(lambda: line.log_has(text), WAIT_S, text)


def test_what_is_not_allowed_does_not_reach_the_line(line: Line, tool: ModbusTcpClient) -> None:
    mark = line.lines.mark()
    assert tool.read_holding_registers(40, count=1, device_id=FORBIDDEN).exception_code == NO_PATH
    assert tool.read_coils(0, count=1, device_id=UNIT).exception_code == NO_PATH
    assert tool.write_registers(0, [1], device_id=UNIT).exception_code == NO_PATH
    allowed = tool.read_holding_registers(40, count=1, device_id=UNIT)  # on the line behind them
    assert allowed.registers == [4000]
    sent = {frame.bytes[:4] for frame in line.lines.frames(mark)}
    assert bytes([UNIT, 3, 0, 40]) in sent and bytes([FORBIDDEN, 3, 0, 40]) not in sent
    assert not {bytes([UNIT, 1]), bytes([UNIT, 16])} & {octets[:2] for octets in sent}
    text = f"writes unit {UNIT} function 16 at 0: not allowed"
    line.gateway.wait_for(lambda: line.log_has(text), WAIT_S, text)


def test_silence_is_told_as_such(line: Line, tool: ModbusTcpClient) -> None:
    assert tool.read_holding_registers(40, count=1, device_id=ABSENT).exception_code == NO_TARGET
    assert everything_read(line.gateway)


@pytest.mark.usefixtures("as_before")
def test_openrtu_goes_through_the_gateways_line(line: Line, capsys: pytest.CaptureFixture[str]) -> None:
    where = [f"127.0.0.1:{line.port}", "--unit", f"{UNIT}", "--timeout", f"{WAIT_S}"]
    assert main(["read", *where, "h40", "--count", "2"]) == 0
    assert [line.split()[-1] for line in capsys.readouterr().out.splitlines()] == ["4000", "4001"]
    assert main(["write", *where, "h41", "4011"]) == 0
    assert "as written" in capsys.readouterr().out
    assert line.lines.get(DEVICE, TABLE, 41) == 4011
    assert main(["read", *where, "c3"]) != 0
    assert "does not allow this" in capsys.readouterr().err


def request(transaction: int, unit: int, pdu: bytes) -> bytes:
    return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit) + pdu


def read(address: int, count: int) -> bytes:
    return struct.pack(">BHH", 3, address, count)


def test_each_tool_gets_its_own_answers(line: Line) -> None:
    """Several requests at once, of two tools with the same transactions."""
    addresses = {40: 4000, 41: 4001}
    with line.tool() as first, line.tool() as second:
        sockets = [client.socket for client in (first, second)]
        for address, peer in zip(addresses, sockets, strict=True):
            assert peer
            peer.sendall(b"".join(request(n, UNIT, read(address, 1)) for n in range(2)))
        for value, peer in zip(addresses.values(), sockets, strict=True):
            assert peer
            peer.settimeout(WAIT_S)
            expected = b"".join(request(n, UNIT, struct.pack(">BBH", 3, 2, value)) for n in range(2))
            got = b""
            while len(got) < len(expected):
                got += peer.recv(len(expected) - len(got))
            assert got == expected


def is_closed(peer: socket.socket) -> bool:
    peer.settimeout(WAIT_S)
    try:
        return peer.recv(1) == b""
    except ConnectionResetError:
        return True


def test_one_more_than_allowed_is_sent_away(line: Line) -> None:
    with line.tool() as first, line.tool() as second:
        for client in (first, second):
            assert client.read_holding_registers(40, count=1, device_id=UNIT).registers == [4000]
        with socket.create_connection(("127.0.0.1", line.port), WAIT_S) as third:
            assert is_closed(third)


@pytest.mark.parametrize("octets", [b"\0\1\0\7\0\6\5\3\0\0\0\1", b"\0\1\0\0\xff\xff", b"GET / HTTP/1.1\r\n"])
def test_who_speaks_something_else_is_sent_away(line: Line, octets: bytes) -> None:
    with socket.create_connection(("127.0.0.1", line.port), WAIT_S) as stranger:
        stranger.sendall(octets)
        assert is_closed(stranger)
    with line.tool() as client:
        assert client.read_holding_registers(40, count=1, device_id=UNIT).registers == [4000]


def test_a_tool_that_goes_leaves_nothing_behind(line: Line) -> None:
    """What it had asked is answered to nobody."""
    for _ in range(2):
        with socket.create_connection(("127.0.0.1", line.port), WAIT_S) as peer:
            peer.sendall(request(1, UNIT, read(41, 1)))
        with line.tool() as client:
            assert client.read_holding_registers(40, count=1, device_id=UNIT).registers == [4000]


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"units": [9]}, "pass_through.units[0]: is not the id of a slave of this port"),
        ({"units": []}, "pass_through.units: is empty"),
        ({"functions": [3, 6]}, "pass_through.functions[1]: function 6 may change something, expected it in"),
        (
            {"write_functions": [3]},
            "pass_through.write_functions[0]: function 3 changes nothing, expected",
        ),
        ({"functions": [0]}, "pass_through.functions[0]: is not a function of Modbus, expected 1 to 127"),
        ({"address": "gateway"}, "pass_through.address: is not an IP address"),
    ],
)
def test_mistakes_are_said_at_their_place(
    programs: Path, tmp_path: Path, change: dict[str, Any], error: str
) -> None:
    config = configuration(5020)
    config["port"][0]["pass_through"] |= change
    assert error in check_document(programs, tmp_path, config).stderr
