# SPDX-License-Identifier: GPL-3.0-or-later
"""Six lines, thirty devices and all fronts in the plant (docs/plant.md): nothing changes, or all does."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from plant_judge import judge
from plant_run import story
from plant_seeds import large, storm
from plant_trials import run_world
from plant_world import World

SECONDS = 40.0


@pytest.mark.slow
@pytest.mark.parametrize("make", [large, storm])
def test_what_must_hold_of_thirty_devices(
    programs: Path, linesim_program: Path, folder: Path, make: Callable[[int, float], World]
) -> None:
    world = make(1, SECONDS)
    assert (len(world.lines), len(world.units), len(world.fronts)) == (6, 30, 7)
    ran = run_world(world, folder / make.__name__)
    violations = judge(ran)
    assert not violations, story(ran, violations)
    answers = [line["answers"] for line in ran.told("watch") if 1015e9 < line["at"] < 1035e9]
    assert {after["6.5"] - before["6.5"] for before, after in pairwise(answers)} == {1}


@pytest.mark.slow
def test_thirty_devices_are_one_trace(programs: Path, linesim_program: Path, folder: Path) -> None:
    first, second = (run_world(storm(2, SECONDS), folder / f"storm-{number}") for number in range(2))
    assert first.trace == second.trace
