# SPDX-License-Identifier: GPL-3.0-or-later
"""What the history was in each slot of time, so that years are drawn without reading them.

A slot is 2^38 ns (4.6 min), and one above it 2^44 ns (4.9 h). One that is not in `unrolled` is summed up in
`rollup`, exactly as the history has it; of one that is, the history itself must be read. Whoever adds to the
history or takes away from it marks the slots in the same transaction; the rest is done when there is time.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable
from itertools import pairwise

from openrtu_tools.centre.codes import INVALID
from openrtu_tools.centre.store import Database
from openrtu_tools.codes import QUALITIES

SHIFTS = (38, 44)
POINTS_AT_ONCE = 200
STEP_S = 0.02  # of the writer's time
REST_NS = 60 * 10**9  # a slot is summed up once it is over for so long

# Of rows of the history; a value that is not valid has no part in what is the lowest and the highest.
QUALITY = " | ".join(f"max(quality & {bit})" for bit in QUALITIES.values())
VALID = f"quality & {INVALID} = 0"
OF_HISTORY = (
    f"min(CASE WHEN {VALID} THEN value END) AS low, max(CASE WHEN {VALID} THEN value END) AS high,"
    f" count(*) AS number, {QUALITY} AS quality"
)
OF_ROLLUP = f"min(low) AS low, max(high) AS high, CAST(sum(number) AS BIGINT) AS number, {QUALITY} AS quality"

Slot = tuple[int, int, int]  # point, shift, number


def slots(point: int, at_ns: int) -> list[Slot]:
    return [(point, shift, at_ns >> shift) for shift in SHIFTS]


def mark(database: Database, rows: Iterable[tuple[int, int]]) -> None:
    """Points and times of which the history is another one from now on."""
    marked = {slot for point, at_ns in rows for slot in slots(point, at_ns)}
    if marked:
        database.insert("unrolled", ("point", "shift", "slot"), sorted(marked))


def mark_time(database: Database, begin_ns: int, end_ns: int) -> None:
    """All of a time, of every point. What is not summed up is marked already."""
    for shift in SHIFTS:
        database.execute(
            "INSERT INTO unrolled (point, shift, slot) SELECT point, shift, slot FROM rollup"
            f" WHERE shift = {shift} AND slot BETWEEN ? AND ? ON CONFLICT DO NOTHING",
            (begin_ns >> shift, end_ns >> shift),
        )


class Rollup:
    """Of the writer's thread: which slots are marked already, and summing up."""

    def __init__(self) -> None:
        self._known: set[tuple[int, int]] = set()  # marked, of the first shift: most rows are of these
        self._new: set[tuple[int, int]] = set()  # in the transaction under way

    def begin(self) -> None:
        self._new.clear()

    def stored(self) -> None:
        self._known |= self._new

    def add(self, database: Database, rows: Iterable[tuple[int, int]]) -> None:
        """As mark, for what comes all the time."""
        found = {(point, at_ns >> SHIFTS[0]) for point, at_ns in rows} - self._known - self._new
        if found:
            mark(database, ((point, slot << SHIFTS[0]) for point, slot in found))
            self._new |= found

    def step(self, database: Database, among: str, now_ns: int | None = None) -> bool:
        """Sums up some of what is marked and over; whether there is more. `among`: the store's."""
        over_ns = (time.time_ns() if now_ns is None else now_ns) - REST_NS
        end = time.monotonic() + STEP_S
        for below, shift in pairwise((0, *SHIFTS)):
            while (slot := self._oldest(database, shift)) is not None and slot < over_ns >> shift:
                self._sum(database, among, below, shift, slot)
                if time.monotonic() > end:
                    return True
        return False

    @staticmethod
    def _oldest(database: Database, shift: int) -> int | None:
        [(slot,)] = database.execute(f"SELECT min(slot) FROM unrolled WHERE shift = {shift}")
        return None if slot is None else int(slot)

    def _sum(self, database: Database, among: str, below: int, shift: int, slot: int) -> None:
        """Of some points."""
        points = [
            row[0]
            for row in database.execute(
                f"SELECT point FROM unrolled WHERE shift = {shift} AND slot = ? ORDER BY point LIMIT ?",
                (slot, POINTS_AT_ONCE),
            )
        ]
        if not below:
            self._known -= {(point, slot) for point in points}
        wanted = json.dumps(points)
        of_slot = f"shift = {shift} AND slot = ?1 AND point {among.replace('?', '?2')}"
        database.execute(f"DELETE FROM rollup WHERE {of_slot}", (slot, wanted))
        source = _rollups(below, shift, among) if below else _histories(shift, among)
        database.execute(
            f"INSERT INTO rollup {source}", (slot << shift - below, (slot + 1 << shift - below) - 1, wanted)
        )
        database.execute(f"DELETE FROM unrolled WHERE {of_slot}", (slot, wanted))


def _histories(shift: int, among: str) -> str:
    last = "FROM history WHERE history.point = found.point AND at_ns = last_ns ORDER BY id DESC LIMIT 1"
    return (
        f"SELECT point, {shift}, last_ns >> {shift}, low, high, number, quality,"
        f" (SELECT value {last}), (SELECT quality {last})"
        f" FROM (SELECT point, {OF_HISTORY}, max(at_ns) AS last_ns FROM history"
        f" WHERE point {among.replace('?', '?3')}"
        " AND at_ns BETWEEN ?1 AND ?2 GROUP BY point) AS found"
    )


def _rollups(below: int, shift: int, among: str) -> str:
    return (
        f"SELECT found.point, {shift}, last_slot >> {shift - below}, found.low, found.high, found.number,"
        " found.quality, last_value, last_quality"
        f" FROM (SELECT point, {OF_ROLLUP}, max(slot) AS last_slot FROM rollup WHERE shift = {below}"
        f" AND point {among.replace('?', '?3')} AND slot BETWEEN ?1 AND ?2 GROUP BY point) AS found"
        f" JOIN rollup ON rollup.point = found.point AND rollup.shift = {below} AND rollup.slot = last_slot"
    )
