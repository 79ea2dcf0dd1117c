# SPDX-License-Identifier: GPL-3.0-or-later
"""Functions beside commands and station interrogation, octet by octet."""

import copy
import itertools
import os
import signal
import struct
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import c104
import pytest

from lab.gateway import GatewayError
from lab.raw_master import Asdu, RawMaster, StationError
from lab.show import DEVICE, STATION
from rig.desk import Desk, Substation, chapter_5, desk_of, of_port, substation_of

C_SC_TA, C_CI, C_CS = 58, 101, 103
M_SP, M_IT, M_ME_TE, M_IT_TB = 1, 15, 35, 37
BACKGROUND, SPONTANEOUS, REQUEST, ACT_CON, ACT_TERM = 2, 3, 5, 7, 10
COUNTERS, NEGATIVE = 37, 0x40
CARRY, ADJUSTED, INVALID = 0x20, 0x40, 0x80
READ, FREEZE, FREEZE_RESET, RESET = 0x00, 0x40, 0x80, 0xC0
GENERAL = 5
METER, METER_CA = "2.20", 2020
IMPORTED, EXPORTED, BY_ITSELF = 30009, 30011, 40005
PERIOD_S = 2


def with_functions() -> dict[str, Any]:
    """Chapter 5's gateway with counters in groups, one that freezes by itself, and a background scan."""
    config = copy.deepcopy(chapter_5())
    meter = of_port(config, 2)["slaves"][0]
    imported, exported = (o for o in meter["input_registers"] if o["type"] == "counter")
    imported["counter_group"], exported["counter_group"] = 1, 4
    next(o for o in meter["holding_registers"] if o["type"] == "counter")["freeze_s"] = PERIOD_S
    meter["discrete_inputs"][0]["background_ms"] = 500
    return config


@pytest.fixture(scope="module")
def desk(programs: Path) -> Iterator[Desk]:
    with desk_of(with_functions(), programs) as desk:
        yield desk


@pytest.fixture
def master(desk: Desk) -> Iterator[RawMaster]:
    with RawMaster(*desk.gateway.address) as master:
        yield master


# ---- integrated totals ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Reading:
    """A BCR (IEC 60870-5-101, 7.2.6.9)."""

    value: int
    detail: int

    @classmethod
    def parse(cls, element: bytes) -> Self:
        return cls(*struct.unpack("<iB", element[:5]))

    @property
    def sequence(self) -> int:
        return self.detail & 0x1F


def readings(asdu: Asdu) -> dict[int, Reading]:
    """An M_IT_NA_1's objects by address."""
    step = 5 if asdu.sequence else 8
    first = int.from_bytes(asdu.body[:3], "little")
    found = {}
    for index in range(asdu.count):
        begin = index * step
        ioa = first + index if asdu.sequence else int.from_bytes(asdu.body[begin : begin + 3], "little")
        found[ioa] = Reading.parse(asdu.body[begin + 3 :][:5])
    return found


def count_to(desk: Desk, address: int, value: int) -> None:
    words = [value >> 16 & 0xFFFF, value & 0xFFFF]
    desk.set_and_scan(METER, "input_registers", address, words if address == 8 else words[::-1])
    desk.wait_scan(METER)


def causes(master: RawMaster, count: int = 2) -> list[int]:
    return [master.answer(C_CI).cause for _ in range(count)]


def command(master: RawMaster, qualifier: int, ca: int = METER_CA) -> list[int]:
    master.request(C_CI, ca, 0, bytes([qualifier]))
    return causes(master)


def read_totals(master: RawMaster, request: int = GENERAL) -> dict[int, Reading]:
    """Confirmation, readings, termination, in this order."""
    master.request(C_CI, METER_CA, 0, bytes([READ | request]), originator=5)
    confirmation = master.answer(C_CI)
    assert (confirmation.cause, confirmation.originator, confirmation.body) == (
        ACT_CON,
        5,
        bytes([0, 0, 0, request]),
    )
    found: dict[int, Reading] = {}
    cause = COUNTERS + request % GENERAL
    while True:
        asdu = master.answer_of({C_CI, M_IT})
        assert asdu.originator == 5
        if asdu.type == C_CI:
            assert asdu.cause == ACT_TERM
            return found
        assert asdu.cause == cause
        found |= readings(asdu)


def test_freeze_and_read(desk: Desk, master: RawMaster) -> None:
    count_to(desk, 8, 70_000)
    assert command(master, FREEZE | GENERAL) == [ACT_CON, ACT_TERM]
    before = read_totals(master)
    assert before[IMPORTED].value == 70_000
    count_to(desk, 8, 70_123)
    assert read_totals(master)[IMPORTED] == before[IMPORTED]  # as it was frozen
    assert command(master, FREEZE | GENERAL) == [ACT_CON, ACT_TERM]
    after = read_totals(master)[IMPORTED]
    assert after == Reading(70_123, (before[IMPORTED].sequence + 1) % 32)


def test_reset_leaves_the_device_alone(desk: Desk, master: RawMaster) -> None:
    count_to(desk, 8, 80_000)
    assert command(master, FREEZE | GENERAL) == [ACT_CON, ACT_TERM]
    mark = desk.lines.mark()
    assert command(master, FREEZE_RESET | GENERAL) == [ACT_CON, ACT_TERM]
    assert read_totals(master)[IMPORTED].value == 80_000
    count_to(desk, 8, 80_040)
    assert command(master, RESET | GENERAL) == [ACT_CON, ACT_TERM]
    count_to(desk, 8, 80_042)
    assert command(master, FREEZE | GENERAL) == [ACT_CON, ACT_TERM]
    reading = read_totals(master)[IMPORTED]
    assert (reading.value, reading.detail & ~0x1F) == (2, ADJUSTED)
    assert not [f for f in desk.lines.frames(mark) if f.kind == "received" and f.bytes[1] in (6, 16)]
    assert desk.lines.get(METER, "input_registers", 9) == 80_042 & 0xFFFF


@pytest.mark.slow
def test_overflow_is_carried(desk: Desk, master: RawMaster) -> None:
    count_to(desk, 10, 0xFFFF_FFFE)
    assert command(master, FREEZE_RESET | GENERAL) == [ACT_CON, ACT_TERM]  # CA of the fall is read with it
    count_to(desk, 10, 1)
    assert command(master, FREEZE | GENERAL) == [ACT_CON, ACT_TERM]
    assert read_totals(master)[EXPORTED].detail & ~0x1F == 0  # the device's overflow, not the reading's
    assert read_totals(master)[EXPORTED].value == 3
    count_to(desk, 10, 0xFFFF_0000)  # nearer behind than ahead: another device, and the reading is its own
    assert command(master, FREEZE | GENERAL) == [ACT_CON, ACT_TERM]
    assert read_totals(master)[EXPORTED].detail & ~0x1F == ADJUSTED
    count_to(desk, 10, 7)
    assert command(master, FREEZE | GENERAL) == [ACT_CON, ACT_TERM]
    reading = read_totals(master)[EXPORTED]
    assert (reading.value, reading.detail & ~0x1F) == (7, CARRY)


def test_rtuctl_shows_the_total(desk: Desk, master: RawMaster) -> None:
    assert command(master, FREEZE | GENERAL) == [ACT_CON, ACT_TERM]
    reading = read_totals(master)[IMPORTED]
    text = desk.gateway.ctl("show", "meter.active-energy-imported")
    lines = dict(line.split(maxsplit=1) for line in text.splitlines())
    assert (lines["frozen"], lines["sequence"]) == (str(reading.value), str(reading.sequence))
    assert (lines["frozen_quality"], lines["carry"]) == ("good", "false")
    with pytest.raises(GatewayError, match="there is no point"):
        desk.gateway.ctl("show", "meter.nothing")


def test_groups(master: RawMaster) -> None:
    assert set(read_totals(master, 1)) == {IMPORTED}
    assert set(read_totals(master, 2)) == set()
    assert set(read_totals(master, 4)) == {EXPORTED}
    assert set(read_totals(master)) == {IMPORTED, EXPORTED, BY_ITSELF}
    before = read_totals(master)
    assert command(master, FREEZE | 4) == [ACT_CON, ACT_TERM]
    after = read_totals(master)
    assert after[IMPORTED] == before[IMPORTED]
    assert after[EXPORTED].sequence == (before[EXPORTED].sequence + 1) % 32


@pytest.mark.parametrize("qualifier", [0, 6, 63, FREEZE, FREEZE | 6])
def test_reserved_request_is_refused(master: RawMaster, qualifier: int) -> None:
    master.request(C_CI, METER_CA, 0, bytes([qualifier]))
    assert master.answer(C_CI).cause == ACT_CON | NEGATIVE


def test_all_stations_freeze(desk: Desk, master: RawMaster) -> None:
    before = read_totals(master)
    master.request(C_CI, 65535, 0, bytes([FREEZE | GENERAL]))
    stations = {point["ca"] for point in desk.gateway.points().values()}
    answers = [master.answer(C_CI) for _ in range(2 * len(stations))]
    assert {a.ca for a in answers if a.cause == ACT_CON} == stations
    assert {a.ca for a in answers if a.cause == ACT_TERM} == stations
    assert read_totals(master)[IMPORTED].sequence == (before[IMPORTED].sequence + 1) % 32


@pytest.mark.slow
def test_c104_reads_and_freezes(desk: Desk, master: RawMaster) -> None:
    before = read_totals(master)
    assert desk.master.interrogate_counters(METER_CA, c104.Frz.FREEZE_WITHOUT_RESET) == []
    after = read_totals(master)
    assert after[IMPORTED].sequence == (before[IMPORTED].sequence + 1) % 32
    reports = desk.master.interrogate_counters(METER_CA)
    assert {(r.ioa, r.value) for r in reports if r.ioa != BY_ITSELF} == {
        (ioa, reading.value) for ioa, reading in after.items() if ioa != BY_ITSELF
    }


def kill_and_wait(desk: Desk, module: str) -> None:
    restarts = desk.gateway.modules()[module]["restarts"]
    desk.gateway.kill(module)
    desk.gateway.wait_for(
        lambda: (
            (now := desk.gateway.modules()[module])["restarts"] == restarts + 1 and now["state"] == "running"
        ),
        10.0,
        f"{module} is back",
    )


@pytest.mark.slow
@pytest.mark.parametrize("module", ["rtu-modbus-1", "rtu-iec104"])
def test_totals_survive_a_kill(desk: Desk, module: str) -> None:
    count_to(desk, 8, 90_000)
    with RawMaster(*desk.gateway.address) as master:
        assert command(master, FREEZE_RESET | GENERAL) == [ACT_CON, ACT_TERM]
        before = read_totals(master)
    kill_and_wait(desk, module)
    desk.wait_all_good(METER_CA)
    count_to(desk, 8, 90_011)
    with RawMaster(*desk.gateway.address) as master:
        assert read_totals(master)[IMPORTED] == before[IMPORTED]
        assert command(master, FREEZE | GENERAL) == [ACT_CON, ACT_TERM]
        assert read_totals(master)[IMPORTED] == Reading(11, (before[IMPORTED].sequence + 1) % 32)


@pytest.mark.slow
def test_freeze_without_the_owner_is_negative(desk: Desk, master: RawMaster) -> None:
    before = read_totals(master)
    pid = desk.gateway.modules()["rtu-modbus-1"]["pid"]
    os.kill(pid, signal.SIGSTOP)
    try:
        desk.gateway.wait_for(
            lambda: not desk.gateway.modules()["rtu-modbus-1"]["alive"], 60.0, "the lines are silent"
        )
        master.request(C_CI, METER_CA, 0, bytes([FREEZE | GENERAL]))
        assert master.answer(C_CI).cause == ACT_CON | NEGATIVE
    finally:
        os.kill(pid, signal.SIGCONT)
    desk.wait_all_good(METER_CA)
    assert read_totals(master)[IMPORTED] == before[IMPORTED]


@pytest.mark.slow
def test_counter_that_freezes_by_itself(desk: Desk, master: RawMaster) -> None:
    desk.set_and_scan(METER, "holding_registers", 4, [0, 4711])
    frozen = []
    while len(frozen) < 3:
        asdu = master.answer(M_IT_TB, timeout_s=60.0)
        ioa = int.from_bytes(asdu.body[:3], "little")
        if (asdu.ca, ioa) == (METER_CA, BY_ITSELF):
            assert asdu.cause == SPONTANEOUS
            frozen.append((asdu.arrived_ns / 1e9, Reading.parse(asdu.body[3:])))
    assert frozen[-1][1].value == 4711
    assert [(b[1].sequence - a[1].sequence) % 32 for a, b in itertools.pairwise(frozen)] == [1, 1]
    assert frozen[2][0] - frozen[0][0] == pytest.approx(2 * PERIOD_S, abs=1.2)
    wall = time.time() - time.monotonic() + frozen[2][0]
    assert (wall % PERIOD_S) < 1.2  # at multiples of the wall time


# ---- parameters of measured values ------------------------------------------------------------------

P_ME_NB, P_ME_NC, P_AC = 111, 112, 113
THRESHOLD, SMOOTHING, LOW_LIMIT, HIGH_LIMIT = 1, 2, 3, 4
ACTIVATION, DEACTIVATION, DEACT_CON = 6, 8, 9
LEVEL = 30002  # of the device of figure 5.3, a scaled value without a deadband


def point_at(desk: Desk, ca: int, ioa: int) -> str:
    return next(n for n, p in desk.gateway.points().items() if (p["ca"], p["ioa"]) == (ca, ioa))


def shown(desk: Desk, ca: int, ioa: int) -> dict[str, Any]:
    found: dict[str, Any] = desk.gateway.query("show", point_at(desk, ca, ioa))
    return found


def load_scaled(master: RawMaster, kind: int, value: int) -> int:
    master.request(P_ME_NB, STATION, LEVEL, struct.pack("<hB", value, kind), originator=9)
    answer = master.answer(P_ME_NB)
    assert (answer.originator, answer.body[3:]) == (9, struct.pack("<hB", value, kind))
    return answer.cause


def reported_levels(desk: Desk, master: RawMaster, values: list[int]) -> list[int]:
    """Which of these values the station reports spontaneously, when the device has them one after another."""
    marker = values[-1] % 1000 + 1  # of another point, whose change comes behind them
    for value in values:
        desk.set_and_scan(DEVICE, "input_registers", 1, [value])
    desk.wait_scan(DEVICE)
    desk.set_and_scan(DEVICE, "input_registers", 2, [marker])
    deadline, found = time.monotonic() + 60, []
    while True:
        for report in master.spontaneous(deadline):
            if (report.ca, report.ioa) == (STATION, LEVEL):
                found.append(report.value)
            elif (report.ca, report.ioa, report.value) == (STATION, LEVEL + 1, marker):
                return found


@pytest.mark.slow
def test_threshold_and_limits(desk: Desk, master: RawMaster) -> None:
    assert load_scaled(master, THRESHOLD, 10) == ACT_CON
    assert reported_levels(desk, master, [2000, 2005, 2010, 2011, 2003]) == [2000, 2011]
    assert load_scaled(master, HIGH_LIMIT, 2015) == ACT_CON
    assert reported_levels(desk, master, [2014, 2015, 2016, 2017, 2012]) == [2016, 2012]
    now = shown(desk, STATION, LEVEL)
    assert (now["threshold"], now["low_limit"], now["high_limit"]) == (10, None, 2015)
    assert now["loaded"] == ["threshold", "high_limit"]
    assert load_scaled(master, LOW_LIMIT, 2016) == ACT_CON | NEGATIVE  # above the high one
    assert load_scaled(master, THRESHOLD, -1) == ACT_CON | NEGATIVE
    assert load_scaled(master, HIGH_LIMIT, 32767) == ACT_CON
    assert load_scaled(master, THRESHOLD, 0) == ACT_CON


@pytest.mark.slow
def test_smoothing(desk: Desk, master: RawMaster) -> None:
    desk.set_and_scan(DEVICE, "input_registers", 1, [0])
    assert load_scaled(master, SMOOTHING, 5) == ACT_CON  # half a second
    name = point_at(desk, STATION, LEVEL)
    desk.wait_scan(DEVICE)
    began = time.monotonic()
    desk.set_and_scan(DEVICE, "input_registers", 1, [10_000])
    seen = [desk.gateway.points(name)[name]["value"]]
    while seen[-1] < 9_900:
        assert time.monotonic() - began < 15
        seen.append(desk.gateway.points(name)[name]["value"])
    assert time.monotonic() - began > 1.0  # 4.6 time constants; a fraction of it, for slow scans
    assert seen == sorted(seen)
    assert len(set(seen)) > 3
    assert load_scaled(master, SMOOTHING, 0) == ACT_CON
    desk.set_and_scan(DEVICE, "input_registers", 1, [77])
    desk.gateway.wait_for(lambda: desk.gateway.points(name)[name]["value"] == 77, 60.0, "no smoothing")


@pytest.mark.parametrize("module", ["rtu-modbus-1", "rtu-iec104"])
def test_parameters_survive_a_kill_and_are_interrogated(desk: Desk, module: str) -> None:
    with RawMaster(*desk.gateway.address) as master:
        assert load_scaled(master, THRESHOLD, 33) == ACT_CON
    kill_and_wait(desk, module)
    desk.wait_all_good(STATION)
    assert shown(desk, STATION, LEVEL)["threshold"] == 33
    with RawMaster(*desk.gateway.address) as master:
        master.request(100, STATION, 0, b"\x14", originator=3)
        asdus = [master.answer_of({100, 1, 11, P_ME_NB}) for _ in range(7)]
        assert [a.type for a in asdus] == [100, 1, 1, 11, 11, P_ME_NB, 100]
        assert (asdus[5].cause, asdus[5].originator) == (20, 3)
        kinds = {asdus[5].body[i + 5]: asdus[5].body[i : i + 5] for i in range(0, len(asdus[5].body), 6)}
        assert kinds[THRESHOLD] == LEVEL.to_bytes(3, "little") + struct.pack("<h", 33)
        assert load_scaled(master, THRESHOLD, 0) == ACT_CON


@pytest.mark.slow
def test_cyclic_transmission_is_stopped_and_started(desk: Desk, master: RawMaster) -> None:
    cyclic = 30015  # meter.active-power-in-kw, each second
    assert master.answer(13, timeout_s=5).cause == 1
    master.request(P_AC, METER_CA, cyclic, b"\x03", cause=DEACTIVATION)
    assert master.answer(P_AC).cause == DEACT_CON
    with pytest.raises(StationError, match="answer of type 13"):
        master.answer(13, timeout_s=2.5)
    assert shown(desk, METER_CA, cyclic)["cyclic"] is False
    master.request(P_AC, METER_CA, cyclic, b"\x03", cause=ACTIVATION)
    assert master.answer(P_AC).cause == ACT_CON
    assert master.answer(13, timeout_s=5).cause == 1
    master.request(P_AC, METER_CA, IMPORTED, b"\x03", cause=ACTIVATION)
    assert master.answer(P_AC).cause == 47 | NEGATIVE


@pytest.mark.parametrize("bits", ["nan", "inf", "-inf"])
def test_threshold_that_is_no_number_is_refused(master: RawMaster, bits: str) -> None:
    master.request(P_ME_NC, METER_CA, 30001, struct.pack("<fB", float(bits), THRESHOLD))
    assert master.answer(P_ME_NC).cause == ACT_CON | NEGATIVE


# ---- time zone --------------------------------------------------------------------------------------

SU = 0x80  # of the hour's octet


@pytest.fixture(scope="module")
def berlin(programs: Path) -> Iterator[Substation]:
    config = chapter_5() | {"timezone": "CET-1CEST,M3.5.0,M10.5.0/3"}
    with substation_of(config, programs) as substation:
        yield substation


def local(year: int, month: int, day: int, hour: int, minute: int, *, summer: bool) -> bytes:
    """CP56Time2a, without the day of the week."""
    return bytes([0, 0, minute, hour | (SU if summer else 0), day, month, year - 2000])


WINTER = local(2035, 2, 28, 23, 10, summer=False)
SUMMER = local(2035, 7, 15, 12, 10, summer=True)
FIRST_TWO = local(2035, 10, 28, 2, 10, summer=True)
SECOND_TWO = local(2035, 10, 28, 2, 10, summer=False)


def tag_of_an_event(substation: Substation, master: RawMaster, value: int) -> bytes:
    substation.set_and_scan(DEVICE, "input_registers", 1, [value])
    while True:
        asdu = master.answer(M_ME_TE)
        objects = [asdu.body[i : i + 13] for i in range(0, len(asdu.body), 13)]
        for element in objects:
            if element[:5] == (30002).to_bytes(3, "little") + value.to_bytes(2, "little"):
                return element[-7:]


@pytest.mark.slow
def test_time_tags_are_of_the_zone(berlin: Substation) -> None:
    with RawMaster(*berlin.gateway.address) as master:
        for value, when in enumerate((WINTER, SUMMER, FIRST_TWO, SECOND_TWO), 4001):
            master.request(C_CS, STATION, 0, when)
            confirmation = master.answer(C_CS)
            assert confirmation.cause == ACT_CON
            assert confirmation.body[3 + 3 :] == when[3:]
            tag = tag_of_an_event(berlin, master, value)
            assert tag[3:] == when[3:]  # the same hour, SU and date
            assert when[2] <= tag[2] <= when[2] + 1


@pytest.mark.parametrize(
    "octets",
    [
        pytest.param(local(2035, 2, 28, 23, 10, summer=True), id="summer time in winter"),
        pytest.param(local(2035, 7, 15, 12, 10, summer=False), id="winter time in summer"),
        pytest.param(local(2035, 3, 25, 2, 30, summer=False), id="left out"),
        pytest.param(local(2035, 3, 25, 2, 30, summer=True), id="left out, as summer time"),
    ],
)
def test_wrong_summer_bit_is_refused(berlin: Substation, octets: bytes) -> None:
    with RawMaster(*berlin.gateway.address) as master:
        master.request(C_CS, STATION, 0, octets)
        refusal = master.answer(C_CS)
        assert (refusal.cause, refusal.body[3:]) == (ACT_CON | NEGATIVE, octets)


def test_commands_are_dated_in_the_zone(berlin: Substation) -> None:
    with RawMaster(*berlin.gateway.address) as master:
        master.request(C_CS, STATION, 0, SUMMER)
        assert master.answer(C_CS).cause == ACT_CON
        wrong_bit = local(2035, 7, 15, 12, 10, summer=False)
        in_utc = local(2035, 7, 15, 10, 10, summer=False)
        for tag, cause in ((SUMMER, ACT_CON), (wrong_bit, ACT_CON | NEGATIVE), (in_utc, ACT_CON | NEGATIVE)):
            master.request(C_SC_TA, STATION, 4, b"\x01" + tag)
            assert master.answer(C_SC_TA).cause == cause
            if cause == ACT_CON:
                assert master.answer(C_SC_TA).cause == ACT_TERM


def test_log_says_why_and_what_takes_it(berlin: Substation) -> None:
    """A control centre that leaves the bit 0 is refused all summer."""
    with RawMaster(*berlin.gateway.address) as master:
        master.request(C_CS, STATION, 0, local(2035, 7, 15, 12, 10, summer=False))
        assert master.answer(C_CS).cause == ACT_CON | NEGATIVE
    assert "refuses a time: its bit SU is not that of timezone; see ignore_summer_bit" in berlin.gateway.log()


@pytest.mark.slow
def test_a_master_without_the_summer_bit_is_taken_by_its_key(programs: Path) -> None:
    """In the hour that comes twice, the time is the one that is nearer to the gateway's clock."""
    config = chapter_5() | {"timezone": "CET-1CEST,M3.5.0,M10.5.0/3", "iec104": {"ignore_summer_bit": True}}
    with substation_of(config, programs) as substation, RawMaster(*substation.gateway.address) as master:

        def set_clock(when: bytes) -> None:
            master.request(C_CS, STATION, 0, when)
            assert master.answer(C_CS).cause == ACT_CON

        july = local(2035, 7, 15, 12, 10, summer=False)
        set_clock(july)
        master.request(C_SC_TA, STATION, 4, b"\x01" + july)
        assert [master.answer(C_SC_TA).cause for _ in range(2)] == [ACT_CON, ACT_TERM]
        assert tag_of_an_event(substation, master, 4001)[3] == 12 | SU
        set_clock(local(2035, 10, 28, 1, 50, summer=False))
        set_clock(local(2035, 10, 28, 2, 10, summer=False))
        assert tag_of_an_event(substation, master, 4002)[3] == 2 | SU
        set_clock(local(2035, 10, 28, 3, 5, summer=False))
        set_clock(local(2035, 10, 28, 2, 50, summer=False))
        assert tag_of_an_event(substation, master, 4003)[3] == 2


def test_utc_knows_no_summer_time(master: RawMaster) -> None:
    master.request(C_CS, METER_CA, 0, SUMMER)
    assert master.answer(C_CS).cause == ACT_CON | NEGATIVE


# ---- end of initialisation, reset -------------------------------------------------------------------

M_EI, C_RP = 70, 105
INITIALISED = 4
POWER_ON, REMOTE_RESET = 0, 2
RESET_PROCESS, RESET_EVENTS = b"\x01", b"\x02"


@pytest.fixture
def fresh(programs: Path) -> Iterator[Substation]:
    """A gateway that nobody has connected to."""
    with substation_of(chapter_5(), programs) as substation:
        yield substation


def assert_initialised(master: RawMaster, stations: set[int], cause: int) -> None:
    ends = [master.answer(M_EI) for _ in stations]
    assert {end.ca for end in ends} == stations
    assert {(end.cause, end.originator, end.body) for end in ends} == {
        (INITIALISED, 0, bytes([0, 0, 0, cause]))
    }


@pytest.mark.slow
def test_end_of_initialisation_and_reset(fresh: Substation) -> None:
    gateway = fresh.gateway
    stations = {point["ca"] for point in gateway.points().values()}
    with RawMaster(*gateway.address) as master:
        assert_initialised(master, stations, POWER_ON)
    gateway.kill("rtu-iec104")
    gateway.wait_for(
        lambda: (now := gateway.modules()["rtu-iec104"])["restarts"] == 1 and now["state"] == "running",
        10.0,
        "the station is back",
    )
    with RawMaster(*gateway.address) as master:
        before = gateway.modules()
        with pytest.raises(StationError, match="answer of type 70"):
            master.answer(M_EI, timeout_s=0.5)  # nothing was initialised
        master.request(C_RP, STATION, 0, RESET_PROCESS, originator=8)
        confirmation = master.answer(C_RP)
        assert (confirmation.cause, confirmation.originator, confirmation.ca) == (ACT_CON, 8, STATION)
        with pytest.raises(StationError, match="closed the connection"):
            master.answer(C_RP, timeout_s=5)
    gateway.wait_for(
        lambda: all(
            (now := gateway.modules()[name])["pid"] != before[name]["pid"] and now["state"] == "running"
            for name in ("rtu-iec104", "rtu-modbus-1", "rtu-modbus-2")
        ),
        10.0,
        "all modules run again",
    )
    after = gateway.modules()
    assert {name: after[name]["restarts"] for name in after} == {
        name: before[name]["restarts"] for name in before
    }  # none has failed
    assert after["rtud"]["pid"] == before["rtud"]["pid"]
    with RawMaster(*gateway.address) as master:
        assert_initialised(master, stations, REMOTE_RESET)
        master.request(C_RP, STATION, 0, RESET_PROCESS)
        assert master.answer(C_RP).cause == ACT_CON | NEGATIVE  # so soon
        assert len(master.interrogate(STATION).objects) == 13
        for ca in stations - {1000}:  # which is only written
            fresh.wait_all_good(ca)


@pytest.mark.slow
def test_reset_with_another_qualifier_is_refused(master: RawMaster) -> None:
    for qualifier in (0, 3, 255):
        master.request(C_RP, STATION, 0, bytes([qualifier]))
        assert master.answer(C_RP).cause == ACT_CON | NEGATIVE
    master.request(C_RP, STATION, 0, RESET_EVENTS)  # would take other stations' events with it
    assert master.answer(C_RP).cause == ACT_CON | NEGATIVE


@pytest.mark.slow
def test_waiting_events_are_dropped(desk: Desk) -> None:
    k = 12
    with RawMaster(*desk.gateway.address) as master:
        stations = {point["ca"] for point in desk.gateway.points().values()}
        master.request(C_RP, 65535, 0, RESET_EVENTS)
        confirmations = [master.answer(C_RP) for _ in stations]
        assert {(c.ca, c.cause) for c in confirmations} == {(ca, ACT_CON) for ca in stations}
        # Nobody acknowledges: what is beyond k waits.
        for value in range(k + 5):
            desk.set_and_scan(DEVICE, "input_registers", 1, [5000 + value])
        desk.wait_scan(DEVICE)
        master.request(C_RP, 65535, 0, RESET_EVENTS)
        desk.wait_scan(DEVICE)
        levels = []
        while (asdu := master.answer_of({C_RP, M_ME_TE})).type != C_RP:
            levels += [v for v in range(5000, 5000 + k + 5) if v.to_bytes(2, "little") == asdu.body[3:5]]
        assert 5000 + k + 4 not in levels
        for _ in range(len(stations) - 1):
            assert master.answer(C_RP).cause == ACT_CON
        with pytest.raises(StationError):
            master.answer(M_ME_TE, timeout_s=0.5)
        desk.set_and_scan(DEVICE, "input_registers", 1, [6000])
        assert (6000).to_bytes(2, "little") == master.answer(M_ME_TE).body[3:5]


# ---- tshark -----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_tshark_finds_nothing_malformed(desk: Desk, master: RawMaster, tmp_path: Path) -> None:
    """One of each of these types, as an independent dissector reads them."""
    kinds = [C_CI, M_IT, M_IT_TB, P_ME_NB, P_AC, C_RP, M_SP]
    assert command(master, FREEZE | GENERAL) == [ACT_CON, ACT_TERM]
    seen: list[Asdu] = []
    master.request(C_CI, METER_CA, 0, bytes([GENERAL]))
    seen += [master.answer_of({C_CI}), master.answer_of({M_IT}), master.answer_of({C_CI})]
    seen.append(master.answer(M_IT_TB, timeout_s=60.0))
    master.request(P_ME_NB, STATION, LEVEL, struct.pack("<hB", 0, THRESHOLD))
    seen.append(master.answer(P_ME_NB))
    master.request(P_AC, METER_CA, 30015, b"\x03")
    seen.append(master.answer(P_AC))
    master.request(C_RP, 65535, 0, RESET_EVENTS)
    seen.append(master.answer(C_RP))
    seen.append(master.answer(M_SP, timeout_s=5))
    dump = "\n".join("000000 " + apdu(asdu).hex(" ") for asdu in seen)
    pcap = tmp_path / "functions.pcap"
    subprocess.run(["text2pcap", "-q", "-T", "2404,40000", "-", pcap], input=dump, text=True, check=True)
    fields = ["-e", "iec60870_asdu.typeid", "-e", "_ws.malformed", "-e", "_ws.expert"]
    tshark = ["tshark", "-r", pcap, "-T", "fields", *fields]
    lines = subprocess.run(tshark, capture_output=True, text=True, check=True).stdout.splitlines()
    assert {line.split("\t")[0] for line in lines} == {str(kind) for kind in kinds}
    assert not [line for line in lines if "".join(line.split("\t")[1:])]


def apdu(asdu: Asdu) -> bytes:
    """An I frame with this ASDU."""
    number = asdu.count | (0x80 if asdu.sequence else 0)
    head = bytes([asdu.type, number, asdu.cause, asdu.originator]) + asdu.ca.to_bytes(2, "little")
    return bytes([0x68, 4 + len(head) + len(asdu.body), 0, 0, 0, 0]) + head + asdu.body


# ---- background scan --------------------------------------------------------------------------------


@pytest.mark.slow
def test_background_scan(desk: Desk, master: RawMaster) -> None:
    arrived = []
    while len(arrived) < 3:
        asdu = master.answer(M_SP, timeout_s=5.0)
        assert (asdu.cause, asdu.originator, asdu.ca) == (BACKGROUND, 0, METER_CA)
        assert asdu.body[:3] == (10001).to_bytes(3, "little")
        arrived.append(asdu.arrived_ns / 1e9)
    assert arrived[2] - arrived[1] == pytest.approx(0.5, abs=0.4)
