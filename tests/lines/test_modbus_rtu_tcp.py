# SPDX-License-Identifier: GPL-3.0-or-later
"""RTU over TCP as the whole gateway sees it: simulated devices on a line behind a serial device server.

What servers of other makes say when all goes well is in test_modbus_peers.py.
"""

import contextlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import c104
import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim
from lab.master import Master
from peers.device_server import DeviceServer, device_server
from rig.capture import recorded
from rig.desk import everything_read

pytestmark = pytest.mark.slow  # as a whole

PORT, UNIT, CA = 9, 5, 9005
DEVICE = f"1.{UNIT}"  # of linesim
TIMEOUT_MS, LATE_MS = 500, 900  # a busy host makes more answers late, which changes nothing
OWN = {"response_timeout_ms": TIMEOUT_MS, "retries": 5, "probe_max_s": 1}
WAIT_S = 60.0
# Reads of one length, too far apart for one request: their answers look alike.
FAR = {300 * i: 1000 + i for i in range(4)}


@dataclass
class Behind:
    """Devices behind a device server, and the gateway before it."""

    lines: LineSim
    server: DeviceServer
    gateway: Gateway
    master: Master

    def line(self) -> dict[str, Any]:
        return next(line for line in self.gateway.query("lines") if line["port"] == PORT)

    def values(self) -> dict[int, Any]:
        points = self.gateway.points(f"p{PORT}.{UNIT}.h*").values()
        return {point["ioa"] - 40001: point["value"] for point in points}

    def wait_good(self) -> None:
        self.gateway.wait_for(lambda: everything_read(self.gateway), WAIT_S, "all is read")

    def wait_counted(self, counter: str, least: int) -> None:
        self.gateway.wait_for(lambda: self.line()[counter] >= least, WAIT_S, f"{counter} is at least {least}")


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Behind]:
    slaves = [
        {"id": UNIT, **OWN, "holding_registers": [{"address": a} for a in FAR]},
        {"id": 0, "holding_registers": [{"address": 0}]},
    ]
    pace = {"baud_rate": 19200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    directory = run_directory()
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        file, values = directory / "linesim.json", directory / "values.json"
        file.write_text(json.dumps({"port": [{"value": 1, "active": 1, **pace, "slaves": slaves}]}))
        held = {str(address): value for address, value in FAR.items()}
        values.write_text(json.dumps({DEVICE: {"holding_registers": held}}))
        lines = stack.enter_context(LineSim(file, values, directory / "dev"))
        server = stack.enter_context(device_server(lines.line("ttyS1")))
        host = {"host": "127.0.0.1", "tcp_port": server.port, "framing": "rtu"}
        config = {"port": [{"value": PORT, "active": 1, **host, "slaves": slaves}]}
        gateway = stack.enter_context(Gateway(listening_on(config, free_port()), directory, programs))
        stack.enter_context(recorded(gateway))
        yield Behind(lines, server, gateway, stack.enter_context(Master(*gateway.address)))


@pytest.fixture
def behind(running: Behind) -> Behind:
    running.lines.fault(DEVICE, "clear")
    running.wait_good()
    return running


def test_values_of_a_device_behind_it_are_read(behind: Behind) -> None:
    assert behind.values() == FAR
    assert behind.line()["format"] == f"RTU over TCP {behind.server.port}"


def test_command_reaches_the_device_and_is_read_back(behind: Behind) -> None:
    assert behind.master.command(CA, 40001, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(-3)))
    assert behind.lines.get(DEVICE, "holding_registers", 0) in (-3, 65533)
    assert behind.master.command(CA, 40001, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(FAR[0])))
    behind.gateway.wait_for(lambda: behind.values() == FAR, WAIT_S, "the former value is read")


def test_broadcast_reaches_the_line(behind: Behind) -> None:
    """It is sent once; nobody answers it, so it is never executed."""
    behind.master.command(9000, 40001, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(FAR[0])))
    point = behind.gateway.points()[f"p{PORT}.0.h0"]
    assert (point["never_read"], point["quality"]) == (True, "invalid")
    frame = bytes([0, 6, 0, 0, *FAR[0].to_bytes(2, "big")])
    sent = [f for f in behind.lines.frames() if f.kind == "received" and f.bytes[:6] == frame]
    assert len(sent) == 1


def test_late_answers_are_never_another_registers(behind: Behind) -> None:
    """Behind a time-out, none of the next answers is taken for that of another read of the same length."""
    late = behind.line()["late_answers"]
    behind.lines.fault(DEVICE, "late", LATE_MS, count=6)
    behind.wait_counted("late_answers", late + 1)
    seen: list[dict[int, Any]] = []

    def all_good() -> bool:
        seen.append(behind.values())
        return everything_read(behind.gateway)

    behind.gateway.wait_for(all_good, WAIT_S, "all is read")
    assert all(values == FAR for values in seen)


def test_broken_answer_is_asked_for_again(behind: Behind) -> None:
    errors = behind.line()["crc_errors"]
    behind.lines.fault(DEVICE, "corrupt", count=1)
    behind.wait_counted("crc_errors", errors + 1)
    behind.wait_good()
    assert behind.values() == FAR


def test_server_that_hangs_up_is_connected_again(behind: Behind) -> None:
    for _ in range(5):
        connections = behind.server.connections
        behind.server.hang_up()
        behind.gateway.wait_for(lambda n=connections: behind.server.connections > n, WAIT_S, "a connection")
        behind.wait_good()
        assert behind.values() == FAR


def test_device_without_power_is_invalid_until_it_is_back(behind: Behind) -> None:
    behind.lines.fault(DEVICE, "mute")
    behind.gateway.wait_for(lambda: not everything_read(behind.gateway), WAIT_S, "the device is dead")
    behind.lines.fault(DEVICE, "clear")
    behind.wait_good()
    assert behind.values() == FAR
