# SPDX-License-Identifier: GPL-3.0-or-later
"""Modbus UDP as the whole gateway and `openrtu` see it: a server of pymodbus, with losses between.

What is lost, late or junk is shown in simulated time: modbus/test_line_udp.c.
"""

import contextlib
import socket
import struct
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import c104
import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.manager import free_udp_port
from lab.master import Master
from openrtu_tools.cli import main
from peers.device import UNIT, powered
from peers.pymodbus_device import PymodbusUdpDevice
from rig.configuration import check_document
from rig.desk import everything_read

PORT, CA = 9, 9000 + UNIT
WAIT_S = 30.0
HELD = [1100, 1101]
HEADER = 7  # octets before the function
WRITE = 6


class Between:
    """Passes datagrams on but each third, and one function; behind each answer comes one that is none."""

    def __init__(self, port: int) -> None:
        self._device = ("127.0.0.1", port)
        self._socket = socket.socket(type=socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.port: int = self._socket.getsockname()[1]
        self.asked: list[bytes] = []  # the protocol data units that came for the device, function first
        self.lost = 0
        self.losing = 0  # the function of which none gets through

    def __enter__(self) -> "Between":
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        socket.socket(type=socket.SOCK_DGRAM).sendto(b"", ("127.0.0.1", self.port))
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        client = ("127.0.0.1", 0)
        while True:
            octets, peer = self._socket.recvfrom(512)
            if not octets and peer != self._device:
                return
            if peer == self._device:
                self._socket.sendto(octets, client)
                self._socket.sendto(b"", client)
                self._socket.sendto(octets[:5], client)
                continue
            client = peer
            self.asked.append(octets[HEADER:])
            if len(self.asked) % 3 == 0 or self.asked[-1][0] == self.losing:
                self.lost += 1
            else:
                self._socket.sendto(octets, self._device)


@dataclass
class Line:
    device: PymodbusUdpDevice
    between: Between
    gateway: Gateway
    master: Master
    port: int  # the device's own

    def row(self) -> dict[str, Any]:
        row: dict[str, Any] = self.gateway.query("lines")[0]
        return row


def configuration(port: int) -> dict[str, Any]:
    own = {"response_timeout_ms": 200, "response_timeout_min_ms": 200, "retries": 5, "probe_max_s": 1}
    slave = {"id": UNIT, **own, "holding_registers": [{"address": 100}, {"address": 101}]}
    host = {"host": "127.0.0.1", "tcp_port": port, "transport": "udp"}
    return {"port": [{"value": PORT, "active": 1, **host, "slaves": [slave]}]}


@pytest.fixture(scope="module")
def line(programs: Path) -> Iterator[Line]:
    directory, port = run_directory(), free_udp_port()
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        device = stack.enter_context(powered(PymodbusUdpDevice(port)))
        device.set("holding_registers", 100, HELD)
        between = stack.enter_context(Between(port))
        config = listening_on(configuration(between.port), free_port())
        gateway = stack.enter_context(Gateway(config, directory, programs))
        gateway.wait_for(lambda: everything_read(gateway), WAIT_S, "all is read")
        yield Line(device, between, gateway, stack.enter_context(Master(*gateway.address)), port)


def test_values_are_read_though_datagrams_are_lost(line: Line) -> None:
    line.gateway.wait_for(lambda: line.between.lost > 3, WAIT_S, "some are lost")
    assert everything_read(line.gateway)
    assert [point["value"] for point in line.gateway.points("*.h*").values()] == HELD
    row = line.row()
    assert row["format"] == f"UDP {line.between.port}"
    line.gateway.wait_for(lambda: line.row()["timeouts"] >= 3, WAIT_S, "they are time-outs")
    assert row["noise_bytes"] > 0
    assert "closes" not in row


def writes(asked: list[bytes]) -> list[bytes]:
    return [pdu for pdu in asked if pdu[0] == WRITE]


def test_a_command_is_sent_once(line: Line) -> None:
    """What is told as executed was executed. If its answer comes too late, it is not repeated."""
    before = len(writes(line.device.requests)), len(writes(line.between.asked))
    done = line.master.command(CA, 40101, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(7)))
    assert int(done) <= len(writes(line.device.requests)) - before[0] <= 1
    assert len(writes(line.between.asked)) - before[1] == 1


def test_a_lost_command_is_not_repeated(line: Line) -> None:
    """The reads go on, and are repeated, behind it."""
    mark = len(line.between.asked)
    line.between.losing = WRITE
    try:
        assert not line.master.command(CA, 40102, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(8)))
        ended = len(line.between.asked)
        line.gateway.wait_for(lambda: len(line.between.asked) > ended + 6, WAIT_S, "it is read again")
    finally:
        line.between.losing = 0
    assert writes(line.between.asked[mark:]) == [bytes([WRITE]) + struct.pack(">HH", 101, 8)]
    assert line.device.get("holding_registers", 101, 1) == [HELD[1]]


def test_a_host_without_modbus_is_lost_and_tried_again(line: Line, programs: Path) -> None:
    directory, port = run_directory(), free_udp_port()
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        config = listening_on(configuration(port), free_port())
        gateway = stack.enter_context(Gateway(config, directory, programs))
        text = f"port {PORT}: 127.0.0.1 port"
        gateway.wait_for(lambda: text in gateway.log() and "refused" in gateway.log(), WAIT_S, text)
        assert gateway.modules()["rtu-modbus-1"]["pid"]
        stack.enter_context(powered(PymodbusUdpDevice(port)))
        gateway.wait_for(lambda: everything_read(gateway), WAIT_S, "the server that came is read")


def test_openrtu_reads_by_udp(line: Line, capsys: pytest.CaptureFixture[str]) -> None:
    where = [f"127.0.0.1:{line.port}", "-u", f"{UNIT}", "--udp"]
    assert main(["read", *where, "h100", "--timeout", f"{WAIT_S}"]) == 0
    assert capsys.readouterr().out.split()[-1].strip("()") in ("1100", "7")
    assert main(["scan", f"127.0.0.1:{line.port}", "-u", f"{UNIT}", "--udp", "--timeout", "5"]) == 0
    assert f"{UNIT}" in capsys.readouterr().out
    assert main(["read", f"127.0.0.1:{free_udp_port()}", "-u", "1", "--udp", "h1"]) == 1
    assert "serves no Modbus by UDP" in capsys.readouterr().err
    assert main(["scan", f"127.0.0.1:{(silent := free_udp_port())}", "-u", "1", "--udp"]) == 1
    assert f"127.0.0.1 port {silent} (UDP): Connection refused" in capsys.readouterr().err
    assert main(["read", "/dev/null", "-u", "1", "--udp", "h1"]) != 0
    assert "--udp carries frames of Modbus TCP" in capsys.readouterr().err


def test_other_frames_are_not_carried(programs: Path, tmp_path: Path) -> None:
    config = configuration(502)
    config["port"][0] |= {"framing": "rtu"}
    error = "port[0].framing: rtu is not carried by UDP here, expected tcp, or transport tcp"
    assert error in check_document(programs, tmp_path, config).stderr
