# SPDX-License-Identifier: GPL-3.0-or-later
"""A relay of GOOSE in the plant (docs/plant.md), and the Ethernet there."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from front_goose import COUNT, RELAY, Goose
from plant_judge import judge
from plant_run import story
from plant_seeds import calm, troubled
from plant_trials import Lines, run_script, run_world, spoiled_copy
from plant_world import CABLE, Fault, Run, World

SECONDS = 60.0
TROUBLED_S = 200.0
INVALID = 128


@pytest.fixture(scope="module")
def first(programs: Path, linesim_program: Path, folder: Path) -> Run:
    return run_world(replace(calm(1, SECONDS), fronts=(Goose(),)), folder / "first")


def test_states_go_both_ways(first: Run) -> None:
    assert judge(first) == []
    lines = first.told(RELAY)
    assert len([line for line in lines if "values" in line]) > 4
    told = [line["value"] for line in first.told("consumer") if line.get("point") == COUNT and line["tag"]]
    assert told[-6:] == [4, 5, 6, 7, 8, 9]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_what_must_hold_of_goose(programs: Path, linesim_program: Path, folder: Path, seed: int) -> None:
    world = troubled(seed, TROUBLED_S, 5.0, (Goose(),))
    assert {"rtu-goose", CABLE} & {fault.of for fault in world.faults}
    ran = run_world(world, folder / f"troubled-{seed}")
    violations = judge(ran)
    assert not violations, story(ran, violations)


def test_what_a_relay_says_is_invalid_when_its_messages_are_over(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    world = World(1, SECONDS, (), (Fault(20.0, "cut", CABLE, for_s=8.0),), fronts=(Goose(),))
    ran = run_world(world, folder / "cut")
    told = [line for line in ran.told("consumer") if line.get("point") == COUNT and line["tag"]]
    bad = [line["at"] / 1e9 - 1000 for line in told if line["quality"] == INVALID and line["at"] > 1005e9]
    assert [21.0 < at_s < 23.0 for at_s in bad] == [True]
    assert judge(ran) == []


def test_a_module_that_was_stopped_takes_messages_as_of_now(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    """Wherever it stands: a message came when it was read, not when the module last looked at the clock."""
    stops = tuple(Fault(15.0 + 14 * calls, "stop", "rtu-goose", calls=calls, for_s=6.5) for calls in range(6))
    ran = run_world(World(1, 120.0, (), stops, fronts=(Goose(),)), folder / "stopped")
    violations = judge(ran)
    assert not violations, story(ran, violations)


def test_a_message_that_waited_for_a_stopped_module_is_no_news(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    """One of right behind the stop, and none behind it: what it says held no longer when it was read."""
    faults = tuple(
        fault
        for at_s in range(15, 100, 17)
        for fault in (
            Fault(at_s, "stop", "rtu-goose", for_s=8.0),
            Fault(at_s + 2.5, "cut", CABLE, for_s=8.0),
        )
    )
    ran = run_world(World(1, 120.0, (), faults, fronts=(Goose(),)), folder / "waited")
    violations = judge(ran)
    assert not violations, story(ran, violations)


# ---- the judge sees what is wrong ----------------------------------------------------------------------


def states(lines: Lines) -> list[dict]:
    return [line for line in lines if "values" in line]


def with_another_state(lines: Lines) -> None:
    states(lines)[-3]["values"][2] = 31999


def with_a_bad_state(lines: Lines) -> None:
    states(lines)[-3]["values"][3] = 1


def without_a_state(lines: Lines) -> None:
    held = states(lines)[-2]["values"][2]
    lines[:] = [line for line in lines if "values" not in line or line["values"][2] != held]


def with_an_old_end(lines: Lines) -> None:
    lines.append(states(lines)[-1] | {"values": [0, 3, 0, 3]})


def with_another_count(lines: Lines) -> None:
    for line in lines:
        if line.get("sent") == 5:
            line["sent"] = 105


@pytest.mark.parametrize(
    ("spoil", "rules"),
    [
        (with_another_state, {"true", "no event lost"}),
        (with_a_bad_state, {"good"}),
        (without_a_state, {"no event lost"}),
        (with_an_old_end, {"good", "recovery"}),
        (with_another_count, {"true", "no event lost", "recovery"}),
    ],
)
def test_the_judge_sees_of_goose(
    first: Run, tmp_path: Path, spoil: Callable[[Lines], None], rules: set[str]
) -> None:
    lines = first.told(RELAY)
    spoil(lines)
    found = judge(spoiled_copy(first, tmp_path, RELAY, lines))
    assert {violation.rule for violation in found} == rules
    assert all(violation.text.startswith("by GOOSE ") for violation in found)


def counts(lines: Lines) -> list[int]:
    return [place for place, line in enumerate(lines) if line.get("point") == COUNT and line["tag"]]


def with_an_alarm(lines: Lines) -> None:
    place = counts(lines)[-2]
    lines.insert(place, lines[place] | {"quality": INVALID})


def without_a_count(lines: Lines) -> None:
    del lines[counts(lines)[-3]]


@pytest.mark.parametrize(
    ("spoil", "rules"), [(with_an_alarm, {"good"}), (without_a_count, {"no event lost"})]
)
def test_the_judge_sees_of_a_relays_point(
    first: Run, tmp_path: Path, spoil: Callable[[Lines], None], rules: set[str]
) -> None:
    lines = first.told("consumer")
    spoil(lines)
    found = judge(spoiled_copy(first, tmp_path, "consumer", lines))
    assert {violation.rule for violation in found} == rules


# ---- the Ethernet --------------------------------------------------------------------------------------

FRAMES = """
import select, socket, struct, time
one, other, third = (socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0) for _ in range(3))
for each in (one, other): each.bind(("plant0", 0x88b8))
head = bytes.fromhex("010ccd010001020000000001")
one.send(head + b"\\x88\\xb8 plain")
one.send(head + b"\\x81\\x00\\x80\\x00\\x88\\xb8 in a VLAN")
print(other.recv(100)[12:], other.recv(100)[12:])
print(select.select([one, other, third], [], [], 0)[0], socket.if_nametoindex("plant0"))
time.sleep(10)
one.send(head + b"\\x88\\xb8 cut")
time.sleep(10)
other.close()
print(one.send(head + b"\\x88\\xb8 to nobody"))
"""


def test_frames_come_to_all_but_their_sender(programs: Path, tmp_path: Path) -> None:
    assert run_script(tmp_path, FRAMES, f"cut\t{CABLE}\t5\t15\n").returncode == 0
    said = (tmp_path / "out").read_text()
    assert said == "b'\\x88\\xb8 plain' b'\\x88\\xb8 in a VLAN'\n[] 1\n24\n", (tmp_path / "log").read_text()
