# SPDX-License-Identifier: GPL-3.0-or-later
"""The whole gateway between simulated devices (linesim) and a controlling station of another make (c104)."""

import datetime
import itertools
import math
import struct
import time
from typing import Any

import c104
import pytest

from lab.linesim import Frame
from lab.master import Master, Report
from lab.patience import Deadline
from lab.show import DEVICE, FIGURE_5_3, FIGURE_5_5, FIGURE_5_8, STATION
from rig.desk import Desk

NOW = datetime.datetime.now


def float_registers(value: float, words: str = "big", octets: str = "big") -> list[int]:
    """An IEEE 754 number in two registers."""
    high, low = struct.unpack(">HH", struct.pack(">f", value))
    if octets == "little":
        high, low = (((word << 8) | (word >> 8)) & 0xFFFF for word in (high, low))
    return [low, high] if words == "little" else [high, low]


# ---- interrogation and reading -------------------------------------------------------------------


def test_interrogation_is_figure_5_3(desk: Desk) -> None:
    reports = desk.master.interrogate(STATION)
    assert {report.ioa: int(report.value) for report in reports} == FIGURE_5_3
    assert len(reports) == 13
    assert {(report.type, report.good) for report in reports} == {("M_SP_NA_1", True), ("M_ME_NB_1", True)}
    assert all(report.recorded_at is None for report in reports)


@pytest.mark.slow
def test_broadcast_interrogation_reaches_every_station(desk: Desk) -> None:
    stations = {1000, 1010, 2020, 3035, 3067, 3155, 3201, 4040, 5050, 5051, 6001, 6247}
    assert {report.ca for report in desk.master.interrogate_all(*stations)} == stations


@pytest.mark.slow
def test_group_interrogation(desk: Desk) -> None:
    reports = desk.master.interrogate(1010, group=2)
    assert [report.ioa for report in reports] == [30001, 30003, 30004]


@pytest.mark.slow
def test_unknown_station_is_refused(desk: Desk) -> None:
    assert desk.master.is_refused(3068)


@pytest.mark.slow
def test_broadcast_device_is_never_valid(desk: Desk) -> None:
    assert {report.quality for report in desk.master.interrogate(1000)} == {"Invalid"}


@pytest.mark.slow
def test_read_command_answers_with_cause_requested(desk: Desk) -> None:
    desk.master.interrogate(STATION)
    since = desk.master.mark()
    point = desk.master.connection.get_station(STATION).get_point(30002)
    point.read()  # what it returns is no judge: it misses an answer that comes within 0.3 ms
    report = desk.master.wait(lambda r: r.cause == "REQUEST", since)
    assert (report.ca, report.ioa, report.type, report.value) == (STATION, 30002, "M_ME_NB_1", 98)


# ---- every type of table 4.1, from the register to the master ---------------------------------------

TYPES = [
    pytest.param("1.10", "discrete_inputs", 0, [1, 0], 10001, "M_DP_TB_1", "OFF", id="double off"),
    pytest.param("1.10", "discrete_inputs", 0, [0, 1], 10001, "M_DP_TB_1", "ON", id="double on"),
    pytest.param("1.10", "discrete_inputs", 0, [0, 0], 10001, "M_DP_TB_1", "INTERMEDIATE", id="double 0"),
    pytest.param("1.10", "discrete_inputs", 0, [1, 1], 10001, "M_DP_TB_1", "INDETERMINATE", id="double 3"),
    pytest.param("1.10", "discrete_inputs", 2, [0, 1], 10003, "M_DP_TB_1", "OFF", id="double swapped"),
    pytest.param("1.10", "discrete_inputs", 4, [0], 10005, "M_SP_TB_1", False, id="single"),
    pytest.param("1.10", "input_registers", 0, [0x8000], 30001, "M_ME_TD_1", -1.0, id="normalized -1"),
    pytest.param("1.10", "input_registers", 0, [0x4000], 30001, "M_ME_TD_1", 0.5, id="normalized 0.5"),
    pytest.param("1.10", "input_registers", 3, [0xFF38], 30004, "M_ME_TE_1", -200, id="scaled -200"),
    pytest.param("1.10", "input_registers", 2, [750], 30003, "M_ME_TE_1", 35, id="scaled by 0.1, -40"),
    pytest.param("2.20", "input_registers", 0, float_registers(-1.5), 30001, "M_ME_TF_1", -1.5, id="float"),
    pytest.param(
        "2.20",
        "input_registers",
        2,
        float_registers(2.25, "little"),
        30003,
        "M_ME_TF_1",
        2.25,
        id="float words",
    ),
    pytest.param(
        "2.20",
        "input_registers",
        4,
        float_registers(9.5, octets="little"),
        30005,
        "M_ME_TF_1",
        9.5,
        id="float bytes",
    ),
    pytest.param(
        "2.20",
        "input_registers",
        6,
        float_registers(0.125, "little", "little"),
        30007,
        "M_ME_TF_1",
        0.125,
        id="float both",
    ),
    pytest.param("2.20", "input_registers", 8, [0xFFFF, 0xFFFE], 30009, "M_IT_TB_1", -2, id="counter"),
    pytest.param("2.20", "input_registers", 10, [5, 1], 30011, "M_IT_TB_1", 65541, id="counter words"),
    pytest.param(
        "2.20", "input_registers", 12, [0x1234, 0x5678], 30013, "M_BO_TB_1", 0x12345678, id="bitstring"
    ),
    pytest.param("4.40", "input_registers", 0, [0x0040], 30001, "M_ST_TB_1", -64, id="step -64"),
    pytest.param("4.40", "input_registers", 0, [0x00BF], 30001, "M_ST_TB_1", 63, id="step 63 in transit"),
    pytest.param("5.51", "input_registers", 65535, [17], 165535, "M_ME_TE_1", 17, id="address 65535"),
    pytest.param(
        "5.51", "holding_registers", 12000, float_registers(3.5), 212000, "M_ME_TF_1", 3.5, id="own IOA"
    ),
]


@pytest.mark.sample(5)
@pytest.mark.parametrize(("device", "space", "address", "raw", "ioa", "kind", "value"), TYPES)
def test_type_arrives_as_event(
    desk: Desk, device: str, space: str, address: int, raw: list[int], ioa: int, kind: str, value: object
) -> None:
    ca = desk.ca(device)
    away = 0x0110 if space.endswith("registers") else 1  # beyond every deadband, and in the low octet too
    desk.set_and_scan(device, space, address, [word ^ away for word in raw])
    since = desk.master.mark()
    desk.lines.set(device, space, address, *raw)
    report = desk.master.wait(lambda r: (r.ca, r.ioa, r.value) == (ca, ioa, value), since)
    assert (report.type, report.cause, report.quality) == (kind, "SPONTANEOUS", "good")
    assert report.recorded_at is not None


@pytest.mark.slow
def test_unsigned_above_32767_overflows(desk: Desk) -> None:
    report = next(r for r in desk.master.interrogate(4040) if r.ioa == 30002)
    assert (report.value, "Overflow" in report.quality) == (32767, True)


@pytest.mark.slow
def test_float_is_rounded_nowhere(desk: Desk) -> None:
    report = next(r for r in desk.master.interrogate(2020) if r.ioa == 30001)
    words = [desk.lines.get("2.20", "input_registers", address) for address in (0, 1)]
    assert report.value == struct.unpack(">f", struct.pack(">HH", *words))[0]


@pytest.mark.slow
def test_counters_are_not_in_the_interrogation(desk: Desk) -> None:
    assert not [report for report in desk.master.interrogate(2020) if report.type.startswith("M_IT")]


@pytest.mark.slow
def test_cyclic_transmission(desk: Desk) -> None:
    """Each second. A busy host delivers one late, and so nearer to the next."""

    def next_one(after: float) -> Report:
        cyclic = (2020, 30015, "PERIODIC")
        return desk.master.wait(lambda r: (r.ca, r.ioa, r.cause) == cyclic and r.monotonic_s > after)

    first = next_one(time.monotonic())
    third = next_one(next_one(first.monotonic_s).monotonic_s)
    assert first.type == "M_ME_NC_1"
    assert third.monotonic_s - first.monotonic_s > 0.5


# ---- events ---------------------------------------------------------------------------------------


def test_event_carries_the_time_of_the_device_answer(desk: Desk) -> None:
    since = desk.master.mark()
    before = NOW(datetime.UTC)
    desk.lines.set(DEVICE, "input_registers", 1, 1234)
    report = desk.master.wait(lambda r: (r.ioa, r.value) == (30002, 1234), since)
    assert report.recorded_at is not None
    assert (
        before - datetime.timedelta(milliseconds=2)
        <= report.recorded_at
        <= NOW(datetime.UTC) + datetime.timedelta(milliseconds=2)
    )


@pytest.mark.slow
def test_changes_within_the_deadband_are_no_events(desk: Desk) -> None:
    since = desk.master.mark()
    for value in (1000, 1004, 1010):  # the deadband is 5
        desk.set_and_scan("1.10", "input_registers", 3, [value])
    desk.master.wait(lambda r: (r.ca, r.ioa, r.value) == (1010, 30004, 1010), since)
    events = [r.value for r in desk.master.reports_since(since) if (r.ca, r.ioa) == (1010, 30004)]
    # a device that a busy host makes late is told with the value that it had
    told = [value for value, _ in itertools.groupby(events)]
    assert told[-2:] == [1000, 1010] and 1004 not in told


@pytest.mark.slow
def test_changes_of_one_point_come_in_order(desk: Desk) -> None:
    since = desk.master.mark()
    for value in range(2000, 2010):
        desk.lines.set(DEVICE, "input_registers", 2, value)
        desk.master.wait(lambda r, v=value: (r.ioa, r.value) == (30003, v), since)
    times = [r.recorded_at for r in desk.master.reports_since(since) if (r.ca, r.ioa) == (STATION, 30003)]
    assert times == sorted(times, key=lambda t: t or datetime.datetime.min)


@pytest.mark.slow
def test_several_masters_see_each_event(desk: Desk) -> None:
    with Master(*desk.gateway.address) as second, Master(*desk.gateway.address) as third:
        marks = [(master, master.mark()) for master in (desk.master, second, third)]
        desk.lines.set(DEVICE, "discrete_inputs", 1, 1)
        for master, mark in marks:
            assert master.wait(lambda r: (r.ca, r.ioa, r.value) == (STATION, 10002, True), mark).good
    desk.lines.set(DEVICE, "discrete_inputs", 1, 0)


# ---- commands -------------------------------------------------------------------------------------


def test_single_command_is_figure_5_5(desk: Desk) -> None:
    mark = desk.lines.mark()
    assert desk.master.command(STATION, 4, "C_SC_NA_1", c104.SingleCmd(on=True))
    desk.lines.wait_frame(lambda f: f.kind == "received" and f.bytes == FIGURE_5_5, since=mark)
    assert desk.lines.get(DEVICE, "coils", 3) == 1


def test_set_point_with_time_tag_is_figure_5_8(desk: Desk) -> None:
    mark = desk.lines.mark()
    info = c104.ScaledCmd(target=c104.Int16(255), recorded_at=NOW(datetime.UTC))
    assert desk.master.command(STATION, 40003, "C_SE_TB_1", info)
    desk.lines.wait_frame(lambda f: f.kind == "received" and f.bytes == FIGURE_5_8, since=mark)


def test_single_command_with_time_tag(desk: Desk) -> None:
    info = c104.SingleCmd(on=False, recorded_at=NOW(datetime.UTC))
    assert desk.master.command(STATION, 4, "C_SC_TA_1", info)
    assert desk.lines.get(DEVICE, "coils", 3) == 0


SET_POINTS = [
    pytest.param(
        1010, 40001, "C_SE_NA_1", c104.NormalizedCmd(c104.NormalizedFloat(-0.5)), [0xC000], id="normalized"
    ),
    pytest.param(3067, 40001, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(-2)), [0xFFFE], id="scaled"),
    pytest.param(4040, 40002, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(108)), [1080], id="scaled by 0.1"),
    pytest.param(2020, 40001, "C_SE_NC_1", c104.ShortCmd(target=-1.5), float_registers(-1.5), id="float"),
    pytest.param(
        2020,
        40003,
        "C_BO_NA_1",
        c104.BinaryCmd(c104.Byte32(b"\x78\x56\x34\x12")),
        [0x1234, 0x5678],
        id="bits",
    ),
]


@pytest.mark.parametrize(("ca", "ioa", "kind", "info", "registers"), SET_POINTS)
def test_set_point_reaches_the_registers(
    desk: Desk, ca: int, ioa: int, kind: str, info: c104.Information, registers: list[int]
) -> None:
    since = desk.master.mark()
    assert desk.master.command(ca, ioa, kind, info)
    address = ioa - 40001
    written = [
        desk.lines.get(desk.device(ca), "holding_registers", address + i) for i in range(len(registers))
    ]
    assert [word & 0xFFFF for word in written] == registers
    desk.master.wait(lambda r: (r.ca, r.ioa, r.cause) == (ca, ioa, "RETURN_INFO_REMOTE"), since)


def test_two_registers_are_written_in_one_request(desk: Desk) -> None:
    mark = desk.lines.mark()
    assert desk.master.command(2020, 40001, "C_SE_NC_1", c104.ShortCmd(target=7.25))
    desk.lines.stats()  # its answer comes behind the frames so far
    writes = [f.bytes for f in desk.lines.frames(mark) if f.kind == "received" and f.bytes[1] in (6, 16)]
    assert [frame[:7] for frame in writes] == [bytes([20, 16, 0, 0, 0, 2, 4])]


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("fault", "writes"), [(("exception", 4, 5), 1), (("mute",), 1), (("corrupt",), 1)], ids=lambda f: str(f)
)
def test_failed_command_is_negative_and_never_repeated(
    desk: Desk, fault: tuple[Any, ...], writes: int
) -> None:
    mark, deadline = desk.lines.mark(), Deadline(60)
    sent: list[Frame] = []
    while not sent:  # a busy host may let three reads fail before: to a dead device nothing is written
        assert not deadline.over
        desk.lines.fault(DEVICE, *fault)
        try:
            assert not desk.master.command(STATION, 4, "C_SC_NA_1", c104.SingleCmd(on=True))
        finally:
            desk.lines.fault(DEVICE, "clear")
        desk.wait_all_good(STATION)
        sent = [f for f in desk.lines.frames(mark) if f.kind == "received" and f.bytes[:2] == bytes([67, 5])]
    assert len(sent) == writes


@pytest.mark.parametrize(
    ("ioa", "kind", "info"),
    [
        (10001, "C_SC_NA_1", c104.SingleCmd(on=True)),  # a discrete input
        (5, "C_SC_NA_1", c104.SingleCmd(on=True)),  # no such object
        (40001, "C_SC_NA_1", c104.SingleCmd(on=True)),  # another type
    ],
)
def test_impossible_command_is_refused(desk: Desk, ioa: int, kind: str, info: c104.Information) -> None:
    mark = desk.lines.mark()
    assert not desk.master.command(STATION, ioa, kind, info)
    assert not [f for f in desk.lines.frames(mark) if f.kind == "received" and f.bytes[1] in (5, 6, 15, 16)]


def test_command_with_an_old_time_tag_is_refused(desk: Desk) -> None:
    desk.master.synchronise_clock(STATION)
    old = NOW(datetime.UTC) - datetime.timedelta(seconds=60)
    assert not desk.master.command(STATION, 4, "C_SC_TA_1", c104.SingleCmd(on=True, recorded_at=old))


def test_broadcast_write_reaches_the_line(desk: Desk) -> None:
    mark = desk.lines.mark()
    assert desk.master.command(1000, 101, "C_SC_NA_1", c104.SingleCmd(on=True))
    frame = desk.lines.wait_frame(lambda f: f.kind == "received" and f.bytes[0] == 0, since=mark)
    assert frame.bytes[:6] == bytes([0, 5, 0, 100, 255, 0])
    assert desk.lines.get("1.10", "coils", 100) == 1
    log = "lamp-test = on: sent, unanswered, commanded by rtu-iec104"  # never as executed
    desk.gateway.wait_for(lambda: log in desk.gateway.log(), 10.0, log)


# ---- devices that fail ------------------------------------------------------------------------------


@pytest.mark.slow
def test_dead_device_is_invalid_and_its_neighbours_are_not(desk: Desk) -> None:
    since = desk.master.mark()
    desk.lines.fault(DEVICE, "mute")
    try:
        for ioa in FIGURE_5_3:
            desk.master.wait(lambda r, i=ioa: (r.ca, r.ioa) == (STATION, i) and "Invalid" in r.quality, since)
        assert {r.quality for r in desk.master.interrogate(STATION)} == {"Invalid"}
        mark = desk.master.mark()
        desk.lines.set("3.35", "input_registers", 0, 333)
        desk.lines.set("2.20", "discrete_inputs", 0, 1)
        desk.master.wait(lambda r: (r.ca, r.ioa, r.value) == (3035, 30001, 333) and r.good, mark)
        desk.master.wait(lambda r: (r.ca, r.ioa, r.value) == (2020, 10001, True) and r.good, mark)
        touched = {r.ca for r in desk.master.reports_since(since) if "Invalid" in r.quality}
        assert touched == {STATION}
    finally:
        desk.lines.fault(DEVICE, "clear")
        desk.lines.set("2.20", "discrete_inputs", 0, 0)
    desk.wait_all_good(STATION)


@pytest.mark.slow
def test_unplugged_line_is_invalid_and_the_others_are_not(desk: Desk) -> None:
    since = desk.master.mark()
    desk.lines.unplug(3)
    try:
        for ca in (3035, 3067, 3155, 3201):
            desk.master.wait(lambda r, c=ca: r.ca == c and "Invalid" in r.quality, since)
        desk.wait_all_good(2020)  # of the same process, which a starved machine may have let be late once
    finally:
        desk.lines.plug(3)
    for ca in (3035, 3067, 3155, 3201):
        desk.wait_all_good(ca)


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault", [("noise", 20), ("late", 700), ("wrong-unit",), ("truncate",), ("echo",), ("delay", 100)]
)
def test_disturbed_line_never_gives_a_wrong_value(desk: Desk, fault: tuple[Any, ...]) -> None:
    """Whatever the device does, a value is either what one of its registers held or invalid."""
    since = desk.master.mark()
    begin = time.monotonic()
    desk.lines.fault(DEVICE, *fault, count=30)
    expected = {report.ioa: int(report.value) for report in desk.master.interrogate(STATION)}
    while time.monotonic() - begin < 3.0:
        for report in desk.master.interrogate(STATION):
            assert int(report.value) == expected[report.ioa] or not report.good
    desk.lines.fault(DEVICE, "clear")
    desk.wait_all_good(STATION)
    wrong = [
        r
        for r in desk.master.reports_since(since)
        if r.ca == STATION and r.good and r.value != expected[r.ioa]
    ]
    assert not wrong


# ---- the clock --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_clock_synchronisation_leaves_the_systems_clock_alone(desk: Desk) -> None:
    before = time.time() - time.monotonic()
    desk.master.synchronise_clock(STATION)
    assert math.isclose(time.time() - time.monotonic(), before, abs_tol=0.05)
