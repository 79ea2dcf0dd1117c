# SPDX-License-Identifier: GPL-3.0-or-later
"""How long to wait: so many seconds on an idle machine, and longer on a busy one."""

from __future__ import annotations

import os
import time

LOOK_S = 1.0  # who is woken by what arrives looks at the deadline as often, since it moves


def slowness() -> float:
    """How many processes of this machine share a processor, of the last minute's average; at least 1."""
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


def stretch() -> float:
    """What a time-out has to be multiplied by that is long enough where two processes share a processor."""
    return max(1.0, slowness() / 2)


class Deadline:
    """The end of a wait that takes at most `seconds` on an idle machine.

    It moves with the machine's load: what a process does in a second takes ten where ten share a processor.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._begin = time.monotonic()

    @property
    def waited(self) -> float:
        """Seconds since the begin."""
        return time.monotonic() - self._begin

    @property
    def left(self) -> float:
        """Seconds until the end as it is now; not above 0 when it is over."""
        return self._seconds * slowness() - self.waited

    @property
    def over(self) -> bool:
        return self.left <= 0
