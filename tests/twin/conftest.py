# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests of the emulated board share."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from nuc980.twin.machine import Machine


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
