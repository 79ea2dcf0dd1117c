# SPDX-License-Identifier: GPL-3.0-or-later
"""What is said of values that are not good, octet by octet."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.raw_master import Asdu, RawMaster
from rig.desk import Desk, chapter_5, desk_of, of_port

pytestmark = pytest.mark.slow

M_ME_NA, M_ME_NB, M_ME_ND, M_ME_TE, C_IC, C_RD = 9, 11, 21, 35, 100, 102
SPONTANEOUS, REQUEST, ACT_CON, ACT_TERM, INTROGEN, NEGATIVE = 3, 5, 7, 10, 20, 0x40
RELAY, RELAY_CA = "1.10", 1010
CURRENT, FREQUENCY, TEMPERATURE, POWER = 30001, 30002, 30003, 30004
TEST_MODE, BY_HAND, FROZEN = 20, 21, 22  # discrete inputs
GOOD, BLOCKED, SUBSTITUTED, NOT_TOPICAL, INVALID = 0, 0x10, 0x20, 0x40, 0x80
READ_INPUTS, READ_REGISTERS = 2, 4


def configuration() -> dict[str, Any]:
    """The relay's normalized values without quality, status bits for others; nothing is sent by period."""
    config = chapter_5()
    relay = next(slave for slave in of_port(config, 1)["slaves"] if slave["id"] == 10)
    current, frequency, temperature, power = relay["input_registers"]
    current["quality"] = frequency["quality"] = False
    relay["discrete_inputs"] += [
        {"address": TEST_MODE, "name": "feeder10.test-mode"},
        {"address": BY_HAND, "name": "feeder10.by-hand"},
        {"address": FROZEN, "name": "feeder10.frozen"},
    ]
    power["blocked_by"] = current["blocked_by"] = "feeder10.test-mode"
    temperature["substituted_by"], temperature["not_topical_by"] = "feeder10.by-hand", "feeder10.frozen"
    for port in config["port"]:
        for slave in port["slaves"]:
            for register in slave["input_registers"]:
                register.pop("cyclic_ms", None)
    return config


@pytest.fixture(scope="module")
def desk(programs: Path) -> Iterator[Desk]:
    with desk_of(configuration(), programs) as desk:
        yield desk


@pytest.fixture
def master(desk: Desk) -> Iterator[RawMaster]:
    with RawMaster(*desk.gateway.address) as master:
        yield master


def next_of(master: RawMaster, ioa: int) -> Asdu:
    """The next ASDU of the relay whose first object is this one."""
    deadline = time.monotonic() + 60
    while True:
        asdu = master.next_asdu(deadline)
        if asdu.ca == RELAY_CA and int.from_bytes(asdu.body[:3], "little") == ioa:
            return asdu


def interrogated(master: RawMaster, ca: int) -> list[Asdu]:
    """The ASDUs of a station interrogation."""
    master.request(C_IC, ca, 0, bytes([INTROGEN]))
    assert master.answer(C_IC).cause == ACT_CON
    found: list[Asdu] = []
    while (asdu := master.next_asdu(time.monotonic() + 60)).type != C_IC:
        found += [asdu] if asdu.cause == INTROGEN else []
    assert asdu.cause == ACT_TERM
    return found


def read(master: RawMaster, ca: int, ioa: int) -> Asdu:
    master.request(C_RD, ca, ioa, b"", cause=REQUEST)
    deadline = time.monotonic() + 60
    while (asdu := master.next_asdu(deadline)).cause & 0x3F != REQUEST:
        pass
    return asdu


def value_and_quality(desk: Desk, ioa: int) -> tuple[Any, str]:
    """Value and quality of one of the relay's points, as rtuctl has them."""
    point = next(p for p in desk.gateway.points().values() if (p["ca"], p["ioa"]) == (RELAY_CA, ioa))
    return point["value"], point["quality"]


def test_value_without_quality_is_told_while_good(desk: Desk, master: RawMaster) -> None:
    """Register 1 is unsigned here, so that 40000 is an overflow: it is there, and nothing is said of it."""
    desk.set_and_scan(RELAY, "input_registers", 0, [0x8000, 40000])
    desk.gateway.wait_for(lambda: value_and_quality(desk, CURRENT) == (-1, "good"), 60.0, "the lowest value")
    desk.gateway.wait_for(lambda: value_and_quality(desk, FREQUENCY)[1] == "overflow", 60.0, "an overflow")
    plain = [asdu for asdu in interrogated(master, RELAY_CA) if asdu.type == M_ME_ND]
    assert [(asdu.count, asdu.body) for asdu in plain] == [(1, bytes.fromhex("3175000080"))]
    refusal = read(master, RELAY_CA, FREQUENCY)
    assert (refusal.type, refusal.cause, refusal.body) == (
        C_RD,
        REQUEST | NEGATIVE,
        FREQUENCY.to_bytes(3, "little"),
    )
    desk.set_and_scan(RELAY, "input_registers", 1, [0x4000])
    event = next_of(master, FREQUENCY)  # two octets, no time tag
    assert (event.type, event.count, event.cause) == (M_ME_ND, 1, SPONTANEOUS)
    assert event.body == bytes.fromhex("3275000040")
    answer = read(master, RELAY_CA, FREQUENCY)
    assert (answer.type, answer.cause, answer.body) == (M_ME_ND, REQUEST, bytes.fromhex("3275000040"))
    plain = [asdu for asdu in interrogated(master, RELAY_CA) if asdu.type == M_ME_ND]
    assert [(asdu.count, asdu.sequence, asdu.body) for asdu in plain] == [
        (2, True, bytes.fromhex("31750000800040"))
    ]
    others = [asdu for asdu in interrogated(master, RELAY_CA) if asdu.type == M_ME_NA]
    assert [asdu.count for asdu in others] == [1]  # of the holding registers: another type is another ASDU


def test_c104_takes_values_without_quality(desk: Desk) -> None:
    desk.set_and_scan(RELAY, "input_registers", 0, [0x4000, 0x2000])

    def taken() -> dict[int, tuple[str, float]]:
        return {r.ioa: (r.type, r.value) for r in desk.master.interrogate(RELAY_CA) if r.ioa < 30003}

    desk.gateway.wait_for(
        lambda: taken().get(FREQUENCY) == ("M_ME_ND_1", 0.25), 60.0, "the value, as another make takes it"
    )
    assert taken()[CURRENT] == ("M_ME_ND_1", 0.5)


# ---- status bits and exceptions ---------------------------------------------------------------------


def switch(desk: Desk, address: int, on: bool) -> None:
    desk.set_and_scan(RELAY, "discrete_inputs", address, [int(on)])


def objects(asdu: Asdu) -> dict[int, bytes]:
    """Of an M_ME_TE_1: value and quality descriptor by address."""
    assert (asdu.type, asdu.sequence, asdu.cause) == (M_ME_TE, False, SPONTANEOUS)
    found = (asdu.body[begin : begin + 13] for begin in range(0, len(asdu.body), 13))
    return {int.from_bytes(octets[:3], "little"): octets[3:6] for octets in found}


def until_quality(master: RawMaster, ioa: int, quality: int, timeout_s: float = 10.0) -> bytes:
    """The value of the relay's object's next event, which has this quality."""
    deadline = time.monotonic() + timeout_s
    while True:
        asdu = master.next_asdu(deadline)
        if (asdu.type, asdu.ca) == (M_ME_TE, RELAY_CA) and ioa in objects(asdu):
            octets = objects(asdu)[ioa]
            assert octets[2] == quality, octets.hex(" ")
            return octets[:2]


def test_status_bits_are_in_the_quality(desk: Desk, master: RawMaster) -> None:
    """They come with another request than the value, which has not changed."""
    value = (-120).to_bytes(2, "little", signed=True)
    switch(desk, TEST_MODE, True)
    assert until_quality(master, POWER, BLOCKED) == value
    assert read(master, RELAY_CA, POWER).body[3:] == value + bytes([BLOCKED])
    assert CURRENT not in {int.from_bytes(a.body[:3], "little") for a in interrogated(master, RELAY_CA)}
    desk.set_and_scan(RELAY, "input_registers", 3, [100])
    assert until_quality(master, POWER, BLOCKED) == bytes([100, 0])
    desk.set_and_scan(RELAY, "input_registers", 3, [0x10000 - 120])
    assert until_quality(master, POWER, BLOCKED) == value
    switch(desk, TEST_MODE, False)
    assert until_quality(master, POWER, GOOD) == value
    switch(desk, BY_HAND, True)
    until_quality(master, TEMPERATURE, SUBSTITUTED)
    switch(desk, FROZEN, True)
    until_quality(master, TEMPERATURE, SUBSTITUTED | NOT_TOPICAL)
    scaled = [a for a in interrogated(master, RELAY_CA) if a.type == M_ME_NB]
    assert scaled[0].body[:3] == TEMPERATURE.to_bytes(3, "little")
    assert (scaled[0].body[5], scaled[0].body[8]) == (SUBSTITUTED | NOT_TOPICAL, GOOD)
    assert value_and_quality(desk, TEMPERATURE)[1] == "not topical,substituted"
    switch(desk, BY_HAND, False)
    until_quality(master, TEMPERATURE, NOT_TOPICAL)
    switch(desk, FROZEN, False)
    until_quality(master, TEMPERATURE, GOOD)


def test_c104_sees_status_bits(desk: Desk) -> None:
    mark = desk.master.mark()
    switch(desk, TEST_MODE, True)
    report = desk.master.wait(lambda r: (r.ca, r.ioa) == (RELAY_CA, POWER), mark)
    assert (report.type, report.quality) == ("M_ME_TE_1", "Blocked")
    mark = desk.master.mark()
    switch(desk, TEST_MODE, False)
    assert desk.master.wait(lambda r: (r.ca, r.ioa) == (RELAY_CA, POWER), mark).good


def test_status_bit_that_is_refused_leaves_nobody_knowing(desk: Desk, master: RawMaster) -> None:
    desk.lines.fault(RELAY, "exception", 2, READ_INPUTS)
    until_quality(master, POWER, NOT_TOPICAL)
    desk.lines.fault(RELAY, "clear")
    until_quality(master, POWER, GOOD, 30.0)
    desk.wait_all_good(RELAY_CA)


@pytest.mark.sample(4)
@pytest.mark.parametrize("exception", [5, 6, 10, 11])
def test_value_that_a_device_does_not_give_now_is_old(desk: Desk, master: RawMaster, exception: int) -> None:
    before = value_and_quality(desk, POWER)
    desk.lines.fault(RELAY, "exception", exception, READ_REGISTERS)
    value = until_quality(master, POWER, NOT_TOPICAL)
    assert int.from_bytes(value, "little", signed=True) == before[0]
    assert CURRENT not in {int.from_bytes(a.body[:3], "little") for a in interrogated(master, RELAY_CA)}
    desk.lines.fault(RELAY, "clear")
    assert until_quality(master, POWER, GOOD, 30.0) == value
    desk.wait_all_good(RELAY_CA)


def test_value_that_a_device_refuses_is_invalid(desk: Desk, master: RawMaster) -> None:
    """Whatever it says before; and what is invalid does not become old."""
    desk.lines.fault(RELAY, "exception", 6, READ_REGISTERS)
    until_quality(master, POWER, NOT_TOPICAL)
    desk.lines.fault(RELAY, "exception", 4, READ_REGISTERS)
    until_quality(master, POWER, INVALID, 30.0)
    mark = desk.lines.mark()
    desk.lines.fault(RELAY, "exception", 6, READ_REGISTERS)
    desk.lines.wait_frame(lambda f: f.kind == "sent" and f.bytes[1:3] == b"\x84\x06", 30.0, mark)
    desk.wait_scan(RELAY)
    assert read(master, RELAY_CA, POWER).body[5] == INVALID
    desk.lines.fault(RELAY, "clear")
    until_quality(master, POWER, GOOD, 60.0)
    desk.wait_all_good(RELAY_CA, 60.0)


def test_device_that_does_not_answer_is_invalid_and_nothing_else(desk: Desk, master: RawMaster) -> None:
    switch(desk, TEST_MODE, True)
    until_quality(master, POWER, BLOCKED)
    desk.lines.fault(RELAY, "mute")
    until_quality(master, POWER, INVALID)
    desk.lines.fault(RELAY, "clear")
    until_quality(master, POWER, BLOCKED, 30.0)  # the bits are read before the registers
    switch(desk, TEST_MODE, False)
    until_quality(master, POWER, GOOD)
