# SPDX-License-Identifier: GPL-3.0-or-later
"""The plant under a clock of its own (docs/plant.md): one seed is one trace, whatever else the host does."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

import plant_world
from lab.gateway import remove, run_directory
from plant_world import Run, calm

SECONDS = 60.0
BUSY = 6


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    directory = run_directory()
    yield directory
    remove(directory)


def run(seed: int, folder: Path, seconds: float = SECONDS) -> Run:
    ran = plant_world.run(calm(seed, seconds), folder)
    assert (ran.code, ran.said) == (0, "")
    return ran


@pytest.fixture(scope="module")
def first(programs: Path, linesim_program: Path, folder: Path) -> Run:
    return run(1, folder / "first")


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    with ExitStack() as stack:
        for _ in range(count):
            process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            stack.callback(process.wait)
            stack.callback(process.kill)
        yield


def test_one_seed_one_trace(first: Run, folder: Path) -> None:
    assert run(1, folder / "second").trace == first.trace


def test_one_seed_one_trace_beside_busy_processes(first: Run, folder: Path) -> None:
    with busy_processes(BUSY):
        assert run(1, folder / "busy").trace == first.trace


def test_another_seed_another_trace(first: Run, folder: Path) -> None:
    assert run(2, folder / "other").trace != first.trace


def test_the_last_value_of_each_register_comes_to_the_centre(first: Run) -> None:
    held = {change.point: change.value for change in first.world.changes if change.at_s < SECONDS - 10}
    told = {told["point"]: told["value"] for told in first.told("consumer") if told["kind"] == "value"}
    last = {change.point for change in first.world.changes if change.at_s >= SECONDS - 10}
    assert len(held) > 10
    assert {point: told[point] for point in held.keys() - last} == {
        point: held[point] for point in held.keys() - last
    }


def test_the_trace_is_in_the_order_of_its_time(first: Run) -> None:
    times = [float(line.split(b" ", 1)[0]) for line in first.trace.splitlines()]
    assert times == sorted(times)
    assert times[-1] > SECONDS
    names = {line.split(b" ")[1] for line in first.trace.splitlines()}
    assert {b"linesim#1", b"rtud#1", b"rtu-modbus-1#1", b"rtu-iec104#1", b"rtu-centre#1"} <= names
