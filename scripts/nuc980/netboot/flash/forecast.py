# SPDX-License-Identifier: GPL-3.0-or-later
"""How long a flash takes: before it begins by what its steps move, then by what was measured so far."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from nuc980.netboot.plan import Cost, Step
from nuc980.netboot.progress import duration

# Of a slow board; bytes/s, seconds.
NETWORK_SPEED, READ_SPEED, SUM_SPEED, WRITE_SPEED = 500_000, 3_000_000, 5_000_000, 1_000_000
ERASE_SECONDS = 0.005
COMMAND_SECONDS = 0.05  # until each part of it comes back through the adapter

CHARACTER_BITS = 10  # 8N1
TYPED = 4  # a line goes over as typed, as backspaces, as U-Boot has it, and as its end with the prompt
WEIGHT = 10.0  # seconds of measuring that count as much as what was forecast


class Forecast:
    """Seconds for some steps. baud: of the serial line, bit/s; clock: seconds."""

    def __init__(self, steps: Iterable[Step], baud: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._baud, self._clock = baud, clock
        self.planned: dict[str, float] = defaultdict(float)  # by phase, in the order they begin
        self._done: dict[str, float] = defaultdict(float)  # of that
        self._measured: dict[str, float] = defaultdict(float)
        self._at_hand: tuple[Step, float] | None = None  # and when it began
        for step in steps:
            self.planned[step.phase] += self.seconds(step)

    def seconds(self, step: Step) -> float:
        """What one step is expected to take."""
        commands = step.commands()
        typed = TYPED * sum(map(len, commands))
        return seconds_of(step.cost(), self._baud) + self._line(typed) + COMMAND_SECONDS * len(commands)

    def _line(self, characters: int) -> float:
        return characters * CHARACTER_BITS / self._baud

    def __str__(self) -> str:
        phases = ", ".join(f"{name} {duration(seconds)}" for name, seconds in self.planned.items())
        return f"about {duration(sum(self.planned.values()))}: {phases}"

    @contextmanager
    def measured(self, step: Step) -> Iterator[None]:
        """Around a step that is done."""
        began = self._clock()
        self._at_hand = step, began
        try:
            yield
        finally:
            self._at_hand = None
            self._done[step.phase] += self.seconds(step)
            self._measured[step.phase] += self._clock() - began

    def left(self, share: float) -> float:
        """Seconds to the end. share: how much of the step at hand is done."""
        done, measured = dict(self._done), dict(self._measured)
        if self._at_hand:
            step, began = self._at_hand
            done[step.phase] = done.get(step.phase, 0.0) + share * self.seconds(step)
            measured[step.phase] = measured.get(step.phase, 0.0) + self._clock() - began
        return sum(
            max(planned - done.get(phase, 0.0), 0.0)
            * (WEIGHT + measured.get(phase, 0.0))
            / (WEIGHT + done.get(phase, 0.0))
            for phase, planned in self.planned.items()
        )


def seconds_of(cost: Cost, baud: int) -> float:
    """What is moved takes so long; baud: of the serial line, bit/s."""
    return (
        cost.network / NETWORK_SPEED
        + cost.read / READ_SPEED
        + cost.summed / SUM_SPEED
        + cost.erased * ERASE_SECONDS
        + cost.written / WRITE_SPEED
        + cost.printed * CHARACTER_BITS / baud
        + cost.seconds
    )
