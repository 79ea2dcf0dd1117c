# SPDX-License-Identifier: GPL-3.0-or-later
"""Variables that a program retains, in the plant (docs/plant.md): behind a power cut they are whole."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from front_disk import Disk
from front_kept import MIXED, SHOWN, Kept
from plant_judge import judge
from plant_trials import Lines, run_world, spoiled_copy
from plant_world import JOURNAL, Fault, Run, World

SECONDS = 50.0
CUT = Fault(25.3, "blackout", JOURNAL, calls=7)
INVALID = 128


@pytest.fixture(scope="module")
def cut(programs: Path, linesim_program: Path, folder: Path) -> Run:
    return run_world(World(1, SECONDS, (), (CUT,), fronts=(Disk(), Kept())), folder / "kept")


def counts(lines: Lines) -> list[int]:
    return [
        line["value"] for line in lines if line.get("point") == SHOWN and line["tag"] and not line["quality"]
    ]


def test_a_program_goes_on_behind_a_power_cut(cut: Run) -> None:
    assert judge(cut) == []
    told = counts(cut.told("consumer"))
    back = [before - value for before, value in pairwise(told) if value <= before]
    assert len(back) <= 1 and all(by <= 5 for by in back)
    assert max(told) > 30


# ---- each rule can fail -------------------------------------------------------------------------------


def with_a_mixture(lines: Lines) -> Lines:
    return [{**line, "value": 1} if line.get("point") == MIXED else line for line in lines]


def with_a_new_begin(lines: Lines) -> Lines:
    late = [line for line in lines if line.get("point") == SHOWN][-4:]
    return [{**line, "value": 2} if line in late else line for line in lines]


def with_a_loss(lines: Lines) -> Lines:
    last = [line for line in lines if line.get("point") == SHOWN][-1]
    return [*lines, {**last, "quality": INVALID}]


@pytest.mark.parametrize(
    ("spoil", "rule"), [(with_a_mixture, "kept"), (with_a_new_begin, "kept"), (with_a_loss, "recovery")]
)
def test_the_judge_sees_what_must_not_be(
    cut: Run, tmp_path: Path, spoil: Callable[[Lines], Lines], rule: str
) -> None:
    spoiled = spoiled_copy(cut, tmp_path, "consumer", spoil(cut.told("consumer")))
    assert rule in {violation.rule for violation in judge(spoiled)}
