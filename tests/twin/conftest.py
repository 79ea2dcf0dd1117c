# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests of the emulated board share."""

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from nuc980.twin.machine import Machine

HERE = Path(__file__).parent
PROBES = HERE / "probes"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """None of them is quick: they need `make qemu uboot`. `make test-twin` runs them alone."""
    for item in items:
        if item.path.is_relative_to(HERE):
            item.add_marker(pytest.mark.slow)


@pytest.fixture
def board(qemu: Path) -> Iterator[Callable[..., Machine]]:
    """Starts machines, as Machine does but for the program; they end with the test."""
    machines: list[Machine] = []

    def start(*arguments: str | Path, **settings: object) -> Machine:
        machines.append(Machine(qemu, *arguments, **settings))
        return machines[-1]

    yield start
    for machine in machines:
        machine.close()


@pytest.fixture
def bus(board: Callable[..., Machine]) -> Machine:
    """A board whose processor stands still: the registers, and time that only step() moves."""
    return board(registers=True)


@pytest.fixture
def reborn() -> Iterator[Callable[[Machine], Machine]]:
    """Moves a machine's state through a file into a new one, and returns that: Machine.reborn."""
    machines: list[Machine] = []

    def move(machine: Machine) -> Machine:
        machines.append(machine.reborn())
        return machines[-1]

    yield move
    for machine in machines:
        machine.close()


@pytest.fixture(scope="session")
def probes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the bare-metal probes, built: NAME.bin for -bios, NAME.elf for -kernel."""
    folder = tmp_path_factory.mktemp("probes")
    done = subprocess.run(
        ["make", "-s", "-f", PROBES / "Makefile", f"O={folder}"], capture_output=True, text=True
    )
    if done.returncode:
        pytest.fail(f"the probes do not build:\n{done.stderr}", pytrace=False)
    return folder
