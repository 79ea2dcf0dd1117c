# SPDX-License-Identifier: GPL-3.0-or-later
"""A manager of SNMP in the plant (docs/plant.md), and UDP there."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from front_counter import OBJECT, Counter
from front_snmp import MANAGER, Snmp
from plant_judge import judge
from plant_run import story
from plant_seeds import calm, troubled
from plant_trials import Lines, run_script, run_world, spoiled_copy
from plant_world import Fault, Run

SECONDS = 60.0
TROUBLED_S = 200.0
CHANGE, FROZEN = 1, 6
REGISTER = "2003.30001"


@pytest.fixture(scope="module")
def first(programs: Path, linesim_program: Path, folder: Path) -> Run:
    return run_world(replace(calm(1, SECONDS), fronts=(Snmp(), Counter())), folder / "first")


def test_the_manager_reads_what_the_devices_hold(first: Run) -> None:
    assert judge(first) == []
    assert all(each["whole"] for each in first.told(MANAGER))
    events = [event for each in first.told(MANAGER) for event in each["events"]]
    assert len([event for event in events if event[1] == CHANGE]) > 30
    assert len([event for event in events if event[1] == FROZEN]) > 25


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 6])
def test_what_must_hold_of_snmp(programs: Path, linesim_program: Path, folder: Path, seed: int) -> None:
    world = troubled(seed, TROUBLED_S, 5.0, (Snmp(), Counter()))
    assert {"rtu-snmp", "rtu-modbus-1"} <= {fault.of for fault in world.faults}
    ran = run_world(world, folder / f"troubled-{seed}")
    violations = judge(ran)
    assert not violations, story(ran, violations)


def test_a_freeze_that_is_taken_late_is_no_change(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    """The agent stops over two freezes: of the first there is no other reading any more."""
    stop = Fault(29.8, "stop", "rtu-snmp", for_s=5.0)
    world = replace(calm(1, SECONDS), faults=(stop,), fronts=(Snmp(), Counter()))
    ran = run_world(world, folder / "late")
    events = [event for each in ran.told(MANAGER) for event in each.get("events", [])]
    assert {event[1] for event in events if event[3] == OBJECT} == {FROZEN}
    assert judge(ran) == []


# ---- the judge sees what is wrong ----------------------------------------------------------------------


def row_of(lines: Lines, place: int, point: str = REGISTER) -> list:
    return next(row for row in lines[place]["points"] if row[0] == point)


def events_of(lines: Lines) -> list[list]:
    return [event for each in lines for event in each["events"] if event[1] == CHANGE and event[6]]


def with_an_old_reading(lines: Lines) -> None:
    row_of(lines, 20)[1] = row_of(lines, 5)[1]


def with_a_bad_reading(lines: Lines) -> None:
    row_of(lines, 20)[2] = 128


def with_another_event(lines: Lines) -> None:
    events_of(lines)[-1][4] = 31999


def with_an_event_of_another_time(lines: Lines) -> None:
    events_of(lines)[-6][6] += 2


def without_an_event(lines: Lines) -> None:
    place = max(place for place, each in enumerate(lines[:-8]) if len(each["events"]) > 1)
    del lines[place]["events"][0]


def without_an_answer(lines: Lines) -> None:
    lines[20]["whole"] = False


def with_a_freeze_that_is_a_change(lines: Lines) -> None:
    frozen = [event for each in lines for event in each["events"] if event[1] == FROZEN]
    assert frozen[-1][2:4] == [1001, OBJECT]
    frozen[-1][1] = CHANGE


def with_an_end_before_the_end(lines: Lines) -> None:
    del lines[-8:]


@pytest.mark.parametrize(
    ("spoil", "rules"),
    [
        (with_an_old_reading, {"true"}),
        (with_a_bad_reading, {"good"}),
        (with_another_event, {"true", "same"}),
        (with_an_event_of_another_time, {"same"}),
        (without_an_event, {"no event lost", "same"}),
        (without_an_answer, {"answer"}),
        (with_a_freeze_that_is_a_change, {"change"}),
        (with_an_end_before_the_end, {"recovery", "same"}),
    ],
)
def test_the_judge_sees_of_snmp(
    first: Run, tmp_path: Path, spoil: Callable[[Lines], None], rules: set[str]
) -> None:
    lines = first.told(MANAGER)
    spoil(lines)
    found = judge(spoiled_copy(first, tmp_path, MANAGER, lines))
    assert {violation.rule for violation in found} == rules
    assert all(violation.text.startswith("by SNMP ") for violation in found)


def test_an_agent_that_is_killed_need_not_answer(first: Run, tmp_path: Path) -> None:
    lines = first.told(MANAGER)
    without_an_answer(lines)
    spoiled = spoiled_copy(first, tmp_path, MANAGER, lines)
    kill = Fault(lines[20]["at"] / 1e9 - 1000 - 1.0, "kill", "rtu-snmp")
    assert judge(replace(spoiled, world=replace(first.world, faults=(kill,)))) == []


# ---- UDP -------------------------------------------------------------------------------------------------

UDP = """
import select, socket, time
server, client = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
server.bind(("0.0.0.0", 161))
client.sendto(b"to nobody", ("127.0.0.1", 9))
client.sendto(b"one", ("127.0.0.1", 161))
client.sendto(b"other", ("127.0.0.1", 161))
print(server.recvfrom(2))
octets, flags, _, sender = server.recvmsg(100)[0:4]
print(octets, sender == client.getsockname())
server.sendto(b"answer", sender)
print(client.recv(100), select.select([client, server], [], [], 5)[0], time.monotonic())
"""
CUT = """
import socket, time
server, client = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
server.bind(("127.0.0.1", 161))
for octets in (b"before", b"in it", b"behind"):
    client.sendto(octets, ("127.0.0.1", 161))
    time.sleep(10)
print(server.recv(100), server.recv(100))
"""
HASTE = """
import select, time
begun = time.monotonic()
while time.monotonic() <= begun: select.select([], [], [], 0)
print("there")
"""


def test_datagrams_are_whole_and_come_from_somebody(programs: Path, tmp_path: Path) -> None:
    assert run_script(tmp_path, UDP).returncode == 0
    assert (tmp_path / "out").read_text() == (
        "(b'on', ('127.0.0.1', 49152))\nb'other' True\nb'answer' [] 1005.0\n"
    ), (tmp_path / "log").read_text()


def test_datagrams_in_a_cut_are_lost(programs: Path, tmp_path: Path) -> None:
    assert run_script(tmp_path, CUT, "cut\t161\t5\t15\n").returncode == 0
    assert (tmp_path / "out").read_text() == "b'before' b'behind'\n", (tmp_path / "log").read_text()


def test_who_asks_for_no_time_again_and_again_sees_it_pass(programs: Path, tmp_path: Path) -> None:
    assert run_script(tmp_path, HASTE).returncode == 0
    assert (tmp_path / "out").read_text() == "there\n"
    assert (tmp_path / "trace").read_bytes().count(b" select ") < 200
