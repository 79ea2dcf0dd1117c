# SPDX-License-Identifier: GPL-3.0-or-later
"""A client of IEC 61850 in the plant (docs/plant.md): its reports say what the devices held."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from front_counter import OBJECT, Counter
from front_journal import Journal
from front_mms import CLIENT, Mms
from plant_judge import judge
from plant_run import story
from plant_seeds import calm, troubled
from plant_trials import Lines, run_world, spoiled_copy
from plant_world import Change, Fault, Run, World

SECONDS = 60.0
TROUBLED_S = 200.0
CHANGE, GENERAL = 1, 16
REGISTER = "OpenRTUCA2003/GGIO1$MX$AnIn30001"
INVALID = 2  # as a number of the bits of a quality, the first as the least


@pytest.fixture(scope="module")
def first(programs: Path, linesim_program: Path, folder: Path) -> Run:
    return run_world(replace(calm(1, SECONDS), fronts=(Mms(), Counter())), folder / "first")


def test_the_client_is_told_what_the_devices_hold(first: Run) -> None:
    assert judge(first) == []
    reasons = [line["reason"] for line in first.told(CLIENT) if "reason" in line]
    assert reasons.count(CHANGE) > 30
    assert {CHANGE, GENERAL} <= set(reasons)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 9])
def test_what_must_hold_of_reports(programs: Path, linesim_program: Path, folder: Path, seed: int) -> None:
    world = troubled(seed, TROUBLED_S, 5.0, (Mms(), Counter(), Journal()))
    assert "rtu-iec61850" in {fault.of for fault in world.faults}
    ran = run_world(world, folder / f"troubled-{seed}")
    violations = judge(ran)
    assert not violations, story(ran, violations)


def test_a_point_that_was_not_read_yet_is_told_when_it_is(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    """The client asks for all between the start and the first reading, which is as the journal has it."""
    faults = (Fault(30.0, "kill", "rtud"),)
    changes = (Change(15.0, "1.1", "input_registers", 0, 7),)
    world = World(1, SECONDS, changes, faults, fronts=(Mms(), Journal()))
    ran = run_world(world, folder / "unread")
    asked = [line for line in ran.told(CLIENT) if line.get("reason") == GENERAL and line["at"] > 1031e9]
    whole = [line["value"] for line in asked if isinstance(line["value"], list)]
    assert {quality & 3 for _, quality, _ in whole} == {INVALID}
    assert judge(ran) == []


# ---- the judge sees what is wrong ----------------------------------------------------------------------


def changes(lines: Lines) -> list[int]:
    """Of whole measured values."""
    told = [(place, line) for place, line in enumerate(lines) if line.get("reason") == CHANGE]
    return [place for place, line in told if "$MX$" in line["member"] and isinstance(line["value"], list)]


def with_another_value(lines: Lines) -> None:
    lines[changes(lines)[-5]]["value"][0] = [31999]


def with_an_alarm(lines: Lines) -> None:
    place = changes(lines)[-5]
    line = lines[place]
    lines.insert(place, line | {"reason": 2, "value": [line["value"][0], 1, line["value"][2]]})


def without_changes(lines: Lines) -> None:
    for place in reversed(changes(lines)):
        del lines[place]


def with_an_old_change_behind(lines: Lines) -> None:
    of_register = [lines[place] for place in changes(lines) if lines[place]["member"] == REGISTER]
    lines.append(of_register[-2] | {"at": lines[-1]["at"]})


def with_a_freeze_that_is_a_change(lines: Lines) -> None:
    frozen = next(line for line in lines if f"CntVal{OBJECT}" in line.get("member", ""))
    lines.append(frozen | {"at": lines[-1]["at"], "reason": CHANGE})


def without_a_member(lines: Lines) -> None:
    lines[:] = [line for line in lines if not line.get("member", "").endswith("$mag$f")]


def with_an_attribute_of_all(lines: Lines) -> None:
    attribute = next(line for line in lines if line.get("member", "").endswith("$mag$f"))
    attribute["value"] = [[attribute["value"]], 0, 0]


def with_an_end(lines: Lines) -> None:
    lines.append({"at": lines[-1]["at"], "state": "down"})


@pytest.mark.parametrize(
    ("spoil", "rules"),
    [
        (with_another_value, {"true", "no event lost", "same", "recovery"}),
        (with_an_alarm, {"good", "same"}),
        (without_changes, {"no event lost", "same", "recovery"}),
        (with_an_old_change_behind, {"order", "recovery"}),
        (with_a_freeze_that_is_a_change, {"change"}),
        (without_a_member, {"members"}),
        (with_an_attribute_of_all, {"members"}),
        (with_an_end, {"connection"}),
    ],
)
def test_the_judge_sees_of_reports(
    first: Run, tmp_path: Path, spoil: Callable[[Lines], None], rules: set[str]
) -> None:
    lines = first.told(CLIENT)
    spoil(lines)
    found = judge(spoiled_copy(first, tmp_path, CLIENT, lines))
    assert {violation.rule for violation in found} == rules
    assert all(violation.text.startswith("by IEC 61850 ") for violation in found)


@pytest.mark.parametrize(("returned_ms", "is_in_order"), [(1500, True), (3500, False)])
def test_what_a_module_tells_behind_its_loss_is_followed_by_its_return(
    first: Run, tmp_path: Path, returned_ms: int, is_in_order: bool
) -> None:
    """It was stopped as it told a change: as found by seed 2085."""
    lines = first.told(CLIENT)
    last, neighbour = (lines[changes(lines)[place]] for place in (-1, -2))
    value, quality, tag_ms = last["value"]
    told = ((last, 200, 1, 200), (last, 1000, 0, 100), (neighbour, returned_ms, 0, 1400))
    for line, by_ms, is_bad, later_ms in told:
        told_of = [value, quality | is_bad, tag_ms + later_ms]
        lines.append(line | {"at": last["at"] + by_ms * 10**6, "value": told_of})
    spoiled = spoiled_copy(first, tmp_path, CLIENT, lines)
    assert ("order" not in {violation.rule for violation in judge(spoiled)}) is is_in_order
