# SPDX-License-Identifier: GPL-3.0-or-later
"""What is too old goes, and old tracks are thinned by distance; in small steps: intake does not wait."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from openrtu_tools.centre.areas import distance_m
from openrtu_tools.centre.codes import INVALID
from openrtu_tools.centre.records import ENDED
from openrtu_tools.centre.rollup import mark
from openrtu_tools.centre.settings import Keep
from openrtu_tools.centre.store import Database, put

ROWS_AT_ONCE = 2000
DAY_NS = 86400 * 10**9


@dataclass(frozen=True, slots=True)
class Mark:
    """A place of a track, as far as thinning needs it."""

    at_ns: int
    latitude: int  # 1e-7 degree
    longitude: int
    quality: int

    def near(self, other: Mark, metres: float) -> bool:
        a, b = ((each.latitude / 1e7, each.longitude / 1e7) for each in (self, other))
        return distance_m(a, b) < metres


def superfluous(marks: Iterable[Mark], metres: float, gap_ns: int) -> Iterator[Mark]:
    """Those that are nearer than this to the last that is kept.

    The last one is kept, and so is each without which a gap would come, go or grow.

    >>> way = [Mark(second * 10**9, second * 10, 0, 0) for second in range(5)]
    >>> [mark.at_ns // 10**9 for mark in superfluous(way, 1, 60 * 10**9)]
    [1, 2, 3]
    >>> [mark.at_ns // 10**9 for mark in superfluous(way, 1, 2 * 10**9)]
    [1, 3]
    """
    kept: Mark | None = None
    here: Mark | None = None
    for following in marks:
        if here:
            if (
                kept
                and kept.quality & INVALID == here.quality & INVALID == following.quality & INVALID
                and following.at_ns - kept.at_ns <= gap_ns
                and kept.near(here, metres)
            ):
                yield here
            else:
                kept = here
        here = following


def _delete(database: Database, table: str, key: str, where: str, *values: int) -> int:
    """So many rows at most; how many it was."""
    return database.execute(
        f"DELETE FROM {table} WHERE ({key}) IN"
        f" (SELECT {key} FROM {table} WHERE {where} LIMIT {ROWS_AT_ONCE})",
        values,
    ).rowcount


def _delete_history(database: Database, before_ns: int) -> int:
    """So many rows at most; how many it was."""
    gone = list(
        database.execute(
            "DELETE FROM history WHERE id IN (SELECT id FROM history WHERE at_ns < ? LIMIT ?)"
            " RETURNING point, at_ns",
            (before_ns, ROWS_AT_ONCE),
        )
    )
    mark(database, ((row["point"], row["at_ns"]) for row in gone))
    return len(gone)


class Keeper:
    """The work of a round, as steps: each is a transaction of its own and says whether it has more to do."""

    def __init__(
        self,
        keep: Keep,
        gap_s: float,
        now_ns: int | None = None,
        drop_weeks: Callable[[Database, str, int], None] | None = None,
    ) -> None:
        self.keep = keep
        self.drop_weeks = drop_weeks  # of a store that keeps history and tracks by weeks
        self.gap_ns = int(gap_s * 1e9)
        self.now_ns = time.time_ns() if now_ns is None else now_ns

    def _before(self, days: float) -> int:
        return self.now_ns - int(days * DAY_NS)

    def old_rows(self, database: Database) -> bool:
        """All but tracks; of a store by weeks, tracks too."""
        events_days = self.keep.events_days
        if self.drop_weeks:
            for table, days in (("history", events_days), ("track", self.keep.tracks_days)):
                if days is not None:
                    self.drop_weeks(database, table, self._before(days))
        ended = ", ".join(str(int(state)) for state in ENDED)
        tables = (
            ("odd_tags", "point, tag_ns, value, quality", "received_ns < ?", self.keep.events_days),
            ("alarms", "id", "gone_ns < ?1 AND acknowledged_ns < ?1", self.keep.alarms_days),
            ("comings", "alarm, at_ns", "at_ns < ?", self.keep.alarms_days),
            ("audit", "id", "at_ns < ?", self.keep.audit_days),
            ("commands", "id", f"changed_ns < ? AND state IN ({ended})", self.keep.audit_days),
        )
        more = False
        if events_days is not None and not self.drop_weeks:
            more = _delete_history(database, self._before(events_days)) == ROWS_AT_ONCE
        return more | any(
            [
                _delete(database, table, key, where, self._before(days)) == ROWS_AT_ONCE
                for table, key, where, days in tables
                if days is not None
            ]
        )

    def track(self, database: Database, point: int) -> bool:
        """Of one vehicle."""
        more = False
        if self.keep.tracks_days is not None and not self.drop_weeks:
            before = self._before(self.keep.tracks_days)
            more = (
                _delete(database, "track", "point, at_ns", "point = ? AND at_ns < ?", point, before)
                == ROWS_AT_ONCE
            )
        if self.keep.thin_m is not None:
            more |= self._thin(database, point, self.keep.thin_m)
        return more

    def _thin(self, database: Database, point: int, metres: float) -> bool:
        """From the last place that an earlier step has kept."""
        row = database.execute("SELECT until_ns FROM thinned WHERE point = ?", (point,)).fetchone()
        begin, end = row[0] if row else 0, self._before(self.keep.thin_after_days)
        marks = [
            Mark(*each)
            for each in database.execute(
                "SELECT at_ns, latitude, longitude, quality FROM track"
                " WHERE point = ? AND at_ns BETWEEN ? AND ? ORDER BY at_ns LIMIT ?",
                (point, begin, end, ROWS_AT_ONCE),
            )
        ]
        if len(marks) < 3:
            return False
        away = [(point, mark.at_ns) for mark in superfluous(marks, metres, self.gap_ns)]
        database.executemany("DELETE FROM track WHERE point = ? AND at_ns = ?", away)
        put(database, "thinned", ("point", "until_ns"), (point, marks[-1].at_ns), "point")
        return len(marks) == ROWS_AT_ONCE
