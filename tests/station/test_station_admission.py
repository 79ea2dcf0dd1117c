# SPDX-License-Identifier: GPL-3.0-or-later
"""Who gets a connection when somebody holds all that are free; a clock that was never set."""

import contextlib
import datetime
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from lab.gateway import Gateway
from lab.raw_master import RawMaster
from lab.show import STATION
from rig.bare import STARTDT, STARTDT_CON, TESTFR, TESTFR_CON, Bare
from rig.cp56 import cp56
from rig.desk import Substation, chapter_5, substation_of

GROUP, CENTRE, IDLER = "127.0.0.71", "127.0.0.72", "127.0.0.73"
PLACES, T1_S = 5, 3
SOON_S = 60.0
C_SC_TA, C_CS, ACT_CON, ACT_TERM, NEGATIVE = 58, 103, 7, 10, 0x40


@pytest.fixture(scope="module")
def substation(programs: Path) -> Iterator[Substation]:
    """One of its places is kept for the group. Nobody sets its clock before the tests do."""
    config = chapter_5()
    config["iec104"] = {
        "t1": T1_S,
        "t2": 1,
        "max_connections": PLACES,
        "connections_per_address": PLACES - 1,
    }
    config["redundancy_groups"] = [{"name": "Control centre", "masters": [GROUP]}]
    with substation_of(config, programs) as substation:
        yield substation


def counters(gateway: Gateway) -> dict[str, int]:
    return {row["counter"]: row["value"] for row in gateway.query("iec104", "counters")}


def confirms_test_frames(link: Bare) -> bool:
    link.send(TESTFR)
    return link.frame() == TESTFR_CON


def starts(link: Bare) -> bool:
    """False: it has no connection."""
    with contextlib.suppress(ConnectionError):
        link.send(STARTDT)
        return link.socket.recv(6) == STARTDT_CON
    return False


@pytest.mark.slow
def test_idle_peer_keeps_nobody_out(substation: Substation) -> None:
    """It holds all that are free, and would for ever. The group has its place, others get one after t1."""
    gateway = substation.gateway
    before = counters(gateway)
    with contextlib.ExitStack() as stack:

        def come(source: str) -> Bare:
            return stack.enter_context(Bare(gateway.address, source))

        idle = [come(IDLER) for _ in range(PLACES - 1)]
        assert all(confirms_test_frames(link) for link in idle)
        assert not starts(come(IDLER))
        group = stack.enter_context(RawMaster(*gateway.address, source=GROUP))
        assert len(group.interrogate(STATION).objects) == 13
        deadline = time.monotonic() + SOON_S
        while not starts(come(CENTRE)):
            assert time.monotonic() < deadline, gateway.log()
            assert len(group.interrogate(STATION).objects) == 13
        idle[0].closed()
        assert all(confirms_test_frames(link) for link in idle[1:])
        assert len(group.interrogate(STATION).objects) == 13
    after = counters(gateway)
    assert after["closed_gave_way"] == before["closed_gave_way"] + 1
    assert after["refused_too_many"] > before["refused_too_many"]


@pytest.mark.slow
def test_old_command_is_refused_before_the_clock_is_set(substation: Substation) -> None:
    """On a host whose own clock is synchronised the gateway's is set, and the command is too old."""
    now = datetime.datetime.now(datetime.UTC)
    with RawMaster(*substation.gateway.address, source=CENTRE) as master:
        master.request(C_SC_TA, STATION, 4, b"\x01" + cp56(now - datetime.timedelta(hours=1)))
        assert master.answer(C_SC_TA).cause == ACT_CON | NEGATIVE
        master.request(C_CS, STATION, 0, cp56(now))
        assert master.answer(C_CS).cause == ACT_CON
        master.request(C_SC_TA, STATION, 4, b"\x01" + cp56(now))
        assert [master.answer(C_SC_TA).cause, master.answer(C_SC_TA).cause] == [ACT_CON, ACT_TERM]
