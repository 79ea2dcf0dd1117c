# SPDX-License-Identifier: GPL-3.0-or-later
"""A short queue of events in the plant (docs/plant.md): it is bounded, and what it loses is counted."""

import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from front_queue import LIMIT, LOSING, LOST, ShortQueue, counted
from plant_history import History
from plant_judge import judge, no_event_is_lost
from plant_run import story
from plant_seeds import Field, overfull
from plant_trials import Lines, run_world, spoiled_copy
from plant_world import PORT, Fault, Run, World

SECONDS = 90.0
AWAY = Fault(10.0, "cut", f"{PORT}", for_s=50.0)
TROUBLED_S = 200.0


@pytest.fixture(scope="module")
def away(programs: Path, linesim_program: Path, folder: Path) -> Run:
    changes = Field(random.Random(1), SECONDS).changes(mean_s=0.25)
    return run_world(World(1, SECONDS, changes, (AWAY,), fronts=(ShortQueue(),)), folder / "away")


def test_what_a_short_queue_loses_is_counted(away: Run) -> None:
    assert judge(away) == []
    assert counted(History(away)) > 20
    assert list(no_event_is_lost(History(away)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [7, 31])
def test_what_must_hold_of_a_short_queue(
    programs: Path, linesim_program: Path, folder: Path, seed: int
) -> None:
    ran = run_world(overfull(seed, TROUBLED_S, 8.0), folder / f"overfull-{seed}")
    violations = judge(ran)
    assert not violations, story(ran, violations)


# ---- each rule can fail -------------------------------------------------------------------------------


def without_a_count(lines: Lines) -> Lines:
    return [{**line, "value": 0} if line.get("point") == LOST else line for line in lines]


def without_an_end(lines: Lines) -> Lines:
    return [line for line in lines if line.get("point") != LOSING or line["value"] == 1]


def with_more_than_may_wait(lines: Lines) -> Lines:
    waited = [line for line in lines if line.get("tag") and line["point"].startswith("1001.")]
    return [*lines, *({**waited[0], "at": lines[-1]["at"], "value": value} for value in range(2 * LIMIT))]


@pytest.mark.parametrize(
    ("spoil", "rule"),
    [(without_a_count, "no event lost"), (without_an_end, "queue"), (with_more_than_may_wait, "queue")],
)
def test_the_judge_sees_what_must_not_be(
    away: Run, tmp_path: Path, spoil: Callable[[Lines], Lines], rule: str
) -> None:
    spoiled = spoiled_copy(away, tmp_path, "consumer", spoil(away.told("consumer")))
    assert rule in {violation.rule for violation in judge(spoiled)}


@pytest.mark.parametrize(("ends", "is_lost"), [(False, True), (True, False)])
def test_what_was_counted_goes_with_the_gateway(away: Run, tmp_path: Path, ends: bool, is_lost: bool) -> None:
    """Ended long behind what it lost, and before the centre heard of it: as found by seed 2347."""
    before = [line for line in away.told("consumer") if line["at"] / 1e9 - 1000 < AWAY.at_s]
    spoiled = spoiled_copy(away, tmp_path, "consumer", before)
    faults = (AWAY, Fault(160.0, "kill", "rtud")) if ends else (AWAY,)
    found = judge(replace(spoiled, world=replace(away.world, faults=faults)))
    assert ("no event lost" in {violation.rule for violation in found}) is is_lost
