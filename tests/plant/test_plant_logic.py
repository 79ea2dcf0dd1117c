# SPDX-License-Identifier: GPL-3.0-or-later
"""Programs of Structured Text in the plant (docs/plant.md): what they compute is of what the devices held."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from front_logic import SIGN, Logic
from plant_judge import judge
from plant_run import story
from plant_seeds import calm, troubled
from plant_trials import Lines, run_world, spoiled_copy
from plant_world import Change, Fault, Run, World

SECONDS = 60.0
TROUBLED_S = 200.0
DIFFERENCE, OPPOSITE = "9000.1", "9001.1"
INVALID = 128


@pytest.fixture(scope="module")
def first(programs: Path, linesim_program: Path, folder: Path) -> Run:
    return run_world(replace(calm(3, SECONDS), fronts=(Logic(),)), folder / "first")


def test_both_programs_tell_what_they_compute(first: Run) -> None:
    assert judge(first) == []
    told = {point: set() for point in SIGN}
    for line in first.told("consumer"):
        if line.get("point") in told:
            told[line["point"]].add(line["value"])
    assert len(told[DIFFERENCE]) > 4
    assert {-value for value in told[DIFFERENCE]} == told["9001.1"]


def test_a_program_that_was_stopped_in_a_scan_computes_before_it_is_believed(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    """And does not rest for as long as it was stopped: as found by seed 2380."""
    changes = tuple(
        Change(at_s, "1.1", "input_registers", 0, value) for at_s, value in ((12.0, 4), (22.0, 8), (25.0, 11))
    )
    stop = Fault(22.0, "stop", "rtu-logic-neg", 6, for_s=8.0, stores=16)
    ran = run_world(World(3, SECONDS, changes, (stop,), fronts=(Logic(),)), folder / "stopped")
    violations = judge(ran)
    assert not violations, story(ran, violations)
    values = [line["value"] for line in ran.told("consumer") if line.get("point") == OPPOSITE]
    assert values[-1] == -11


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4])
def test_what_must_hold_of_programs(programs: Path, linesim_program: Path, folder: Path, seed: int) -> None:
    world = troubled(seed, TROUBLED_S, 4.0, (Logic(),))
    assert {"rtud", "rtu-logic-sub", "rtu-logic-neg"} <= {fault.of for fault in world.faults}
    ran = run_world(world, folder / f"troubled-{seed}")
    violations = judge(ran)
    assert not violations, story(ran, violations)


# ---- the judge sees what is wrong ----------------------------------------------------------------------


def places(lines: Lines) -> list[int]:
    return [place for place, line in enumerate(lines) if line.get("point") == DIFFERENCE and line["tag"]]


def with_another_result(lines: Lines) -> None:
    lines[places(lines)[-2]]["value"] = 31999


def without_results(lines: Lines) -> None:
    for place in reversed(places(lines)):
        del lines[place]


def with_an_old_result_behind(lines: Lines) -> None:
    of_point = places(lines)
    lines.append(lines[of_point[-3]] | {"at": lines[-1]["at"]})


def with_an_alarm(lines: Lines) -> None:
    place = places(lines)[-2]
    lines.insert(place, lines[place] | {"quality": INVALID})


@pytest.mark.parametrize(
    ("spoil", "rules"),
    [
        (with_another_result, {"true"}),
        (without_results, {"no event lost", "recovery"}),
        (with_an_old_result_behind, {"order", "recovery"}),
        (with_an_alarm, {"good"}),
    ],
)
def test_the_judge_sees_of_programs(
    first: Run, tmp_path: Path, spoil: Callable[[Lines], None], rules: set[str]
) -> None:
    lines = first.told("consumer")
    spoil(lines)
    found = judge(spoiled_copy(first, tmp_path, "consumer", lines))
    assert {violation.rule for violation in found} == rules


def test_a_return_may_be_told_in_the_instant_of_a_result(first: Run, tmp_path: Path) -> None:
    lines = first.told("consumer")
    place = places(lines)[-2]
    lines.insert(place, dict(lines[place]))
    assert judge(spoiled_copy(first, tmp_path, "consumer", lines)) == []


def test_trouble_of_a_program_excuses_its_alarm(first: Run, tmp_path: Path) -> None:
    lines = first.told("consumer")
    with_an_alarm(lines)
    at_s = lines[places(lines)[-2]]["at"] / 1e9 - 1000
    kill = Fault(at_s - 2.0, "kill", "rtu-logic-sub")
    spoiled = spoiled_copy(first, tmp_path, "consumer", lines)
    assert judge(replace(spoiled, world=replace(first.world, faults=(kill,)))) == []
