# SPDX-License-Identifier: GPL-3.0-or-later
"""How often somebody may guess a password, and how many guesses are computed at a time."""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

from openrtu_tools.centre.errors import RefusedError

Answer = TypeVar("Answer")
FIRST_WAIT_S, LONGEST_WAIT_S = 30.0, 900.0
FORGET_S = 900.0  # after the last wait
COUNTED_MOST = 10_000
FULL_AGAIN_S = 2


@dataclass(frozen=True)
class Limit:
    """So many wrong ones are free; each more doubles the wait."""

    key: tuple[str, ...]
    free: int

    def wait_s(self, wrong: int) -> float:
        if wrong < self.free:
            return 0.0
        return min(FIRST_WAIT_S * 2.0 ** min(wrong - self.free, 16), LONGEST_WAIT_S)


@dataclass
class Count:
    wrong: int = 0
    until_s: float = 0.0
    last_s: float = 0.0


class Tries:
    """Wrong passwords by keys: of an address, of a name, of both, of a session.

    >>> now = 0.0
    >>> tries, limit = Tries(lambda: now), [Limit(("a",), 2)]
    >>> [tries.begin(limit), tries.begin(limit)]
    [None, None]
    >>> tries.begin(limit)
    Traceback (most recent call last):
    openrtu_tools.centre.errors.RefusedError: too many wrong passwords: wait 30 s
    >>> tries.undo(limit)  # one was right
    >>> tries.begin(limit)
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._counts: OrderedDict[tuple[str, ...], Count] = OrderedDict()

    def begin(self, limits: Sequence[Limit]) -> None:
        """Counts a try as a wrong one before it is looked at: of many at once no more are looked at than of
        one after the other. Raises RefusedError."""
        now_s = self._clock()
        counts = [self._count(limit.key, now_s) for limit in limits]
        wait_s = max(count.until_s - now_s for count in counts)
        if wait_s > 0:
            raise RefusedError(429, "guesses", f"too many wrong passwords: wait {wait_s:.0f} s", wait_s)
        for limit, count in zip(limits, counts, strict=True):
            count.wrong += 1
            count.until_s = now_s + limit.wait_s(count.wrong)

    def undo(self, limits: Sequence[Limit]) -> None:
        """It was none."""
        for limit in limits:
            if count := self._counts.get(limit.key):
                count.wrong = max(count.wrong - 1, 0)
                if count.wrong < limit.free:
                    count.until_s = 0.0

    def forget(self, limit: Limit) -> None:
        self._counts.pop(limit.key, None)

    def _count(self, key: tuple[str, ...], now_s: float) -> Count:
        """The one that nobody asked of for longest gives way: a flood of names frees none that is in use."""
        count = self._counts.get(key)
        if count is None or now_s > max(count.until_s, count.last_s) + FORGET_S:
            count = self._counts[key] = Count()
        count.last_s = now_s
        self._counts.move_to_end(key)
        if len(self._counts) > COUNTED_MOST:
            self._counts.popitem(last=False)
        return count


class Pool:
    """Threads for what is dear, and so many places before them."""

    def __init__(self, threads: int, places: int) -> None:
        self._threads = ThreadPoolExecutor(threads, "password")
        self._free = places

    def take(self) -> None:
        """A place, before anything is awaited. Raises RefusedError."""
        if not self._free:
            raise RefusedError(429, "logins", "too many log in at this moment: try again", FULL_AGAIN_S)
        self._free -= 1

    def give_back(self) -> None:
        self._free += 1

    async def do(self, work: Callable[[], Answer]) -> Answer:
        return await asyncio.get_running_loop().run_in_executor(self._threads, work)
