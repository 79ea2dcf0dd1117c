# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the clock behind a time tag is believed, and whether an event is older than what is known.

A tag says when something happened, by the station's clock. An event may be old because it waited in the
station's queue: that alone is no reason to doubt the clock. docs/control-centre.md, "Times".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from openrtu_tools.centre.codes import Cause
from openrtu_tools.centre.records import Record

MINUTE_NS = 60 * 10**9
LIMIT_NS = MINUTE_NS  # a clock that is set is not so far off
DAY_NS = 86400 * 10**9


class Told(NamedTuple):
    """What a point's state is of."""

    at_ns: int = 0
    received_ns: int = 0
    is_event: bool = False
    is_tag: bool = False  # at_ns is a tag that was believed


@dataclass(slots=True)
class Clock:
    """Of a station's common address: behind one station there may be many devices."""

    wrong: bool = False
    session_ns: int = 0  # what came since is of the present connection
    news: bool = False  # on it an interrogation has shown that what seemed old had not waited
    ahead_ns: int = 0  # of the last tag
    _minute: int = -1
    _most_ns: int = 0
    _before_ns: int = 0

    def be_of_session(self, begin_ns: int) -> None:
        if begin_ns != self.session_ns:
            self.session_ns, self.news = begin_ns, False

    def believes(self, record: Record, before: Told) -> bool:
        """Of a record that is tagged. Wrong is what no queue explains."""
        self.ahead_ns = ahead_ns = record.tag_ns - record.received_ns
        if record.cause == Cause.SPONTANEOUS:
            self._see(record.received_ns // MINUTE_NS, ahead_ns)
        if ahead_ns >= -LIMIT_NS:
            self.wrong = ahead_ns > LIMIT_NS
        elif before.is_tag and before.received_ns >= self.session_ns:
            went_back = record.tag_ns < before.at_ns - LIMIT_NS
            if record.is_event:
                self.wrong |= went_back and before.is_event
            else:  # it says what is now, so it did not wait
                self.wrong |= went_back or (ahead_ns < -DAY_NS and record.tag_ns > before.at_ns)
        return not self.wrong

    def _see(self, minute: int, ahead_ns: int) -> None:
        """An event that waited looks as if the clock were behind: the most of two minutes counts."""
        if minute == self._minute:
            self._most_ns = max(self._most_ns, ahead_ns)
        else:
            follows = minute == self._minute + 1
            self._before_ns = self._most_ns if follows else ahead_ns
            self._minute, self._most_ns = minute, ahead_ns

    @property
    def seen_ns(self) -> int | None:
        """How far it is ahead, by what came with the least delay; None: it has told no event."""
        if self.wrong:
            return self.ahead_ns
        return max(self._most_ns, self._before_ns) if self._minute >= 0 else None

    def is_old(self, record: Record, at_ns: int, before: Told) -> bool:
        """An event of before what is known, as far as can be told: the state is not its.

        A station tells the events of a point in their order. An answer may overtake what waits.
        """
        if not record.is_event or not record.tagged or not before.at_ns or self.news:
            return False
        if before.is_event and before.received_ns >= self.session_ns:
            return False
        return self.wrong or at_ns < before.at_ns
