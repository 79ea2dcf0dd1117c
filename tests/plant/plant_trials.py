# SPDX-License-Identifier: GPL-3.0-or-later
"""For the tests of the plant: worlds that run without a crash, and runs whose parts have said otherwise."""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import plant_world
from plant_world import BUILD, Run, World

BUSY = 4

Lines = list[dict[str, object]]


def run_world(world: World, folder: Path) -> Run:
    ran = plant_world.run(world, folder)
    assert (ran.code, ran.said) == (0, "")
    return ran


@contextmanager
def busy_processes(count: int = BUSY) -> Iterator[None]:
    with ExitStack() as stack:
        for _ in range(count):
            process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            stack.callback(process.wait)
            stack.callback(process.kill)
        yield


def spoiled_copy(ran: Run, tmp_path: Path, part: str, lines: Lines) -> Run:
    """Where one part has said something else."""
    for kind in ("*.out", "*.log", "*.accounts", "*.refused"):
        for path in ran.folder.glob(kind):
            shutil.copy(path, tmp_path)
    (tmp_path / f"{part}.out").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return Run(ran.world, tmp_path, ran.real_s, ran.code, ran.said)


def run_alone(tmp_path: Path, world: str) -> "subprocess.CompletedProcess[str]":
    (tmp_path / "world").write_text(world)
    command = [BUILD / "plant", "--seed", "1", "--trace", tmp_path / "trace", tmp_path / "world"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def run_script(
    tmp_path: Path, script: str, faults: str = "", at_s: float = 0.0
) -> "subprocess.CompletedProcess[str]":
    (tmp_path / "script").write_text(script)
    words = [sys.executable, "-I", "-S", f"{tmp_path}/script"]
    start = ["start", "script", f"{at_s}", f"{tmp_path}/out", f"{tmp_path}/log", *words]
    return run_alone(tmp_path, f"end\t60\n{faults}" + "\t".join(start) + "\n")
