# SPDX-License-Identifier: GPL-3.0-or-later
"""Several devices with one common address: what is addressed by CA works across devices, lines, processes."""

import os
import signal
import struct
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import c104
import pytest

from lab.linesim import Frame
from lab.raw_master import Asdu, RawMaster
from rig.desk import Desk, desk_of, substation_of

CA, OTHER = 77, 78
STEP = 100  # from a device's addresses to the next one's
# In the order of the file: another station between those of CA 77, which are of two lines and processes.
DEVICES = {"1.5": CA, "1.6": OTHER, "1.7": CA, "2.8": CA, "2.9": OTHER}
SHARED = [device for device, ca in DEVICES.items() if ca == CA]
DOOR, LEVEL, TOTAL, LAMP, SETPOINT = 10001, 30001, 30003, 1, 40001
MEASURED = (DOOR, LEVEL, LAMP, SETPOINT)  # what a general interrogation brings
OF_GROUP = {1: DOOR, 2: LEVEL}
C_SC, C_SE_NB, M_EI, C_IC, C_CI, C_RD, P_AC = 45, 49, 70, 100, 101, 102, 113
P_ME_NA, P_ME_NB, P_ME_NC = 110, 111, 112
M_SP, M_ME_NB, M_IT = 1, 11, 15
REQUEST, ACT, ACT_CON, DEACT, DEACT_CON, ACT_TERM, NEGATIVE = 5, 6, 7, 8, 9, 10, 0x40
INITIALISED, CYCLIC, INTERROGATED, COUNTERS, UNKNOWN_IOA = 4, 1, 20, 37, 47
FREEZE, FREEZE_RESET, RESET, GENERAL = 0x40, 0x80, 0xC0, 5
THRESHOLD, HIGH_LIMIT = 1, 4
SIZES = {M_SP: 1, M_ME_NB: 3, M_IT: 5, P_ME_NA: 3, P_ME_NB: 3, P_ME_NC: 5}
BROADCAST = 65535
RESPONSE_TIMEOUT_MS = 1500  # a busy host does not make a command fail


def offset(device: str) -> int:
    return STEP * list(DEVICES).index(device)


def addresses(ioas: tuple[int, ...], ca: int = CA) -> list[int]:
    return sorted(ioa + offset(device) for device in DEVICES if DEVICES[device] == ca for ioa in ioas)


def configuration() -> dict[str, Any]:
    def slave(device: str) -> dict[str, Any]:
        return {
            "id": int(device[2:]),
            "ca": DEVICES[device],
            "ioa_offset": offset(device),
            "response_timeout_ms": RESPONSE_TIMEOUT_MS,
            "response_timeout_min_ms": RESPONSE_TIMEOUT_MS,
            "probe_max_s": 2,
            "discrete_inputs": [{"address": 0, "group": 1}],
            "input_registers": [
                {"address": 0, "group": 2, "cyclic_ms": 300},
                {"address": 2, "type": "counter", "counter_group": 1 if device == "1.5" else 2},
            ],
            "coils": [{"address": 0}],
            "holding_registers": [{"address": 0, "select": device == "2.8"}],
        }

    pace = {"active": 1, "baud_rate": 38400, "data_bits": 8, "stop_bits": 1, "parity": 0}
    ports = [
        {
            "value": port,
            "process": port,
            **pace,
            "slaves": [slave(device) for device in DEVICES if device.startswith(f"{port}.")],
        }
        for port in (1, 2)
    ]
    return {"iec104": {"connections_per_address": 8}, "port": ports}


@pytest.fixture(scope="module")
def desk(programs: Path) -> Iterator[Desk]:
    with desk_of(configuration(), programs) as desk:
        yield desk


@pytest.fixture
def master(desk: Desk) -> Iterator[RawMaster]:
    with RawMaster(*desk.gateway.address) as master:
        yield master


def objects(asdu: Asdu) -> list[tuple[int, bytes]]:
    """Address and element of each object."""
    size, begin = SIZES[asdu.type], 3
    first = int.from_bytes(asdu.body[:3], "little")
    if asdu.sequence:
        return [(first + i, asdu.body[begin + i * size :][:size]) for i in range(asdu.count)]
    found = [asdu.body[i * (3 + size) :][: 3 + size] for i in range(asdu.count)]
    return [(int.from_bytes(one[:3], "little"), one[3:]) for one in found]


def procedure(
    master: RawMaster, kind: int, qualifier: int, cause: int, parameters: bool = False
) -> list[tuple[int, bytes]]:
    """What a system command for CA 77 brings with this cause, between its one confirmation and its one end.

    With `parameters`, the parameters alone; else all but these.
    """
    master.request(kind, CA, 0, bytes([qualifier]), originator=3)
    found, ends, deadline = [], [], time.monotonic() + 30
    while ACT_TERM not in ends:
        asdu = master.next_asdu(deadline)
        if asdu.type == kind:
            assert asdu.ca == CA
            ends.append(asdu.cause)
        elif asdu.cause == cause:
            assert (ends, asdu.ca, asdu.originator) == ([ACT_CON], CA, 3)
            found += objects(asdu) if (asdu.type in (P_ME_NA, P_ME_NB, P_ME_NC)) == parameters else []
    assert ends == [ACT_CON, ACT_TERM]
    # Whatever else the station had to say of it would come before the answer to this.
    master.request(C_RD, CA, LEVEL, b"", cause=REQUEST)
    while (asdu := master.next_asdu(deadline)).cause != REQUEST:
        assert asdu.type != kind
        assert asdu.cause != cause
    return found


def totals(master: RawMaster, group: int = GENERAL) -> dict[int, tuple[int, int]]:
    """The frozen readings: value and sequence number."""
    found = procedure(master, C_CI, group, COUNTERS + group % GENERAL)
    readings = {ioa: struct.unpack("<iB", element) for ioa, element in found}
    assert len(readings) == len(found)
    return {ioa: (value, detail & 0x1F) for ioa, (value, detail) in readings.items()}


def count(desk: Desk, device: str, value: int) -> None:
    desk.set_and_scan(device, "input_registers", 2, [value >> 16, value & 0xFFFF])
    desk.wait_scan(device)


# ---- interrogations ----------------------------------------------------------------------------------------


def test_a_general_interrogation_brings_each_point_of_all_devices_once(master: RawMaster) -> None:
    found = procedure(master, C_IC, 20, INTERROGATED)
    assert sorted(ioa for ioa, _ in found) == addresses(MEASURED)


@pytest.mark.parametrize("group", [1, 2, 3])
def test_a_group_is_of_all_devices(master: RawMaster, group: int) -> None:
    found = procedure(master, C_IC, 20 + group, INTERROGATED + group)
    expected = addresses((OF_GROUP[group],)) if group in OF_GROUP else []
    assert sorted(ioa for ioa, _ in found) == expected


@pytest.mark.slow
def test_c104_interrogates_all_devices(desk: Desk) -> None:
    assert sorted(report.ioa for report in desk.master.interrogate(CA)) == addresses(MEASURED)
    for group, ioa in OF_GROUP.items():
        assert sorted(report.ioa for report in desk.master.interrogate(CA, group)) == addresses((ioa,))


@pytest.mark.parametrize("kind", [C_IC, C_CI])
def test_a_broadcast_is_confirmed_and_ended_once_by_each_station(master: RawMaster, kind: int) -> None:
    master.request(kind, BROADCAST, 0, bytes([20 if kind == C_IC else GENERAL]))
    heads, seen, deadline = [], Counter[tuple[int, int]](), time.monotonic() + 30
    while len(heads) < 4:
        asdu = master.next_asdu(deadline)
        if asdu.type == kind:
            heads.append((asdu.ca, asdu.cause))
        elif asdu.cause == (INTERROGATED if kind == C_IC else COUNTERS):
            assert heads[-1] == (asdu.ca, ACT_CON)
            seen.update((asdu.ca, ioa) for ioa, _ in objects(asdu))
    assert heads == [(CA, ACT_CON), (CA, ACT_TERM), (OTHER, ACT_CON), (OTHER, ACT_TERM)]
    wanted = MEASURED if kind == C_IC else (TOTAL,)
    assert seen == Counter((ca, ioa) for ca in (CA, OTHER) for ioa in addresses(wanted, ca))


@pytest.mark.slow
def test_c104_interrogates_all_stations(desk: Desk) -> None:
    found = [(report.ca, report.ioa) for report in desk.master.interrogate_all(CA, OTHER)]
    assert sorted(found) == [(ca, ioa) for ca in (CA, OTHER) for ioa in addresses(MEASURED, ca)]


# ---- counters ----------------------------------------------------------------------------------------------


def freeze(master: RawMaster, qualifier: int) -> None:
    assert procedure(master, C_CI, qualifier, COUNTERS) == []


@pytest.mark.slow
def test_a_freeze_is_of_all_devices_and_of_no_other_station(desk: Desk, master: RawMaster) -> None:
    freeze(master, RESET | GENERAL)
    for device in DEVICES:
        count(desk, device, 70_000)
    master.request(C_CI, OTHER, 0, bytes([FREEZE | GENERAL]))
    assert answers(master, C_CI) == [(OTHER, ACT_CON), (OTHER, ACT_TERM)]
    freeze(master, FREEZE_RESET | GENERAL)
    before, others = totals(master), frozen_of(desk, OTHER)
    assert list(before) == addresses((TOTAL,))
    for i, device in enumerate(DEVICES):
        count(desk, device, 70_001 + i)
    assert totals(master) == before  # as they were frozen
    freeze(master, FREEZE | GENERAL)
    assert totals(master) == {
        TOTAL + offset(device): (1 + list(DEVICES).index(device), (sequence + 1) % 32)
        for device, (_, sequence) in zip(SHARED, before.values(), strict=True)
    }
    assert frozen_of(desk, OTHER) == others
    reports = desk.master.interrogate_counters(CA)
    assert {report.ioa: report.value for report in reports} == {
        ioa: value for ioa, (value, _) in totals(master).items()
    }


def frozen_of(desk: Desk, ca: int) -> dict[str, Any]:
    points = {name: point for name, point in desk.gateway.points().items() if point["ca"] == ca}
    counters = [name for name, point in points.items() if point["type"] == "counter"]
    assert counters
    return {
        name: {
            key: value
            for key, value in desk.gateway.query("show", name).items()
            if key in ("frozen", "sequence")
        }
        for name in counters
    }


def test_a_group_of_counters_is_of_the_devices_that_have_it(master: RawMaster) -> None:
    one = TOTAL + offset("1.5")
    assert list(totals(master, 1)) == [one]
    assert list(totals(master, 2)) == [ioa for ioa in addresses((TOTAL,)) if ioa != one]
    before = totals(master)
    freeze(master, FREEZE | 2)
    after = totals(master)
    assert after[one] == before[one]
    assert all(after[ioa][1] == (before[ioa][1] + 1) % 32 for ioa in after if ioa != one)


@pytest.mark.slow
def test_half_a_freeze_is_none(desk: Desk, master: RawMaster) -> None:
    """One of the two processes that the station's counters belong to does not answer."""
    before = totals(master)
    pid = desk.gateway.modules()["rtu-modbus-2"]["pid"]
    os.kill(pid, signal.SIGSTOP)
    try:
        desk.gateway.wait_for(
            lambda: not desk.gateway.modules()["rtu-modbus-2"]["alive"], 60.0, "line 2 is silent"
        )
        master.request(C_CI, CA, 0, bytes([FREEZE | GENERAL]))
        assert master.answer(C_CI).cause == ACT_CON | NEGATIVE
    finally:
        os.kill(pid, signal.SIGCONT)
    desk.wait_all_good(CA)
    assert totals(master) == before


# ---- single objects ----------------------------------------------------------------------------------------


def answers(master: RawMaster, kind: int) -> list[tuple[int, int]]:
    """The causes of a command's answers, with their CA, to its end."""
    found: list[tuple[int, int]] = []
    while not found or (found[-1][1] != ACT_TERM and not found[-1][1] & NEGATIVE):
        asdu = master.answer(kind)
        found.append((asdu.ca, asdu.cause))
    return found


@pytest.mark.parametrize("device", SHARED)
def test_a_command_reaches_its_device_alone(desk: Desk, master: RawMaster, device: str) -> None:
    desk.wait_all_good(CA)
    before = {one: desk.lines.get(one, "coils", 0) for one in DEVICES}
    master.request(C_SC, CA, LAMP + offset(device), bytes([1 - before[device]]))
    assert answers(master, C_SC) == [(CA, ACT_CON), (CA, ACT_TERM)]
    after = {one: desk.lines.get(one, "coils", 0) for one in DEVICES}
    assert after == before | {device: 1 - before[device]}
    assert desk.master.command(CA, LAMP + offset(device), "C_SC_NA_1", c104.SingleCmd(bool(before[device])))
    desk.gateway.wait_for(lambda: desk.lines.get(device, "coils", 0) == before[device], 10.0, "it is back")


def test_a_selection_is_of_one_device(desk: Desk, master: RawMaster) -> None:
    ioa = SETPOINT + offset("2.8")
    master.request(C_SE_NB, CA, ioa, struct.pack("<hB", 55, 0x80))
    assert master.answer(C_SE_NB).cause == ACT_CON
    master.request(C_SE_NB, CA, SETPOINT, struct.pack("<hB", 55, 0))  # that of 1.5 needs none
    assert answers(master, C_SE_NB) == [(CA, ACT_CON), (CA, ACT_TERM)]
    assert desk.lines.get("2.8", "holding_registers", 0) == 0
    master.request(C_SE_NB, CA, ioa, struct.pack("<hB", 55, 0))
    assert answers(master, C_SE_NB) == [(CA, ACT_CON), (CA, ACT_TERM)]
    assert desk.lines.get("2.8", "holding_registers", 0) == 55


def test_an_address_of_another_station_is_unknown(desk: Desk, master: RawMaster) -> None:
    writes = desk.lines.mark()
    master.request(C_SC, CA, LAMP + offset("1.6"), b"\x01")
    assert master.answer(C_SC).cause == UNKNOWN_IOA | NEGATIVE
    master.request(C_RD, CA, LEVEL + offset("1.6"), b"", cause=REQUEST)
    assert master.answer(C_RD).cause == UNKNOWN_IOA | NEGATIVE
    desk.wait_scan("1.6")

    def is_write(frame: Frame) -> bool:
        return frame.kind == "received" and frame.bytes[1] == 5

    assert not [frame for frame in desk.lines.frames(writes) if is_write(frame)]


@pytest.mark.parametrize("device", SHARED)
def test_a_read_brings_the_object_of_its_device(desk: Desk, master: RawMaster, device: str) -> None:
    value = 1000 + offset(device)
    desk.set_and_scan(device, "input_registers", 0, [value])
    desk.wait_scan(device)
    master.request(C_RD, CA, LEVEL + offset(device), b"", cause=REQUEST)
    asdu = next(a for a in iter(lambda: master.answer(M_ME_NB), None) if a.cause == REQUEST)
    assert (asdu.ca, objects(asdu)) == (CA, [(LEVEL + offset(device), struct.pack("<hB", value, 0))])


# ---- parameters --------------------------------------------------------------------------------------------


def load(master: RawMaster, device: str, kind: int, value: int) -> int:
    master.request(P_ME_NB, CA, LEVEL + offset(device), struct.pack("<hB", value, kind))
    return master.answer(P_ME_NB).cause


def loaded(desk: Desk) -> dict[str, list[str]]:
    points = desk.gateway.points()
    names = {(point["ca"], point["ioa"]): name for name, point in points.items()}
    return {
        device: desk.gateway.query("show", names[ca, LEVEL + offset(device)])["loaded"]
        for device, ca in DEVICES.items()
    }


def test_parameters_are_of_one_device_and_interrogated_of_all(desk: Desk, master: RawMaster) -> None:
    for i, device in enumerate(SHARED):
        assert load(master, device, THRESHOLD, 10 + i) == ACT_CON
    assert load(master, "2.8", HIGH_LIMIT, 30_000) == ACT_CON
    assert {device: kinds for device, kinds in loaded(desk).items() if kinds} == {
        "1.5": ["threshold"],
        "1.7": ["threshold"],
        "2.8": ["threshold", "high_limit"],
    }
    master.request(P_ME_NB, OTHER, LEVEL + offset("1.6"), struct.pack("<hB", 99, THRESHOLD))
    assert master.answer(P_ME_NB).cause == ACT_CON
    found = procedure(master, C_IC, 20, INTERROGATED, parameters=True)
    assert sorted((ioa, *struct.unpack("<hB", element)) for ioa, element in found) == sorted(
        [(LEVEL + offset(device), 10 + i, THRESHOLD) for i, device in enumerate(SHARED)]
        + [(LEVEL + offset("2.8"), 30_000, HIGH_LIMIT)]
    )
    for device in SHARED:
        assert load(master, device, THRESHOLD, 0) == ACT_CON


@pytest.mark.slow
def test_parameters_of_the_other_types_are_of_one_device_as_well(programs: Path) -> None:
    """Of normalized and float values, which the devices above do not have."""
    config = configuration()
    for slave in (slave for port in config["port"] for slave in port["slaves"]):
        slave["input_registers"] = [{"address": 0, "type": "normalized"}, {"address": 2, "type": "float"}]
    kinds = ((P_ME_NA, LEVEL, "<hB", P_ME_NC), (P_ME_NC, LEVEL + 2, "<fB", P_ME_NA))
    with desk_of(config, programs) as desk, RawMaster(*desk.gateway.address) as master:

        def threshold(kind: int, ioa: int, element: bytes) -> int:
            master.request(kind, CA, ioa, element)
            answer = master.answer(kind)
            assert (answer.ca, answer.body) == (CA, ioa.to_bytes(3, "little") + element)
            return answer.cause

        wanted = []
        for kind, at, layout, wrong in kinds:
            for i, device in enumerate(SHARED):
                ioa, element = at + offset(device), struct.pack(layout, 5 + i, THRESHOLD)
                assert threshold(kind, ioa, element) == ACT_CON
                wanted.append((ioa, element))
                refused = struct.pack("<fB" if wrong == P_ME_NC else "<hB", 1, THRESHOLD)
                assert threshold(wrong, ioa, refused) == UNKNOWN_IOA | NEGATIVE
            assert threshold(kind, at + offset("1.6"), element) == UNKNOWN_IOA | NEGATIVE
        assert sorted(procedure(master, C_IC, 20, INTERROGATED, parameters=True)) == sorted(wanted)
        loaded = [
            point["ca"]
            for name, point in desk.gateway.points().items()
            if desk.gateway.query("show", name).get("loaded")
        ]
        assert loaded == [CA] * len(wanted)


@pytest.mark.slow
def test_cyclic_transmission_is_stopped_of_one_device(master: RawMaster) -> None:
    stopped = LEVEL + offset("1.7")
    master.request(P_AC, CA, stopped, b"\x03", cause=DEACT)
    assert master.answer(P_AC).cause == DEACT_CON
    seen = Counter[int]()
    deadline = time.monotonic() + 30
    while any(seen[LEVEL + offset(device)] < 4 for device in ("1.5", "2.8")):
        asdu = master.next_asdu(deadline)
        if (asdu.cause, asdu.ca) == (CYCLIC, CA):
            seen.update(ioa for ioa, _ in objects(asdu))
    assert set(seen) == {LEVEL + offset("1.5"), LEVEL + offset("2.8")}
    master.request(P_AC, CA, stopped, b"\x03", cause=ACT)
    assert master.answer(P_AC).cause == ACT_CON
    while stopped not in seen:
        asdu = master.next_asdu(deadline)
        if (asdu.cause, asdu.ca) == (CYCLIC, CA):
            seen.update(ioa for ioa, _ in objects(asdu))


# ---- a dead device, and the start --------------------------------------------------------------------------


def qualities(master: RawMaster) -> dict[str, set[bool]]:
    """Of each device: whether its points are invalid, as an interrogation has them."""
    found = procedure(master, C_IC, 20, INTERROGATED)
    assert sorted(ioa for ioa, _ in found) == addresses(MEASURED)
    return {
        device: {
            bool(element[-1] & 0x80)
            for ioa, element in found
            if ioa in {kind + offset(device) for kind in MEASURED}
        }
        for device in SHARED
    }


@pytest.mark.slow
@pytest.mark.parametrize("device", SHARED)
def test_the_points_of_a_dead_device_are_invalid_and_no_others(
    desk: Desk, master: RawMaster, device: str
) -> None:
    desk.lines.fault(device, "mute")
    try:
        unit = f"p{device}.*"
        desk.gateway.wait_for(
            lambda: all(point["quality"] == "invalid" for point in desk.gateway.points(unit).values()),
            60.0,
            f"{device} is dead",
        )
        assert qualities(master) == {one: {one == device} for one in SHARED}
        alive = next(one for one in SHARED if one != device)
        master.request(C_SC, CA, LAMP + offset(alive), b"\x00")
        assert answers(master, C_SC) == [(CA, ACT_CON), (CA, ACT_TERM)]
        assert set(totals(master)) == set(addresses((TOTAL,)))
    finally:
        desk.lines.fault(device, "clear")
    desk.wait_all_good(CA)
    assert qualities(master) == {one: {False} for one in SHARED}


@pytest.mark.slow
def test_the_end_of_initialisation_is_said_once_for_each_address(programs: Path) -> None:
    with substation_of(configuration(), programs) as fresh, RawMaster(*fresh.gateway.address) as master:
        ends = [master.answer(M_EI) for _ in range(2)]
        assert [(end.ca, end.cause) for end in ends] == [(CA, INITIALISED), (OTHER, INITIALISED)]
        master.request(C_RD, CA, LEVEL, b"", cause=REQUEST)
        while (asdu := master.answer_of({M_EI, M_ME_NB})).cause != REQUEST:
            assert asdu.type != M_EI
