# SPDX-License-Identifier: GPL-3.0-or-later
"""What is said of values that are not good, octet by octet."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from desk import Desk, chapter_5, desk_of, of_port
from lab.raw_master import Asdu, RawMaster

M_ME_NA, M_ME_ND, C_IC, C_RD, M_EI = 9, 21, 100, 102, 70
SPONTANEOUS, REQUEST, ACT_CON, ACT_TERM, INTROGEN, NEGATIVE = 3, 5, 7, 10, 20, 0x40
RELAY, RELAY_CA = "1.10", 1010
CURRENT, FREQUENCY = 30001, 30002


def configuration() -> dict[str, Any]:
    """The relay's normalized values without quality; nothing is sent by period."""
    config = chapter_5()
    relay = next(slave for slave in of_port(config, 1)["slaves"] if slave["id"] == 10)
    for register in relay["input_registers"][:2]:
        register["quality"] = False
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
    """The next ASDU whose first object is this one."""
    deadline = time.monotonic() + 10.0
    while True:
        asdu = master.next_asdu(deadline)
        if int.from_bytes(asdu.body[:3], "little") == ioa:
            return asdu


def interrogated(master: RawMaster, ca: int) -> list[Asdu]:
    """The ASDUs of a station interrogation."""
    master.request(C_IC, ca, 0, bytes([INTROGEN]))
    assert master.answer(C_IC).cause == ACT_CON
    found: list[Asdu] = []
    while (asdu := master.next_asdu(time.monotonic() + 10.0)).type != C_IC:
        found += [asdu] if asdu.cause == INTROGEN else []
    assert asdu.cause == ACT_TERM
    return found


def read(master: RawMaster, ca: int, ioa: int) -> Asdu:
    master.request(C_RD, ca, ioa, b"", cause=REQUEST)
    deadline = time.monotonic() + 10.0
    while (asdu := master.next_asdu(deadline)).cause & 0x3F != REQUEST:
        pass
    return asdu


def told(desk: Desk, ioa: int) -> tuple[Any, str]:
    """Value and quality of one of the relay's points, as rtuctl has them."""
    point = next(p for p in desk.gateway.points().values() if (p["ca"], p["ioa"]) == (RELAY_CA, ioa))
    return point["value"], point["quality"]


def test_value_without_quality_is_told_while_good(desk: Desk, master: RawMaster) -> None:
    """Register 1 is unsigned here, so that 40000 is an overflow: it is there, and nothing is said of it."""
    desk.set_and_scan(RELAY, "input_registers", 0, [0x8000, 40000])
    desk.gateway.wait_for(lambda: told(desk, CURRENT) == (-1, "good"), 5.0, "the lowest value")
    desk.gateway.wait_for(lambda: told(desk, FREQUENCY)[1] == "overflow", 5.0, "an overflow")
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
        lambda: taken().get(FREQUENCY) == ("M_ME_ND_1", 0.25), 10.0, "the value, as another make takes it"
    )
    assert taken()[CURRENT] == ("M_ME_ND_1", 0.5)
