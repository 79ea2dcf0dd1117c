# SPDX-License-Identifier: GPL-3.0-or-later
"""Calendar clocks of the plant that drift and leap (docs/plant.md): each time tag is right."""

from dataclasses import replace
from pathlib import Path

import pytest

from plant_history import WALL_NS
from plant_judge import judge
from plant_seeds import calm, with_a_clock
from plant_trials import Lines, run_script, run_world, spoiled_copy
from plant_world import Change, Fault, Run, World

SECONDS = 60.0
CHANGES = tuple(Change(8.0 + 3.0 * number, "1.1", "input_registers", 0, number) for number in range(1, 14))
LEAP_S = 27.0

CLOCKS = """
import ctypes, time
def ahead(): return time.time() - time.monotonic() - 1767225600 + 1000
class Timex(ctypes.Structure): _fields_ = [("modes", ctypes.c_uint), ("rest", ctypes.c_byte * 400)]
begun = time.monotonic()
for _ in range(6):
    state = ctypes.CDLL(None).adjtimex(ctypes.byref(Timex()))
    print(round(time.monotonic() - begun, 1), round(ahead(), 6), state)
    time.sleep(0.6)
"""


def test_a_clock_that_drifts(programs: Path, tmp_path: Path) -> None:
    assert run_script(tmp_path, CLOCKS, "drift\t-200\n", at_s=10.0).returncode == 0
    ahead = [float(line.split()[1]) for line in (tmp_path / "out").read_text().splitlines()]
    assert ahead == pytest.approx([-0.002 - 0.00012 * number for number in range(6)], abs=2e-6)


@pytest.mark.parametrize(
    ("by", "states"), [("-1", ["1", "1", "3", "3", "4", "4"]), ("1", ["2", "2", "4", "4", "4", "4"])]
)
def test_a_leap_second(programs: Path, tmp_path: Path, by: str, states: list[str]) -> None:
    """As Linux tells it: one is due, it is now, it was (TIME_INS or TIME_DEL, TIME_OOP, TIME_WAIT)."""
    assert run_script(tmp_path, CLOCKS, f"leap\t1\t{by}\n").returncode == 0
    lines = [line.split() for line in (tmp_path / "out").read_text().splitlines()]
    assert [line[2] for line in lines] == states
    assert [float(line[1]) for line in lines] == [0.0] * 2 + [float(by)] * 4


def run(folder: Path, by_s: float, drift_ppm: int) -> Run:
    leap = Fault(LEAP_S, "leap", "clock", by_s=by_s)
    return run_world(World(2, SECONDS, CHANGES, (leap,), drift_ppm=drift_ppm), folder)


@pytest.fixture(scope="module")
def leapt(programs: Path, linesim_program: Path, folder: Path) -> Run:
    return run(folder / "inserted", -1.0, 500)


def test_tags_beside_a_leap_second_are_right(leapt: Run, folder: Path) -> None:
    assert [line for line in leapt.log("gateway") if "a leap second was inserted" in line]
    assert judge(leapt) == []
    assert judge(run(folder / "left-out", 1.0, -500)) == []


def test_the_judge_sees_tags_that_do_not_leap(leapt: Run, tmp_path: Path) -> None:
    """Which are of a second later then, before it was there."""
    lines: Lines = leapt.told("consumer")
    for line in lines:
        if line.get("tag") and line["tag"] > WALL_NS + (LEAP_S + 3.0) * 1e9:
            line["tag"] -= 2 * 10**9
    spoiled = spoiled_copy(leapt, tmp_path, "consumer", lines)
    assert "true" in {violation.rule for violation in judge(spoiled)}


def test_the_judge_sees_tags_of_a_clock_that_is_followed_no_more(leapt: Run) -> None:
    """Of a calendar that is said to go slower than it does: soon each tag is a second early."""
    world = replace(leapt.world, drift_ppm=50_000)
    assert "true" in {violation.rule for violation in judge(replace(leapt, world=world))}


def test_what_changes_beside_a_leap_second_is_left_out() -> None:
    world = with_a_clock(calm(3, 200.0))
    (leap,) = world.faults
    assert leap.at_s == int(leap.at_s)
    assert min(abs(change.at_s - leap.at_s) for change in world.changes) > 3.0
