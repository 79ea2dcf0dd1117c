# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects that are written elsewhere than they are read, and objects that are only written."""

import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.linesim import Frame
from lab.raw_master import NEGATIVE, RawMaster
from rig.desk import Substation, everything_read, gateway_on_lines, patience

pytestmark = pytest.mark.slow  # as a whole

CA, DEVICE = 1005, "1.5"
PERIOD_MS = 10_000  # what is read within 3 s of a command is its read-back
WAIT_S = 60.0
C_SC_NA, C_SE_NB, C_SE_NC = 45, 49, 50
SINGLE, SCALED = (1, 30), (11, 35)
ACT_CON, ACT_TERM, RETURN_REMOTE = 7, 10, 11
READ_INPUTS, READ_INPUT_REGISTERS, WRITE_COIL, WRITE_REGISTER, WRITE_REGISTERS = 2, 4, 5, 6, 16
RESET = 16  # the coil that is never read
INPUT, REGISTER, SPEED = 10101, 30021, 30023  # information object addresses
IV = 0x80

OBJECTS = {
    "discrete_inputs": [{"address": 100, "write_address": 1}],
    "input_registers": [
        {"address": 20, "write_address": 120},
        {"address": 22, "type": "float", "write_address": 122, "read_back": False},
    ],
    "coils": [{"address": RESET, "write_only": True, "short_pulse_ms": 100}],
}


def configuration() -> dict[str, Any]:
    slave = {"id": 5, **patience(), "period_ms": PERIOD_MS, **OBJECTS}
    pace = {"baud_rate": 19200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    return {"iec104": {}, "port": [{"value": 1, "active": 1, **pace, "slaves": [slave]}]}


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Substation]:
    with gateway_on_lines(configuration(), programs, {}) as (lines, gateway):
        gateway.wait_for(lambda: everything_read(gateway), WAIT_S, "all that is read has been read")
        yield Substation(lines, gateway)


@pytest.fixture
def master(running: Substation) -> Iterator[RawMaster]:
    running.lines.fault(DEVICE, "clear")
    running.gateway.wait_for(lambda: everything_read(running.gateway), WAIT_S, "the device is back")
    with RawMaster(*running.gateway.address) as master:
        yield master


def heard(master: RawMaster, kinds: tuple[int, ...], ioa: int, count: int) -> list[tuple[int, int]]:
    """So many answers to a command of these kinds, and what it returned: their causes and values.

    Not what is told by itself: a busy host may lose the device for a moment.
    """
    seen: list[tuple[int, int]] = []
    deadline = time.monotonic() + WAIT_S
    while len(seen) < count:
        asdu = master.next_asdu(deadline)
        if asdu.type in kinds:
            values = [(o.cause, o.value) for o in asdu.objects() if (o.ioa, o.cause) == (ioa, RETURN_REMOTE)]
            seen += values or ([] if asdu.objects() else [(asdu.cause, 0)])
    return seen


def requests(running: Substation, since: int) -> list[bytes]:
    """Function and address of what the device was asked."""
    running.lines.get(DEVICE, "coils", RESET)  # its answer comes behind the frames so far
    frames: list[Frame] = running.lines.frames(since)
    return [frame.bytes[1:4] for frame in frames if frame.kind == "received"]


def test_input_is_commanded_by_its_coil_and_read_back_itself(running: Substation, master: RawMaster) -> None:
    since = running.lines.mark()
    master.request(C_SC_NA, CA, INPUT, b"\x01")
    answers = heard(master, (C_SC_NA, *SINGLE), INPUT, 3)
    # The device holds the coil, and shows at its input what it likes.
    assert answers == [(ACT_CON, 0), (RETURN_REMOTE, 0), (ACT_TERM, 0)]
    assert running.lines.get(DEVICE, "coils", 1) == 1
    asked = requests(running, since)
    assert bytes([READ_INPUTS, 0, 100]) in asked[asked.index(bytes([WRITE_COIL, 0, 1])) :]


def test_register_is_commanded_elsewhere(running: Substation, master: RawMaster) -> None:
    since = running.lines.mark()
    master.request(C_SE_NB, CA, REGISTER, struct.pack("<hB", -7, 0))
    assert heard(master, (C_SE_NB, *SCALED), REGISTER, 3) == [(ACT_CON, 0), (RETURN_REMOTE, 0), (ACT_TERM, 0)]
    assert running.lines.get(DEVICE, "holding_registers", 120) in (-7, 65529)
    asked = requests(running, since)
    assert bytes([READ_INPUT_REGISTERS, 0, 20]) in asked[asked.index(bytes([WRITE_REGISTER, 0, 120])) :]


def test_wide_value_is_commanded_elsewhere_and_not_read_back(running: Substation, master: RawMaster) -> None:
    since = running.lines.mark()
    master.request(C_SE_NC, CA, SPEED, struct.pack("<fB", 1.5, 0))
    assert heard(master, (C_SE_NC,), SPEED, 2) == [(ACT_CON, 0), (ACT_TERM, 0)]
    assert [running.lines.get(DEVICE, "holding_registers", 122 + i) for i in range(2)] == [0x3FC0, 0]
    assert requests(running, since).count(bytes([WRITE_REGISTERS, 0, 122])) == 1


def test_what_is_only_written_is_never_read(running: Substation, master: RawMaster) -> None:
    """Its command ends with the device's confirmation, a pulse with that of its end."""
    master.request(C_SC_NA, CA, 1 + RESET, b"\x01")
    assert heard(master, (C_SC_NA,), 1 + RESET, 2) == [(ACT_CON, 0), (ACT_TERM, 0)]
    assert running.lines.get(DEVICE, "coils", RESET) == 1
    master.request(C_SC_NA, CA, 1 + RESET, b"\x05")  # QU 1
    assert heard(master, (C_SC_NA,), 1 + RESET, 2) == [(ACT_CON, 0), (ACT_TERM, 0)]
    assert running.lines.get(DEVICE, "coils", RESET) == 0
    point = running.gateway.points()[f"p{DEVICE}.c{RESET}"]
    assert (point["value"], point["quality"], point["never_read"]) == (None, "invalid", True)
    functions = {request[0] for request in requests(running, 0)}
    assert functions <= {READ_INPUTS, READ_INPUT_REGISTERS, WRITE_COIL, WRITE_REGISTER, WRITE_REGISTERS}


def test_refusal_of_what_is_only_written_is_negative(running: Substation, master: RawMaster) -> None:
    running.lines.fault(DEVICE, "exception", 4, WRITE_COIL)
    master.request(C_SC_NA, CA, 1 + RESET, b"\x01")
    asdu = master.answer(C_SC_NA)
    assert asdu.cause == ACT_CON | NEGATIVE


def test_death_of_the_device_is_told_of_what_is_read(running: Substation, master: RawMaster) -> None:
    running.lines.fault(DEVICE, "mute")
    told: set[int] = set()
    deadline = time.monotonic() + WAIT_S
    while told != {INPUT, REGISTER}:
        told |= {o.ioa for o in master.next_asdu(deadline).objects() if o.quality & IV}
    interrogation = master.interrogate(CA)
    quality = {o.ioa: o.quality for o in interrogation.objects}
    assert quality[1 + RESET] & IV  # as of a point that was never read


# ---- what a process said of now ------------------------------------------------------------------------


def test_nothing_is_open_or_answers_in_a_process_that_was_stopped(running: Substation) -> None:
    """The process leaves what it had shown last."""
    gateway, line = running.gateway, "rtu-modbus-1"

    def shown() -> tuple[bool, bool]:
        (row,) = gateway.query("lines")
        return row["open"], row["devices"][0]["alive"]

    running.lines.fault(DEVICE, "clear")
    gateway.wait_for(lambda: shown() == (True, True), WAIT_S, "the device answers")
    gateway.ctl("module", line, "stop")
    assert shown() == (False, False)
    assert "0 of 1" in gateway.ctl("top", "--once")
    gateway.ctl("module", line, "start")
    gateway.wait_for(lambda: shown() == (True, True), WAIT_S, "the device answers again")
    gateway.wait_for(lambda: everything_read(gateway), WAIT_S, "all is read again")


def test_nobody_is_connected_to_a_station_that_was_stopped(running: Substation) -> None:
    gateway = running.gateway
    with RawMaster(*gateway.address):
        assert len(gateway.query("iec104", "connections")) == 1
        gateway.ctl("module", "rtu-iec104", "stop")
        assert gateway.query("iec104", "connections") == []
    gateway.ctl("module", "rtu-iec104", "start")
