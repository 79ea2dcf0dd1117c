# SPDX-License-Identifier: GPL-3.0-or-later
"""An outstation below a gateway in the plant (docs/plant.md): events go on, and its state is told last."""

from collections.abc import Callable
from pathlib import Path

import pytest

from front_outstation import POINT, PROCESS, SETTLES_S, STATION_PORT, Below, Outstation
from plant_history import History
from plant_judge import judge
from plant_run import story
from plant_seeds import troubled
from plant_trials import Lines, run_world, spoiled_copy
from plant_world import BEGIN_NS, PORT, Fault, Run, World

SECONDS = 60.0
TROUBLED_S = 200.0
SEED = 34
CUT = Fault(12.0, "cut", f"{STATION_PORT}", for_s=12.0)
INVALID = 128
LATER_NS = BEGIN_NS + 50 * 10**9


@pytest.fixture(scope="module")
def cut(programs: Path, linesim_program: Path, folder: Path) -> Run:
    return run_world(World(SEED, SECONDS, (), (CUT,), fronts=(Outstation(),)), folder / "cut")


def test_what_an_outstation_kept_goes_on(cut: Run) -> None:
    assert judge(cut) == []
    below = Below(History(cut))
    kept = [value for since_s, value in below.held if CUT.at_s < since_s < CUT.end_s]
    told = [told for told in below.told if told.value in kept and told.good]
    assert kept and {one.value for one in told} == set(kept)
    assert all(one.at_s >= CUT.end_s for one in told)


def test_an_old_event_comes_behind_a_newer_one(cut: Run) -> None:
    tags = [told.tag_s for told in Below(History(cut)).told if told.good and told.tag_s is not None]
    assert tags != sorted(tags)


def test_a_state_waits_until_the_loss_of_a_connection_is_known(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    """The centre, which asks nothing, learns after t3 and t1 that it is lost: as found by seed 2035."""
    lost = Fault(8.0, "lost", f"{PORT}")
    ran = run_world(World(3, SECONDS, (), (lost,), fronts=(Outstation(),)), folder / "lost")
    below = Below(History(ran))
    connected_s = min(told.at_s for told in below.told if told.at_s > lost.at_s)
    assert any(lost.at_s < since_s < connected_s - SETTLES_S for since_s, _ in below.held)
    assert judge(ran) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 4])
def test_what_must_hold_of_an_outstation(
    programs: Path, linesim_program: Path, folder: Path, seed: int
) -> None:
    world = troubled(seed, TROUBLED_S, 5.0, (Outstation(),))
    assert {PROCESS, f"{STATION_PORT}"} & {fault.of for fault in world.faults}
    ran = run_world(world, folder / f"troubled-{seed}")
    violations = judge(ran)
    assert not violations, story(ran, violations)


# ---- each rule can fail -------------------------------------------------------------------------------


def is_told(line: dict[str, object], *, later: bool = True) -> bool:
    return line.get("point") == POINT and line["quality"] == 0 and (not later or line["value"] > 3)


def with_another_value(lines: Lines) -> Lines:
    return [{**line, "value": 30000} if is_told(line) else line for line in lines]


def with_the_former_state(lines: Lines) -> Lines:
    """As what an interrogation is told: the value that was there long before."""
    last = [line for line in lines if is_told(line)][-1]
    return [*lines, {**last, "tag": None, "cause": 20, "value": 1}]


def with_an_alarm(lines: Lines) -> Lines:
    last = [line for line in lines if is_told(line)][-1]
    return [*lines, {**last, "at": LATER_NS, "tag": None, "quality": INVALID}, {**last, "at": LATER_NS}]


def without_events(lines: Lines) -> Lines:
    return [line for line in lines if not is_told(line) or line["tag"] is None]


def with_an_old_event_last(lines: Lines) -> Lines:
    """Behind each change comes an event of before."""
    first = next(line for line in lines if is_told(line, later=False) and line["value"] == 1)
    return [
        one for line in lines for one in ((line, {**first, "at": line["at"]}) if is_told(line) else (line,))
    ]


def with_no_end(lines: Lines) -> Lines:
    last = [line for line in lines if is_told(line)][-1]["value"]
    return [line for line in lines if line.get("point") != POINT or line["value"] != last]


@pytest.mark.parametrize(
    ("spoil", "rule"),
    [
        (with_another_value, "true"),
        (with_the_former_state, "true"),
        (with_an_alarm, "good"),
        (without_events, "no event lost"),
        (with_an_old_event_last, "state"),
        (with_no_end, "recovery"),
    ],
)
def test_the_judge_sees_what_must_not_be(
    cut: Run, tmp_path: Path, spoil: Callable[[Lines], Lines], rule: str
) -> None:
    spoiled = spoiled_copy(cut, tmp_path, "consumer", spoil(cut.told("consumer")))
    found = judge(spoiled)
    assert rule in {violation.rule for violation in found if POINT in violation.text}
