# SPDX-License-Identifier: GPL-3.0-or-later
"""What the history was in each slot of time, so that years are drawn without reading them.

A slot is 2^44 ns (4.9 h); one in which much came has its parts of 2^38 ns (4.6 min), too. One that is not in
`unrolled` is summed up in `rollup`, exactly as the history has it; of one that is, the history itself must be
read. Whoever adds to the history or takes away from it marks the slots in the same transaction; the rest is
done when there is time.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable

from openrtu_tools.centre.codes import INVALID
from openrtu_tools.centre.store import Database
from openrtu_tools.codes import QUALITIES

SLOT, PART = 44, 38  # powers of two, in ns
MUCH = 1 << (SLOT - PART)  # rows of a slot; with fewer, its parts would be as many as they
POINTS_AT_ONCE = 100
STEP_S = 0.02  # of the writer's time
REST_NS = 60 * 10**9  # a slot is summed up once it is over for so long

VALID = f"history.quality & {INVALID} = 0"


def _all_of(quality: str) -> str:
    """What any row had."""
    return " | ".join(f"max({quality} & {bit})" for bit in QUALITIES.values())


# Of rows of the history; a value that is not valid has no part in what is the lowest and the highest.
OF_HISTORY = (
    f"min(CASE WHEN {VALID} THEN value END) AS low, max(CASE WHEN {VALID} THEN value END) AS high,"
    f" count(*) AS number, {_all_of('history.quality')} AS quality"
)
OF_ROLLUP = (
    "min(low) AS low, max(high) AS high, CAST(sum(number) AS BIGINT) AS number,"
    f" {_all_of('quality')} AS quality"
)


def mark(database: Database, rows: Iterable[tuple[int, int]]) -> None:
    """Points and times of which the history is another one from now on."""
    marked = {(point, at_ns >> SLOT) for point, at_ns in rows}
    if marked:
        database.insert("unrolled", ("point", "slot"), sorted(marked))


def mark_time(database: Database, begin_ns: int, end_ns: int) -> None:
    """All of a time, of every point. What is not summed up is marked already."""
    database.execute(
        "INSERT INTO unrolled (point, slot) SELECT point, slot FROM rollup"
        f" WHERE shift = {SLOT} AND slot BETWEEN ? AND ? ON CONFLICT DO NOTHING",
        (begin_ns >> SLOT, end_ns >> SLOT),
    )


class Rollup:
    """Of the writer's thread: which slots are marked already, and summing up."""

    def __init__(self) -> None:
        self._known: set[tuple[int, int]] = set()  # marked
        self._new: set[tuple[int, int]] = set()  # in the transaction under way

    def begin(self) -> None:
        self._new.clear()

    def stored(self) -> None:
        self._known |= self._new

    def add(self, database: Database, rows: Iterable[tuple[int, int]]) -> None:
        """As mark, for what comes all the time."""
        found = {(point, at_ns >> SLOT) for point, at_ns in rows} - self._known - self._new
        if found:
            mark(database, ((point, slot << SLOT) for point, slot in found))
            self._new |= found

    def step(self, database: Database, among: str, now_ns: int | None = None) -> bool:
        """Sums up some of what is marked and over; whether there is more. `among`: the store's."""
        over = ((time.time_ns() if now_ns is None else now_ns) - REST_NS) >> SLOT
        end = time.monotonic() + STEP_S
        while (slot := self._oldest(database)) is not None and slot < over:
            self._sum(database, among, slot)
            if time.monotonic() > end:
                return True
        return False

    @staticmethod
    def _oldest(database: Database) -> int | None:
        [(slot,)] = database.execute("SELECT min(slot) FROM unrolled")
        return None if slot is None else int(slot)

    def _sum(self, database: Database, among: str, slot: int) -> None:
        """Of some points."""
        sql = "SELECT point FROM unrolled WHERE slot = ? ORDER BY point LIMIT ?"
        points = [row[0] for row in database.execute(sql, (slot, POINTS_AT_ONCE))]
        self._known -= {(point, slot) for point in points}
        these, wanted = f"point {among}", json.dumps(points)
        first, last = slot << SLOT - PART, (slot + 1 << SLOT - PART) - 1
        parts = f"DELETE FROM rollup WHERE shift = {PART} AND slot BETWEEN ? AND ? AND {these}"
        database.execute(parts, (first, last, wanted))
        database.execute(f"DELETE FROM rollup WHERE shift = {SLOT} AND slot = ? AND {these}", (slot, wanted))
        begin, end = slot << SLOT, (slot + 1 << SLOT) - 1
        database.execute(_summing(SLOT, these), (begin, end, wanted))
        much = f"SELECT point FROM rollup WHERE shift = {SLOT} AND slot = ? AND {these} AND number >= {MUCH}"
        if dense := [row[0] for row in database.execute(much, (slot, wanted))]:
            database.execute(_summing(PART, these), (begin, end, json.dumps(dense)))
        database.execute(f"DELETE FROM unrolled WHERE slot = ? AND {these}", (slot, wanted))


def _summing(shift: int, these: str) -> str:
    """Of the history between two times."""
    last = "FROM history WHERE history.point = found.point AND at_ns = last_ns ORDER BY id DESC LIMIT 1"
    return (
        f"INSERT INTO rollup SELECT point, {shift}, last_ns >> {shift}, low, high, number, quality,"
        f" (SELECT value {last}), (SELECT quality {last})"
        f" FROM (SELECT point, {OF_HISTORY}, max(at_ns) AS last_ns FROM history"
        f" WHERE at_ns BETWEEN ? AND ? AND {these} GROUP BY point, at_ns >> {shift}) AS found"
    )
