# SPDX-License-Identifier: GPL-3.0-or-later
"""What the programs of a plant hold (docs/plant.md): descriptors and memory stay what they were."""

from dataclasses import replace
from pathlib import Path

import pytest

from plant_judge import judge
from plant_seeds import calm
from plant_trials import run_script, run_world, spoiled_copy
from plant_world import Run

GROWS = """
import time
kept = []
for _ in range(50):
    kept.append((open("/dev/null"), bytearray(b"x" * 100000)))
    time.sleep(1)
"""


@pytest.fixture(scope="module")
def ran(programs: Path, linesim_program: Path, folder: Path) -> Run:
    return run_world(calm(3, 45.0), folder / "held")


def test_a_process_that_grows_is_seen(programs: Path, tmp_path: Path) -> None:
    assert run_script(tmp_path, GROWS).returncode == 0
    name, life, first, most, first_kib, last_kib = (tmp_path / "world.accounts").read_text().split()
    assert (name, life) == ("script", "1")
    assert 15 < int(most) - int(first) <= 30
    assert int(last_kib) - int(first_kib) > 2000


def test_programs_hold_no_more_in_the_end(ran: Run) -> None:
    assert {"rtud", "rtu-modbus-1", "rtu-iec104", "rtu-centre"} <= {one.process for one in ran.accounts}
    assert judge(ran) == []


@pytest.mark.parametrize("line", ["rtu-web 1 10 40 2000 2000", "rtu-web 1 10 12 2000 9000"])
def test_the_judge_sees_what_grows(ran: Run, tmp_path: Path, line: str) -> None:
    spoiled = spoiled_copy(ran, tmp_path, "watch", ran.told("watch"))
    (tmp_path / "world.accounts").write_text(f"{line}\n")
    assert [violation.rule for violation in judge(replace(spoiled))] == ["bounded"]
