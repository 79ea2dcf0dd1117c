# SPDX-License-Identifier: GPL-3.0-or-later
"""A journal in the plant (docs/plant.md): with it no event is lost by the end of rtud."""

from dataclasses import replace
from pathlib import Path

import pytest

from front_journal import Journal
from plant_judge import judge
from plant_run import story
from plant_seeds import troubled
from plant_trials import run_world, spoiled_copy
from plant_world import PORT, Change, Fault, Front, Run, World

SECONDS = 100.0
TROUBLED_S = 200.0
HELD_THEN = "1001.30001"
CHANGES = tuple(
    Change(at_s, "1.1", "input_registers", 0, value) for at_s, value in ((40.0, 11), (55.0, 12), (75.0, 13))
)
KILLED_S = 60.5  # while nobody can be told, and the device has another value already
FAULTS = (Fault(38.0, "cut", f"{PORT}", for_s=30.0), Fault(KILLED_S, "kill", "rtud"))


def cut_and_killed(folder: Path, *fronts: Front) -> Run:
    return run_world(World(1, SECONDS, CHANGES, FAULTS, fronts=fronts), folder)


def told_values(ran: Run) -> list[int]:
    return [line["value"] for line in ran.told("consumer") if line.get("point") == HELD_THEN and line["tag"]]


@pytest.fixture(scope="module")
def kept(programs: Path, linesim_program: Path, folder: Path) -> Run:
    return cut_and_killed(folder / "kept", Journal())


def test_what_waited_is_told_after_rtud_was_killed(kept: Run) -> None:
    told = told_values(kept)
    assert told[told.index(11) :] == [11, 12, 12, 13]
    assert judge(kept) == []


def test_the_journal_is_one_trace(kept: Run, folder: Path) -> None:
    assert cut_and_killed(folder / "again", Journal()).trace == kept.trace


def test_the_judge_sees_an_event_that_a_journal_should_have_kept(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    lost = cut_and_killed(folder / "lost")
    assert 11 not in told_values(lost)
    assert judge(lost) == []
    found = judge(replace(lost, world=replace(lost.world, fronts=(Journal(),))))
    assert {violation.rule for violation in found} == {"no event lost"}
    assert found[0].text.startswith(f"{HELD_THEN} was 11 ")


@pytest.mark.parametrize(("stopped", "rules"), [(False, {"no event lost"}), (True, set())])
def test_a_journal_that_does_not_run_is_an_excuse(
    kept: Run, tmp_path: Path, stopped: bool, rules: set[str]
) -> None:
    lines = [line for line in kept.told("consumer") if line.get("value") != 11]
    spoiled = spoiled_copy(kept, tmp_path, "consumer", lines)
    stop = Fault(KILLED_S - 5.0, "stop", "rtu-journal", for_s=4.0)
    world = replace(kept.world, faults=(*FAULTS, *((stop,) if stopped else ())))
    assert {violation.rule for violation in judge(replace(spoiled, world=world))} == rules


@pytest.mark.slow
def test_what_must_hold_with_a_journal(programs: Path, linesim_program: Path, folder: Path) -> None:
    world = troubled(8, TROUBLED_S, 5.0, (Journal(),))
    assert {"rtud", "rtu-journal", "rtu-iec104"} <= {fault.of for fault in world.faults}
    ran = run_world(world, folder / "troubled")
    violations = judge(ran)
    assert not violations, story(ran, violations)
