# SPDX-License-Identifier: GPL-3.0-or-later
"""Strangers at the gateway (docs/plant.md): the centre notices nothing, the log counts what it leaves out."""

from dataclasses import replace
from pathlib import Path

import pytest

from front_strangers import Strangers
from plant_judge import judge, lines_a_minute
from plant_seeds import calm
from plant_trials import run_world, spoiled_copy
from plant_world import Run


@pytest.fixture(scope="module")
def visited(programs: Path, linesim_program: Path, folder: Path) -> Run:
    return run_world(replace(calm(3, 75.0), fronts=(Strangers(),)), folder / "visited")


def test_strangers_fill_no_log_and_take_nothing_from_the_centre(visited: Run) -> None:
    log = visited.log("gateway")
    assert len({line for line in log if "127.0.0.9" in line and "connection ends" in line}) > 30
    assert [line for line in log if "lines about connections are left out" in line]
    assert max(count for program, count in lines_a_minute(visited) if program == "rtu-iec104") > 200
    assert judge(visited) == []


def test_the_judge_sees_more_lines_than_strangers_may_make(visited: Run, tmp_path: Path) -> None:
    spoiled = spoiled_copy(visited, tmp_path, "watch", visited.told("watch"))
    with (tmp_path / "gateway.log").open("a") as log:
        log.write("2026-01-01T00:00:30.000Z rtu-iec104 info: connected\n" * 120)
    assert [violation.rule for violation in judge(spoiled)] == ["log"]
