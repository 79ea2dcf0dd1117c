# SPDX-License-Identifier: GPL-3.0-or-later
"""A second controlling station in the plant (docs/plant.md): it is told everything, too."""

from dataclasses import replace
from pathlib import Path

import pytest

from front_masters import ADDRESS, CONSUMER, SecondMaster
from plant_judge import judge
from plant_run import story
from plant_seeds import calm, troubled
from plant_trials import run_world, spoiled_copy
from plant_world import Fault, Run

SECONDS = 60.0
TROUBLED_S = 200.0


@pytest.fixture(scope="module")
def first(programs: Path, linesim_program: Path, folder: Path) -> Run:
    world = replace(calm(1, SECONDS), fronts=(SecondMaster(groups=True),))
    return run_world(world, folder / "first")


def test_both_are_told_each_value(first: Run) -> None:
    assert judge(first) == []
    values = [
        {(line["point"], line["value"]) for line in first.told(part) if line.get("type", 70) != 70}
        for part in ("consumer", CONSUMER)
    ]
    assert len(values[0]) > 30
    assert values[0] == values[1]


def test_each_has_an_address_of_its_own(first: Run) -> None:
    log = (first.folder / "gateway.log").read_text()
    assert f" {ADDRESS} port " in log
    assert " 127.0.0.1 port " in log


@pytest.mark.slow
@pytest.mark.parametrize("groups", [False, True])
def test_what_must_hold_of_two_masters(
    programs: Path, linesim_program: Path, folder: Path, groups: bool
) -> None:
    world = troubled(4, TROUBLED_S, 4.0, (SecondMaster(groups),))
    assert {"rtu-centre", "rtu-centre-2", "rtu-iec104", "rtud"} <= {fault.of for fault in world.faults}
    ran = run_world(world, folder / f"troubled-{groups}")
    violations = judge(ran)
    assert not violations, story(ran, violations)


def test_the_judge_sees_what_the_second_is_not_told(first: Run, tmp_path: Path) -> None:
    lines = [line for line in first.told(CONSUMER) if line.get("type") != 35]
    told = judge(spoiled_copy(first, tmp_path, CONSUMER, lines))
    assert {violation.rule for violation in told} == {"no event lost", "recovery"}
    assert all(violation.text.startswith("the second master: ") for violation in told)


@pytest.mark.parametrize(
    ("part", "killed", "rules"),
    [
        ("consumer", "rtu-centre", set()),
        ("consumer", "rtu-centre-2", {"connection"}),
        (CONSUMER, "rtu-centre", {"connection"}),
        (CONSUMER, "rtu-centre-2", set()),
    ],
)
def test_the_trouble_of_one_is_no_excuse_of_the_other(
    first: Run, tmp_path: Path, part: str, killed: str, rules: set[str]
) -> None:
    lines = [*first.told(part), {"at": 1030 * 10**9, "kind": "link", "state": 4}]
    spoiled = spoiled_copy(first, tmp_path, part, lines)
    world = replace(first.world, faults=(Fault(29.0, "kill", killed),))
    assert {violation.rule for violation in judge(replace(spoiled, world=world))} == rules
