# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands octet by octet, and what they write: confirmation, return information, termination."""

import datetime
import os
import signal
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway
from lab.linesim import Frame
from lab.patience import slowness
from lab.raw_master import Asdu, RawMaster, StationError
from rig.cp56 import cp56
from rig.desk import Substation, gateway_on_lines, patience

CA, DEVICE, UNIT = 1005, "1.5", 5
C_SC, C_DC, C_RC, C_SE_NA, C_SE_NB, C_SE_NC, C_BO = range(45, 52)
C_RD, C_CS = 102, 103
TAGGED = 13  # 58 is 45 with a time tag, and so on
REQUEST, ACT, ACT_CON, DEACT, DEACT_CON, ACT_TERM = 5, 6, 7, 8, 9, 10
RETURN_REMOTE, RETURN_LOCAL = 11, 12
UNKNOWN_IOA = 47
NEGATIVE, TEST, SELECT = 0x40, 0x80, 0x80
SHORT, LONG, PERSISTENT = 1 << 2, 2 << 2, 3 << 2
SHORT_S, LONG_S = 0.3, 0.8
# What a controlling station receives of the objects that are commanded here.
SINGLE, PLAIN, DOUBLE, APART, SELECTED = 1, 2, 3, 11, 6
NORMALIZED, LEVEL, CURRENT, BITS = 40001, 40002, 40003, 40005
M_TAGGED = {SINGLE: 30, DOUBLE: 31, APART: 31, NORMALIZED: 34, LEVEL: 35, CURRENT: 36, BITS: 33}


def configuration() -> dict[str, Any]:
    coils = [
        {"address": 0, "short_pulse_ms": int(SHORT_S * 1000), "long_pulse_ms": int(LONG_S * 1000)},
        {"address": 1},
        {"address": 2, "type": "double", "short_pulse_ms": int(SHORT_S * 1000)},
        {"address": 5, "select": True, "short_pulse_ms": int(SHORT_S * 1000)},
        {"address": 10, "type": "double", "second_address": 20, "short_pulse_ms": int(SHORT_S * 1000)},
    ]
    registers = [
        {"address": 0, "type": "normalized"},
        {"address": 1, "step": 10, "min": -20, "max": 35},
        {"address": 2, "type": "float", "step": 0.5, "min": 0, "max": 100},
        {"address": 4, "type": "bitstring"},
    ]
    patient = patience(400)
    slave = {"id": UNIT, **patient, "coils": coils, "holding_registers": registers}
    pace = {"baud_rate": 38400, "data_bits": 8, "stop_bits": 1, "parity": 0}
    port = {"value": 1, "active": 1, **pace, "slaves": [slave]}
    # Longer than three requests that the device does not answer.
    timeout_s = max(5, 4 * patient["response_timeout_ms"] // 1000)
    return {"iec104": {"command_timeout": timeout_s}, "port": [port]}


@dataclass
class Plant(Substation):
    """The gateway and its one device."""

    at_first: dict[str, Any] = field(default_factory=dict)  # its points, all off

    def coil(self, address: int) -> int:
        return self.lines.get(DEVICE, "coils", address)

    def register(self, address: int) -> int:
        return self.lines.get(DEVICE, "holding_registers", address) & 0xFFFF

    def write_frames(self, since: int) -> list[Frame]:
        """The writes that the device was sent."""
        self.coil(0)  # its answer comes behind the frames so far
        frames = self.lines.frames(since)
        return [f for f in frames if f.kind == "received" and f.bytes[1] in (5, 6, 15, 16)]

    def writes(self, since: int) -> list[tuple[int, bytes]]:
        """Function and data of each."""
        return [(f.bytes[1], f.bytes[2:-2]) for f in self.write_frames(since)]

    def is_at_rest(self) -> bool:
        return all(row["state"] != "executing command" for row in self.gateway.query("commands"))

    def values(self) -> dict[str, Any]:
        """What the gateway knows."""
        return {name: (point["value"], point["quality"]) for name, point in self.gateway.points().items()}

    def wait_coil(self, address: int, value: int, timeout_s: float = 5.0) -> None:
        self.gateway.wait_for(lambda: self.coil(address) == value, timeout_s, f"coil {address} is {value}")

    def pid(self, name: str) -> int:
        pid: int = self.gateway.modules()[name]["pid"]
        return pid

    def kill(self, name: str, pid: int | None = None) -> None:
        """kill -9; returns when its successor runs."""
        pid = pid or self.pid(name)
        os.kill(pid, signal.SIGKILL)

        def restarted() -> bool:
            module = self.gateway.modules()[name]
            return module["state"] == "running" and module["pid"] not in (0, pid)

        self.gateway.wait_for(restarted, 60.0, f"{name} runs again")


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Plant]:
    with gateway_on_lines(configuration(), programs, initial={}) as (lines, gateway):
        plant = Plant(lines, gateway)
        plant.wait_all_good(CA)
        plant.at_first = plant.values()
        with RawMaster(*gateway.address) as master:
            master.request(C_CS, CA, 0, cp56(now()))
            assert master.answer(C_CS).cause == ACT_CON
        yield plant


@pytest.fixture
def plant(running: Plant) -> Iterator[Plant]:
    """The device as it is switched on: all off."""
    for address in (0, 1, 2, 3, 5, 10, 20):
        running.lines.set(DEVICE, "coils", address, 0)
    running.lines.set(DEVICE, "holding_registers", 0, 0, 0, 0, 0, 0, 0)
    running.gateway.wait_for(running.is_at_rest, 60.0, "no command is under way")
    running.gateway.wait_for(lambda: running.values() == running.at_first, 60.0, "all is off")
    yield running
    running.lines.fault(DEVICE, "clear")
    running.wait_all_good(CA)


@pytest.fixture
def master(plant: Plant) -> Iterator[RawMaster]:
    with RawMaster(*plant.gateway.address) as master:
        yield master


def now() -> datetime.datetime:
    return datetime.datetime.now(datetime.UTC)


def element(kind: int, body: bytes, tagged: bool) -> tuple[int, bytes]:
    return (kind + TAGGED, body + cp56(now())) if tagged else (kind, body)


def receive(master: RawMaster, kind: int, until: int, timeout_s: float = 60.0) -> list[Asdu]:
    """What arrives until a command of that type is answered with a cause, that answer included."""
    seen: list[Asdu] = []
    deadline = time.monotonic() + timeout_s
    while not seen or (seen[-1].type, seen[-1].cause & 0x3F) != (kind, until):
        assert not seen or (seen[-1].type, seen[-1].cause) != (kind, ACT_CON | NEGATIVE), "it is refused"
        seen.append(master.next_asdu(deadline))
    return seen


def causes(asdus: list[Asdu]) -> list[tuple[int, int]]:
    return [(asdu.type, asdu.cause) for asdu in asdus]


def refused(master: RawMaster, kind: int, ioa: int, body: bytes) -> bool:
    master.request(kind, CA, ioa, body)
    answer = master.answer(kind)
    return answer.cause == ACT_CON | NEGATIVE and answer.body == ioa.to_bytes(3, "little") + body


def assert_nothing_more(master: RawMaster, kind: int, seconds: float = 0.3) -> None:
    with pytest.raises(StationError, match=f"answer of type {kind}"):
        master.answer(kind, timeout_s=seconds)


# ---- the order of the frames ------------------------------------------------------------------------

HALF = struct.pack("<hB", 0x4000, 0)
FLOAT = struct.pack("<fB", 1.5, 0)


@dataclass(frozen=True)
class Command:
    """A command, and what becomes of it."""

    name: str
    kind: int
    ioa: int
    body: bytes
    written: tuple[tuple[int, str], ...]  # function, and the octets behind it
    value: bytes  # in the return information

    def writes(self) -> list[tuple[int, bytes]]:
        return [(function, bytes.fromhex(data)) for function, data in self.written]


COMMANDS = [
    Command("single", C_SC, SINGLE, b"\x01", ((5, "0000 ff00"),), b"\x01"),
    Command("persistent", C_SC, SINGLE, bytes([PERSISTENT | 1]), ((5, "0000 ff00"),), b"\x01"),
    Command("double", C_DC, DOUBLE, b"\x02", ((15, "0002 0002 01 02"),), b"\x02"),
    Command("double apart on", C_DC, APART, b"\x02", ((5, "000a 0000"), (5, "0014 ff00")), b"\x02"),
    Command("double apart off", C_DC, APART, b"\x01", ((5, "0014 0000"), (5, "000a ff00")), b"\x01"),
    Command("step higher", C_RC, LEVEL, b"\x02", ((6, "0001 000a"),), b"\x0a\x00\x00"),
    Command("step lower", C_RC, LEVEL, b"\x01", ((6, "0001 fff6"),), b"\xf6\xff\x00"),
    Command("float step", C_RC, CURRENT, b"\x02", ((16, "0002 0002 04 3f000000"),), b"\0\0\0\x3f\0"),
    Command("normalized", C_SE_NA, NORMALIZED, HALF, ((6, "0000 4000"),), HALF),
    Command("scaled", C_SE_NB, LEVEL, b"\x23\x00\x00", ((6, "0001 0023"),), b"\x23\x00\x00"),
    Command("float", C_SE_NC, CURRENT, FLOAT, ((16, "0002 0002 04 3fc00000"),), FLOAT),
    Command("bits", C_BO, BITS, b"\x78\x56\x34\x12", ((16, "0004 0002 04 12345678"),), b"\x78\x56\x34\x12\0"),
]
each_command = pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)


@pytest.mark.sample(4)
@pytest.mark.parametrize("tagged", [False, True], ids=["", "tagged"])
@each_command
def test_confirmation_return_information_termination(
    plant: Plant,
    master: RawMaster,
    command: Command,
    tagged: bool,
) -> None:
    mark = plant.lines.mark()
    sent, information = element(command.kind, command.body, tagged)
    address = command.ioa.to_bytes(3, "little")
    master.request(sent, CA, command.ioa, information, originator=9)
    confirmation, returned, end = receive(master, sent, ACT_TERM)
    assert causes([confirmation, returned, end]) == [
        (sent, ACT_CON),
        (M_TAGGED[command.ioa], RETURN_REMOTE),
        (sent, ACT_TERM),
    ]
    assert confirmation.body == end.body == address + information
    assert (confirmation.originator, returned.originator, end.originator) == (9, 0, 9)
    assert returned.body[:-7] == address + command.value
    assert plant.writes(mark) == command.writes()
    assert_nothing_more(master, sent, 0.05)


def test_unchanged_value_is_returned_all_the_same(plant: Plant, master: RawMaster) -> None:
    master.request(C_SC, CA, PLAIN, b"\x00")
    assert causes(receive(master, C_SC, ACT_TERM)) == [(C_SC, ACT_CON), (30, RETURN_REMOTE), (C_SC, ACT_TERM)]


def test_every_master_sees_the_return_information(plant: Plant, master: RawMaster) -> None:
    with RawMaster(*plant.gateway.address) as other:
        master.request(C_SC, CA, PLAIN, b"\x01")
        receive(master, C_SC, ACT_TERM)
        seen = other.next_asdu(time.monotonic() + 60)
        assert (seen.type, seen.cause, seen.body[:4]) == (30, RETURN_REMOTE, b"\x02\x00\x00\x01")


@pytest.mark.slow
def test_session_goes_on_while_the_device_is_slow(plant: Plant, master: RawMaster) -> None:
    plant.lines.fault(DEVICE, "delay", 80)
    master.request(C_SC, CA, PLAIN, b"\x01")
    master.request(C_RD, CA, NORMALIZED, b"", cause=REQUEST)
    assert causes(receive(master, C_SC, ACT_TERM)) == [
        (9, REQUEST),
        (C_SC, ACT_CON),
        (30, RETURN_REMOTE),
        (C_SC, ACT_TERM),
    ]


@pytest.mark.sample(4)
@each_command
@pytest.mark.parametrize(
    ("fault", "tagged"),
    [
        pytest.param(("exception", 4), False, id="exception"),
        pytest.param(("exception", 4), True, id="exception tagged", marks=pytest.mark.slow),
        pytest.param(("mute",), False, id="timeout", marks=pytest.mark.slow),
        pytest.param(("mute",), True, id="timeout tagged", marks=pytest.mark.slow),
    ],
)
def test_failure_is_one_negative_confirmation_and_one_write(
    plant: Plant,
    master: RawMaster,
    command: Command,
    fault: tuple[Any, ...],
    tagged: bool,
) -> None:
    mark = plant.lines.mark()
    function = command.written[0][0]
    plant.lines.fault(DEVICE, *fault, *((function,) if fault[0] == "exception" else ()))
    kind, body = element(command.kind, command.body, tagged)
    assert refused(master, kind, command.ioa, body)
    plant.lines.fault(DEVICE, "clear")
    plant.wait_all_good(CA)
    assert plant.writes(mark) == command.writes()[:1]
    assert_nothing_more(master, kind, 0.05)


def test_next_command_waits_for_the_end_of_the_one_before(plant: Plant, master: RawMaster) -> None:
    """A master that looks at confirmations only is not refused."""
    for value in (1, 0, 1, 0):
        master.request(C_SC, CA, PLAIN, bytes([value]))
        while (answer := master.answer(C_SC)).cause != ACT_CON:
            assert answer.cause == ACT_TERM
        assert answer.body[3] == value == plant.coil(1)


def test_half_of_a_double_command_is_negative(plant: Plant, master: RawMaster) -> None:
    """The coil that goes off was written, the other one is refused."""
    plant.lines.set(DEVICE, "coils", 10, 1)
    plant.wait_scan(DEVICE)
    mark = plant.lines.mark()
    master.request(C_DC, CA, APART, b"\x02")
    plant.lines.wait_frame(lambda f: f.kind == "received" and f.bytes[1] == 5, since=mark)
    plant.lines.fault(DEVICE, "exception", 4, 5)
    answer = master.answer(C_DC)
    if plant.coil(20) == 0:  # the fault came in time
        assert answer.cause == ACT_CON | NEGATIVE
    assert plant.coil(10) == 0


# ---- pulses -----------------------------------------------------------------------------------------


def changes(asdus: list[Asdu]) -> list[bytes]:
    return [asdu.body[3:4] for asdu in asdus if asdu.cause == RETURN_REMOTE]


PULSES = [
    pytest.param(C_SC, SINGLE, SHORT | 1, SHORT_S, [b"\x01", b"\x00"], id="short"),
    pytest.param(C_SC, SINGLE, LONG | 1, LONG_S, [b"\x01", b"\x00"], id="long"),
    pytest.param(C_DC, DOUBLE, SHORT | 2, SHORT_S, [b"\x02", b"\x00"], id="double on"),
    pytest.param(C_DC, DOUBLE, SHORT | 1, SHORT_S, [b"\x01", b"\x00"], id="double off"),
    pytest.param(C_DC, APART, SHORT | 2, SHORT_S, [b"\x02", b"\x00"], id="double apart"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "ioa", "command", "seconds", "values"), PULSES)
def test_pulse_is_terminated_after_its_end(
    plant: Plant, master: RawMaster, kind: int, ioa: int, command: int, seconds: float, values: list[bytes]
) -> None:
    mark = plant.lines.mark()
    master.request(kind, CA, ioa, bytes([command]))
    seen = receive(master, kind, ACT_TERM)
    assert causes(seen) == [
        (kind, ACT_CON),
        (M_TAGGED[ioa], RETURN_REMOTE),
        (M_TAGGED[ioa], RETURN_REMOTE),
        (kind, ACT_TERM),
    ]
    assert changes(seen) == values
    frames = plant.write_frames(mark)
    writes = 2 if ioa == APART else 1
    assert len(frames) == 2 * writes
    duration = (frames[writes].monotonic_ns - frames[writes - 1].monotonic_ns) / 1e9
    assert seconds <= duration < seconds + 0.5 * slowness()  # a busy machine may be late, never early
    assert [plant.coil(address) for address in (0, 2, 3, 10, 20)] == [0, 0, 0, 0, 0]


@pytest.mark.sample(4)
@pytest.mark.parametrize(
    ("kind", "ioa", "command"),
    [
        pytest.param(C_SC, SINGLE, SHORT | 0, id="pulse to off"),
        pytest.param(C_SC, PLAIN, SHORT | 1, id="no short pulse configured"),
        pytest.param(C_SC, PLAIN, LONG | 1, id="no long pulse configured"),
        pytest.param(C_DC, DOUBLE, LONG | 2, id="no long pulse of this double"),
        pytest.param(C_SC, SINGLE, 4 << 2 | 1, id="reserved 4"),
        pytest.param(C_SC, SINGLE, 31 << 2 | 1, id="reserved 31"),
        pytest.param(C_DC, DOUBLE, 9 << 2 | 1, id="reserved 9"),
        pytest.param(C_DC, DOUBLE, 0, id="DCS 0"),
        pytest.param(C_DC, DOUBLE, 3, id="DCS 3"),
        pytest.param(C_RC, LEVEL, 0, id="RCS 0"),
        pytest.param(C_RC, LEVEL, 3, id="RCS 3"),
        pytest.param(C_RC, LEVEL, SHORT | 1, id="pulse of a step"),
    ],
)
def test_what_cannot_be_carried_out_is_refused(
    plant: Plant, master: RawMaster, kind: int, ioa: int, command: int
) -> None:
    mark = plant.lines.mark()
    assert refused(master, kind, ioa, bytes([command]))
    assert_nothing_more(master, kind, 0.05)
    plant.wait_scan(DEVICE)
    assert plant.writes(mark) == []


@pytest.mark.slow
def test_no_other_command_while_a_pulse_runs(plant: Plant, master: RawMaster) -> None:
    master.request(C_SC, CA, SINGLE, bytes([SHORT | 1]))
    assert master.answer(C_SC).cause == ACT_CON
    with RawMaster(*plant.gateway.address) as other:
        assert refused(other, C_SC, SINGLE, b"\x01")
        assert refused(other, C_SC, SINGLE, b"\x00")
        assert refused(other, C_SC, SINGLE, bytes([SELECT]))
    assert receive(master, C_SC, ACT_TERM)[-1].cause == ACT_TERM
    master.request(C_SC, CA, SINGLE, b"\x01")
    assert receive(master, C_SC, ACT_TERM)[0].cause == ACT_CON


@pytest.mark.slow
def test_pulse_ends_though_the_master_has_gone(plant: Plant) -> None:
    with RawMaster(*plant.gateway.address) as master:
        master.request(C_SC, CA, SINGLE, bytes([SHORT | 1]))
        assert master.answer(C_SC).cause == ACT_CON
    assert plant.coil(0) == 1
    plant.wait_coil(0, 0)


@pytest.mark.slow
def test_pulse_ends_though_the_station_was_killed(plant: Plant) -> None:
    with RawMaster(*plant.gateway.address) as master:
        master.request(C_SC, CA, SINGLE, bytes([LONG | 1]))
        assert master.answer(C_SC).cause == ACT_CON
        plant.kill("rtu-iec104")
    plant.wait_coil(0, 0)


@pytest.mark.slow
def test_pulse_ends_though_the_line_process_was_killed(plant: Plant, master: RawMaster) -> None:
    master.request(C_SC, CA, SINGLE, bytes([LONG | 1]))
    assert master.answer(C_SC).cause == ACT_CON
    plant.kill("rtu-modbus-1")
    end = master.answer(C_SC)
    assert (end.cause, end.body[3]) == (ACT_TERM | NEGATIVE, LONG | 1)  # nobody can tell what became of it
    plant.wait_coil(0, 0)
    plant.wait_all_good(CA)
    wait_accepted(master, SINGLE)


def wait_accepted(master: RawMaster, ioa: int) -> None:
    """Until the point takes commands again: the end of its pulse is confirmed."""
    deadline = time.monotonic() + 60
    while True:
        master.request(C_SC, CA, ioa, b"\x00")
        if master.answer(C_SC).cause == ACT_CON:
            receive(master, C_SC, ACT_TERM)
            return
        assert time.monotonic() < deadline, "the point is never released"


def test_stop_of_the_gateway_ends_pulses(programs: Path) -> None:
    with gateway_on_lines(configuration(), programs, initial={}) as (lines, gateway):
        plant = Plant(lines, gateway)
        plant.wait_all_good(CA)
        with RawMaster(*gateway.address) as master:
            master.request(C_DC, CA, APART, bytes([SHORT | 2]))
            assert master.answer(C_DC).cause == ACT_CON
            assert plant.coil(20) == 1
            assert gateway.stop() == 0
        assert [plant.coil(address) for address in (10, 20)] == [0, 0]


def test_pulse_of_unknown_fate_is_ended(plant: Plant, master: RawMaster) -> None:
    """The line process dies while it waits for the answer to the write that switches on."""
    mark = plant.lines.mark()
    plant.lines.fault(DEVICE, "delay", 10_000)
    pid = plant.pid("rtu-modbus-1")
    master.request(C_SC, CA, SINGLE, bytes([LONG | 1]))
    plant.lines.wait_frame(lambda f: f.kind == "received" and f.bytes[1] == 5, since=mark)
    plant.kill("rtu-modbus-1", pid)
    plant.lines.fault(DEVICE, "clear")
    assert master.answer(C_SC).cause == ACT_CON | NEGATIVE
    plant.wait_coil(0, 0)
    plant.gateway.wait_for(lambda: len(plant.writes(mark)) == 2, 60.0, "the end is written")
    assert [data for _, data in plant.writes(mark)] == [b"\x00\x00\xff\x00", b"\x00\x00\x00\x00"]
    assert_nothing_more(master, C_SC, 0.05)


@pytest.mark.slow
def test_end_of_a_pulse_is_tried_until_it_is_confirmed(plant: Plant, master: RawMaster) -> None:
    mark = plant.lines.mark()
    master.request(C_SC, CA, SINGLE, bytes([SHORT | 1]))
    assert master.answer(C_SC).cause == ACT_CON
    plant.lines.fault(DEVICE, "exception", 4, 5)
    assert master.answer(C_SC).cause == ACT_TERM | NEGATIVE
    assert plant.coil(0) == 1
    assert refused(master, C_SC, SINGLE, b"\x01")
    plant.lines.fault(DEVICE, "clear")
    plant.wait_coil(0, 0)
    assert len(plant.writes(mark)) == 3
    wait_accepted(master, SINGLE)


@pytest.mark.slow
def test_pulse_that_is_not_answered_is_ended(plant: Plant, master: RawMaster) -> None:
    """The device has acted, and only its answer is lost: it is not left switched on."""
    plant.lines.fault(DEVICE, "corrupt", count=1)
    mark = plant.lines.mark()
    deadline = time.monotonic() + 60
    while not plant.writes(mark):  # a read may take the fault's one answer
        assert time.monotonic() < deadline
        plant.lines.fault(DEVICE, "corrupt")
        assert refused(master, C_SC, SINGLE, bytes([SHORT | 1]))
        assert plant.coil(0) == 1
        plant.lines.fault(DEVICE, "clear")
    plant.wait_coil(0, 0)


# ---- steps ------------------------------------------------------------------------------------------


def test_steps_stop_at_the_limits(plant: Plant, master: RawMaster) -> None:
    for value in (10, 20, 30):
        master.request(C_RC, CA, LEVEL, b"\x02")
        assert receive(master, C_RC, ACT_TERM)[-1].cause == ACT_TERM
        assert plant.register(1) == value
    assert refused(master, C_RC, LEVEL, b"\x02")
    assert plant.register(1) == 30
    master.request(C_RC, CA, LEVEL, b"\x01")
    assert receive(master, C_RC, ACT_TERM)[-1].cause == ACT_TERM
    assert plant.register(1) == 20


def test_set_point_beyond_the_limits_is_refused(plant: Plant, master: RawMaster) -> None:
    mark = plant.lines.mark()
    assert refused(master, C_SE_NB, LEVEL, struct.pack("<hB", 36, 0))
    assert refused(master, C_SE_NB, LEVEL, struct.pack("<hB", -21, 0))
    assert refused(master, C_SE_NC, CURRENT, struct.pack("<fB", 100.5, 0))
    assert plant.writes(mark) == []


@pytest.mark.slow
def test_step_needs_a_good_value(plant: Plant, master: RawMaster) -> None:
    mark = plant.lines.mark()
    plant.lines.fault(DEVICE, "exception", 2, 3)  # holding registers are not read any more
    point = "p1.5.h1"
    plant.gateway.wait_for(
        lambda: plant.gateway.points(point)[point]["quality"] == "invalid", 60.0, "the level is invalid"
    )
    assert refused(master, C_RC, LEVEL, b"\x02")
    assert plant.writes(mark) == []


def test_step_of_an_object_without_steps_is_unknown(plant: Plant, master: RawMaster) -> None:
    for ioa in (NORMALIZED, SINGLE, BITS):
        master.request(C_RC, CA, ioa, b"\x02")
        assert master.answer(C_RC).cause == UNKNOWN_IOA | NEGATIVE


# ---- select, test, time tag -------------------------------------------------------------------------


@pytest.mark.slow
def test_selection_binds_the_pulse(plant: Plant, master: RawMaster) -> None:
    mark = plant.lines.mark()
    assert refused(master, C_SC, SELECTED, bytes([SHORT | 1]))
    master.request(C_SC, CA, SELECTED, bytes([SELECT | SHORT | 1]))
    assert master.answer(C_SC).cause == ACT_CON
    assert refused(master, C_SC, SELECTED, b"\x01")  # selected as a pulse
    assert plant.writes(mark) == []
    master.request(C_SC, CA, SELECTED, bytes([SELECT | SHORT | 1]))
    assert master.answer(C_SC).cause == ACT_CON
    master.request(C_SC, CA, SELECTED, bytes([SHORT | 1]))
    assert changes(receive(master, C_SC, ACT_TERM)) == [b"\x01", b"\x00"]


def test_selection_of_a_step_is_deactivated(plant: Plant, master: RawMaster) -> None:
    mark = plant.lines.mark()
    master.request(C_RC, CA, LEVEL, bytes([SELECT | 2]))
    assert master.answer(C_RC).cause == ACT_CON
    master.request(C_RC, CA, LEVEL, bytes([SELECT | 2]), cause=DEACT)
    assert master.answer(C_RC).cause == DEACT_CON
    assert plant.writes(mark) == []


@pytest.mark.sample(4)
@each_command
def test_test_bit_is_never_executed(
    plant: Plant,
    master: RawMaster,
    command: Command,
) -> None:
    mark = plant.lines.mark()
    master.request(command.kind, CA, command.ioa, command.body, cause=ACT | TEST)
    assert master.answer(command.kind).cause == ACT_CON | TEST
    plant.wait_scan(DEVICE)
    assert plant.writes(mark) == []
    assert_nothing_more(master, command.kind, 0.05)


def test_pulse_with_an_old_time_tag_is_refused(plant: Plant, master: RawMaster) -> None:
    mark = plant.lines.mark()
    old = cp56(now() - datetime.timedelta(seconds=60))
    assert refused(master, C_SC + TAGGED, SINGLE, bytes([SHORT | 1]) + old)
    assert refused(master, C_RC + TAGGED, LEVEL, b"\x02" + old)
    assert plant.writes(mark) == []


# ---- rtuctl -----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_rtuctl_commands_are_local(plant: Plant, master: RawMaster) -> None:
    answer = plant.gateway.query("set", "p1.5.c0", "on", "--pulse", "short")
    assert answer["state"] == "executed command"
    seen = [master.next_asdu(time.monotonic() + 60) for _ in range(2)]
    assert [(a.type, a.cause, a.body[:4]) for a in seen] == [
        (30, RETURN_LOCAL, b"\x01\x00\x00\x01"),
        (30, RETURN_LOCAL, b"\x01\x00\x00\x00"),
    ]
    assert plant.gateway.query("step", "p1.5.h1", "higher")["result"] == "done"
    assert plant.register(1) == 10
    returned = master.next_asdu(time.monotonic() + 60)
    assert (returned.type, returned.cause, returned.body[3:6]) == (35, RETURN_LOCAL, b"\x0a\x00\x00")


@pytest.mark.slow
def test_rtuctl_shows_a_confirmed_command(plant: Plant, master: RawMaster) -> None:
    def state(gateway: Gateway) -> tuple[str, str]:
        row = gateway.query("commands", "p1.5.c0")[0]
        return row["state"], row["result"]

    master.request(C_SC, CA, SINGLE, bytes([LONG | 1]))
    assert master.answer(C_SC).cause == ACT_CON
    assert state(plant.gateway) == ("executing command", "done")
    assert receive(master, C_SC, ACT_TERM)[-1].cause == ACT_TERM
