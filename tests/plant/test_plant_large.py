# SPDX-License-Identifier: GPL-3.0-or-later
"""Six lines, thirty devices and all fronts in the plant (docs/plant.md): nothing changes, or all does."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from plant_judge import judge
from plant_run import story
from plant_seeds import fronts, large, storm, troubled
from plant_trials import busy_processes, run_world
from plant_world import World

SECONDS = 40.0


@pytest.mark.slow
@pytest.mark.parametrize("make", [large, storm])
def test_what_must_hold_of_thirty_devices(
    programs: Path, linesim_program: Path, folder: Path, make: Callable[[int, float], World]
) -> None:
    world = make(1, SECONDS)
    assert (len(world.lines), len(world.units), len(world.fronts)) == (6, 30, 9)
    ran = run_world(world, folder / make.__name__)
    violations = judge(ran)
    assert not violations, story(ran, violations)
    answers = [line["answers"] for line in ran.told("watch") if 1015e9 < line["at"] < 1035e9]
    assert {after["6.5"] - before["6.5"] for before, after in pairwise(answers)} == {1}


def troubled_fronts(seed: int, seconds: float) -> World:
    """Whose modules die and stop."""
    return troubled(seed, seconds, fault_every_s=2.0, fronts=fronts(groups=True))


@pytest.mark.slow
@pytest.mark.parametrize(("make", "seconds"), [(storm, 30.0), (troubled_fronts, 120.0)])
def test_all_fronts_are_one_trace(
    programs: Path, linesim_program: Path, folder: Path, make: Callable[[int, float], World], seconds: float
) -> None:
    """Keys, salts, numbers and times of all makers' programs are of the seed, beside busy processes, too."""
    world = make(2, seconds)
    first = run_world(world, folder / f"{make.__name__}-first")
    with busy_processes():
        assert run_world(world, folder / f"{make.__name__}-busy").trace == first.trace
