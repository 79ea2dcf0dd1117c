# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory that is refused (docs/plant.md): who runs runs on, who begins says so and is started again."""

from dataclasses import replace
from pathlib import Path

import pytest

from front_journal import Journal
from plant_judge import judge
from plant_seeds import calm, stored
from plant_trials import run_script, run_world, spoiled_copy
from plant_world import Fault, Run

SECONDS = 60.0
SCRIPT = """
import time
for _ in range(3):
    try:
        print(len(bytearray(1 << 20)))
    except MemoryError:
        print("none")
    time.sleep(1)
"""


def test_memory_is_refused_for_a_while(programs: Path, tmp_path: Path) -> None:
    assert run_script(tmp_path, SCRIPT, "memory\tscript\t0\t0\t1.5\n").returncode == 0
    assert (tmp_path / "out").read_text() == "1048576\nnone\n1048576\n", (tmp_path / "log").read_text()


def run(folder: Path, *faults: Fault) -> Run:
    return run_world(replace(calm(3, SECONDS), faults=faults, fronts=(Journal(),)), folder)


def test_who_runs_needs_no_more_memory(programs: Path, linesim_program: Path, folder: Path) -> None:
    names = ("rtu-modbus-1", "rtu-iec104", "rtu-journal", "rtud")
    faults = [Fault(10.0 + 5 * number, "memory", name, 3, for_s=4.0) for number, name in enumerate(names)]
    ran = run(folder / "runs", *faults)
    assert ran.trace.count(b" gets no memory ") == len(names)
    assert judge(ran) == []


@pytest.fixture(scope="module")
def starved(programs: Path, linesim_program: Path, folder: Path) -> Run:
    """A module, and later all of them with rtud."""
    faults = (Fault(12.0, "kill", "rtu-journal", 1, for_s=3.0), Fault(25.0, "kill", "rtud", 1, for_s=3.0))
    return run(folder / "begins", *faults)


def test_who_begins_says_so_and_is_started_again(starved: Run) -> None:
    assert starved.trace.count(b"rtu-journal#2 begins without memory") == 1
    assert [line for line in starved.log("gateway") if "rtu-journal: " in line and "out of memory" in line]
    assert judge(starved) == []


def test_the_judge_sees_who_does_not_say_why(starved: Run, tmp_path: Path) -> None:
    spoiled = spoiled_copy(starved, tmp_path, "watch", starved.told("watch"))
    kept = [line for line in starved.log("gateway") if "memory" not in line]
    (tmp_path / "gateway.log").write_text("".join(f"{line}\n" for line in kept))
    assert {violation.rule for violation in judge(spoiled)} == {"start"}


def test_worlds_with_a_disk_refuse_memory() -> None:
    faults = stored(4, 300.0, 8.0).faults
    assert [fault for fault in faults if fault.kind == "memory"]
    assert [fault for fault in faults if fault.kind == "kill" and fault.for_s]
