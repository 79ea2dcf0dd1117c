# SPDX-License-Identifier: GPL-3.0-or-later
"""More than one client of a device: what a command brings back is what the device holds, soon or late."""

import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.linesim import Frame
from lab.raw_master import RawMaster
from rig.desk import Substation, everything_read, gateway_on_lines, patience

pytestmark = pytest.mark.slow  # as a whole

CA, DEVICE = 1005, "1.5"
AT_ONCE, IN_TURN = 0, 10  # registers: one is read back, the other in its turn
each_register = pytest.mark.parametrize("register", [AT_ONCE, IN_TURN], ids=["at once", "in turn"])
PERIOD_MS = 1000  # after a read, nothing is due for so long
WAIT_S = 60.0
C_SE_NB, SCALED = 49, 35
SPONTANEOUS, ACT_CON, ACT_TERM, RETURN_REMOTE = 3, 7, 10, 11
READ, WRITE = 3, 6


def configuration() -> dict[str, Any]:
    registers = [{"address": AT_ONCE}, {"address": IN_TURN, "read_back": False}]
    slave = {"id": 5, **patience(), "period_ms": PERIOD_MS, "holding_registers": registers}
    pace = {"baud_rate": 19200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    return {"iec104": {}, "port": [{"value": 1, "active": 1, **pace, "slaves": [slave]}]}


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Substation]:
    with gateway_on_lines(configuration(), programs, {}) as (lines, gateway):
        gateway.wait_for(lambda: everything_read(gateway), 60.0, "every register has been read")
        yield Substation(lines, gateway)


@pytest.fixture
def substation(running: Substation) -> Iterator[Substation]:
    """Both registers are 0, and have just been read."""
    running.lines.fault(DEVICE, "clear")
    for register in (AT_ONCE, IN_TURN):
        running.set_and_scan(DEVICE, "holding_registers", register, [0])
    running.gateway.wait_for(
        lambda: {point["value"] for point in running.gateway.points().values()} == {0}, WAIT_S, "all are 0"
    )
    wait_read(running)
    yield running


@pytest.fixture
def master(substation: Substation) -> Iterator[RawMaster]:
    with RawMaster(*substation.gateway.address) as master:
        yield master


def wait_read(substation: Substation) -> None:
    """Until the last of the two reads was answered."""
    substation.lines.wait_frame(
        lambda f: (f.kind, f.table, f.address) == ("reading", "holding_registers", IN_TURN),
        since=substation.lines.mark(),
    )
    substation.lines.wait_frame(lambda f: f.kind == "sent", since=substation.lines.mark() - 1)


def command(master: RawMaster, register: int, value: int) -> None:
    master.request(C_SE_NB, CA, 40001 + register, struct.pack("<hB", value, 0))


def heard(master: RawMaster, count: int) -> list[tuple[int, int]]:
    """So many answers and values: of the command its cause and 0, of a value its cause and what it is."""
    seen: list[tuple[int, int]] = []
    deadline = time.monotonic() + WAIT_S
    while len(seen) < count:
        asdu = master.next_asdu(deadline)
        assert asdu.type in (C_SE_NB, SCALED)
        seen += [(asdu.cause, object.value) for object in asdu.objects()] or [(asdu.cause, 0)]
    return seen


def asked(substation: Substation, since: int) -> list[Frame]:
    substation.lines.get(DEVICE, "holding_registers", 0)  # its answer comes behind the frames so far
    return [frame for frame in substation.lines.frames(since) if frame.kind == "received"]


def test_what_was_written_is_read_back_at_once(substation: Substation, master: RawMaster) -> None:
    since = substation.lines.mark()
    command(master, AT_ONCE, 7)
    assert heard(master, 3) == [(ACT_CON, 0), (RETURN_REMOTE, 7), (ACT_TERM, 0)]
    assert [frame.bytes[1:4] for frame in asked(substation, since)][:2] == [
        bytes([WRITE, 0, AT_ONCE]),
        bytes([READ, 0, AT_ONCE]),
    ]


def test_without_read_back_the_confirmation_ends_it(substation: Substation, master: RawMaster) -> None:
    since = substation.lines.mark()
    command(master, IN_TURN, 7)
    assert heard(master, 2) == [(ACT_CON, 0), (ACT_TERM, 0)]
    assert [frame.bytes[1:4] for frame in asked(substation, since)] == [bytes([WRITE, 0, IN_TURN])]
    command(master, IN_TURN, 8)  # nobody waits for a read
    assert heard(master, 2) == [(ACT_CON, 0), (ACT_TERM, 0)]
    assert heard(master, 1) == [(RETURN_REMOTE, 8)]


@each_register
def test_return_information_comes_also_when_nothing_changed(master: RawMaster, register: int) -> None:
    command(master, register, 0)
    assert sorted(heard(master, 3)) == [(ACT_CON, 0), (ACT_TERM, 0), (RETURN_REMOTE, 0)]


@each_register
def test_return_information_is_what_the_device_holds(
    substation: Substation, master: RawMaster, register: int
) -> None:
    """Somebody at the device has changed it between the write and the read."""
    substation.lines.fault(DEVICE, "override", 60)
    command(master, register, 50)
    assert sorted(heard(master, 3)) == [(ACT_CON, 0), (ACT_TERM, 0), (RETURN_REMOTE, 60)]
    assert substation.gateway.points()[f"p{DEVICE}.h{register}"]["value"] == 60


def test_another_client_writes_before_the_read(substation: Substation, master: RawMaster) -> None:
    command(master, IN_TURN, 50)
    assert heard(master, 2) == [(ACT_CON, 0), (ACT_TERM, 0)]
    substation.lines.set(DEVICE, "holding_registers", IN_TURN, 60)
    assert heard(master, 1) == [(RETURN_REMOTE, 60)]
    substation.lines.set(DEVICE, "holding_registers", IN_TURN, 61)
    assert heard(master, 1) == [(SPONTANEOUS, 61)]


@each_register
def test_what_another_client_writes_is_spontaneous(
    substation: Substation, master: RawMaster, register: int
) -> None:
    substation.lines.set(DEVICE, "holding_registers", register, 60)
    assert heard(master, 1) == [(SPONTANEOUS, 60)]
    command(master, register, 50)
    assert sorted(heard(master, 3)) == [(ACT_CON, 0), (ACT_TERM, 0), (RETURN_REMOTE, 50)]
    substation.lines.set(DEVICE, "holding_registers", register, 60)
    assert heard(master, 1) == [(SPONTANEOUS, 60)]


def test_device_that_dies_first_returns_nothing(substation: Substation, master: RawMaster) -> None:
    command(master, IN_TURN, 50)
    assert heard(master, 2) == [(ACT_CON, 0), (ACT_TERM, 0)]
    substation.lines.fault(DEVICE, "mute")
    assert heard(master, 2) == 2 * [(SPONTANEOUS, 0)]  # both are invalid
    substation.lines.fault(DEVICE, "clear")
    assert sorted(heard(master, 2)) == [(SPONTANEOUS, 0), (SPONTANEOUS, 50)]
