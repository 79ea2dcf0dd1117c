# SPDX-License-Identifier: GPL-3.0-or-later
"""What the history was in each slot of time, so that years are drawn without reading them.

A slot is 2^44 ns (4.9 h); one in which much came has its parts of 2^38 ns (4.6 min), too. One that is not in
`unrolled` is summed up in `rollup`, exactly as the history has it; of one that is, the history itself must be
read. Whoever adds to the history or takes away from it marks the slots in the same transaction; the rest is
done when there is time.
"""

from __future__ import annotations

import time
from collections.abc import Iterable

from openrtu_tools.centre.codes import INVALID
from openrtu_tools.centre.store import Database
from openrtu_tools.codes import QUALITIES

SLOT, PART = 44, 38  # powers of two, in ns
MUCH = 1 << (SLOT - PART)  # rows of a slot; with fewer, its parts would be as many as they
MARKS_AT_ONCE = 100  # points of slots
SLOTS_AT_ONCE = 32  # less than a week
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

    def step(self, database: Database, now_ns: int | None = None) -> bool:
        """Sums up some of what is marked and over; whether there is more."""
        over = ((time.time_ns() if now_ns is None else now_ns) - REST_NS) >> SLOT
        end = time.monotonic() + STEP_S
        while batch := self._oldest(database, over):
            _sum(database, batch)
            self._known.difference_update(batch)
            if time.monotonic() > end:
                return True
        return False

    @staticmethod
    def _oldest(database: Database, over: int) -> list[tuple[int, int]]:
        """Points and slots of near times."""
        sql = "SELECT point, slot FROM unrolled WHERE slot < ? ORDER BY slot, point LIMIT ?"
        marked = [(int(point), int(slot)) for point, slot in database.execute(sql, (over, MARKS_AT_ONCE))]
        return [each for each in marked if each[1] < marked[0][1] + SLOTS_AT_ONCE]


# What is marked from a slot to a point of another slot, in the order of slots and points.
BATCH = "unrolled.slot BETWEEN ?1 AND ?2 AND (unrolled.slot < ?2 OR unrolled.point <= ?3)"


def _sum(database: Database, batch: list[tuple[int, int]]) -> None:
    """These points and slots, which follow each other in what is marked."""
    first, (point, last) = batch[0][1], batch[-1]
    parts = f"old.slot BETWEEN unrolled.slot << {SLOT - PART} AND (unrolled.slot + 1 << {SLOT - PART}) - 1"
    for shift, those in ((PART, parts), (SLOT, "old.slot = unrolled.slot")):
        database.execute(
            "DELETE FROM rollup WHERE (point, shift, slot) IN (SELECT old.point, old.shift, old.slot"
            f" FROM unrolled CROSS JOIN rollup AS old WHERE {BATCH} AND old.point = unrolled.point"
            f" AND old.shift = {shift} AND {those})",
            (first, last, point),
        )
    marked = (
        f"unrolled CROSS JOIN history WHERE {BATCH} AND history.point = unrolled.point"
        f" AND at_ns BETWEEN unrolled.slot << {SLOT} AND (unrolled.slot + 1 << {SLOT}) - 1"
    )
    summed = database.execute(
        f"{_summing(SLOT, marked, bounded('?4', '?5'))} RETURNING point, slot, number",
        (first, last, point, first << SLOT, (last + 1 << SLOT) - 1),
    )
    dense = [
        (point, slot << SLOT, (slot + 1 << SLOT) - 1) for point, slot, number in summed if number >= MUCH
    ]
    of_one = "history WHERE point = ?1 AND at_ns BETWEEN ?2 AND ?3"
    database.executemany(_summing(PART, of_one, bounded("?2", "?3")), dense)
    database.execute(f"DELETE FROM unrolled WHERE {BATCH}", (first, last, point))


def bounded(begin: str, end: str) -> str:
    """Times said once more: PostgreSQL plans for the weeks that they leave, and not for all that there are.
    By FALSE, which it leaves out, SQLite takes them for no index: it has better ones."""
    return f"(at_ns BETWEEN {begin} AND {end} OR FALSE)"


def _summing(shift: int, those: str, within: str) -> str:
    """Of those rows of the history, of a time."""
    last = f"FROM history WHERE history.point = found.point AND at_ns = last_ns AND {within}"
    last += " ORDER BY id DESC LIMIT 1"
    return (
        f"INSERT INTO rollup SELECT point, {shift}, last_ns >> {shift}, low, high, number, quality,"
        f" (SELECT value {last}), (SELECT quality {last})"
        f" FROM (SELECT history.point, {OF_HISTORY}, max(at_ns) AS last_ns FROM {those} AND {within}"
        f" GROUP BY history.point, at_ns >> {shift}) AS found"
    )
