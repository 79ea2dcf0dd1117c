# SPDX-License-Identifier: GPL-3.0-or-later
"""Variables that a program retains, in the plant (docs/plant.md): behind a power cut they are whole."""

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from front_disk import Disk
from front_kept import MIXED, SHOWN, Kept, lost_from_s
from plant_excuses import JOURNAL_S, RECORDED_S
from plant_history import History
from plant_judge import judge
from plant_trials import Lines, run_world, spoiled_copy
from plant_world import JOURNAL, Fault, Run, World

SECONDS = 50.0
CUT = Fault(25.3, "blackout", JOURNAL, calls=7)
KILL = Fault(100.0, "kill", "rtud")
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


@pytest.mark.parametrize(("kind", "from_s"), [("full", KILL.at_s - JOURNAL_S), ("worn", -math.inf)])
def test_only_a_worn_disk_may_give_nothing_back(tmp_path: Path, kind: str, from_s: float) -> None:
    """A full one gives back what was written before, for however long it was full."""
    faults = (Fault(KILL.at_s - JOURNAL_S + RECORDED_S, kind, "disk", for_s=80.0), KILL)
    history = History(Run(World(1, 200.0, (), faults), tmp_path, 0.0, 0, ""))
    assert lost_from_s(history, KILL) == from_s


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
