# SPDX-License-Identifier: GPL-3.0-or-later
"""What a point was over a time, in no more columns than a screen has.

A value holds until the next one. A column says the lowest and the highest that held in it, and the last.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from itertools import pairwise

from openrtu_tools.centre.codes import INVALID
from openrtu_tools.centre.model import NS_PER_MS, Json
from openrtu_tools.centre.rollup import MUCH, OF_HISTORY, OF_ROLLUP, PART, SLOT, bounded
from openrtu_tools.centre.store import Reader, Row

RANGES_MOST = 16  # that one question is split into
NEAR_NS = 86400 * 10**9
TIME_LEAST = -(2**63)


@dataclass
class Column:
    """From its begin to that of the next one. Without a lowest, no valid value held in it."""

    at_ns: int
    low: float | None
    high: float | None
    last: float | None  # that holds at its end; None: it is not valid, or nobody knows one
    quality: int  # all that any value in it had
    number: int  # of rows of the history

    def hold(self, value: float) -> None:
        """That of before holds until its first one."""
        self.low = value if self.low is None else min(self.low, value)
        self.high = value if self.high is None else max(self.high, value)


@dataclass
class Trend:
    """Of a point. An exact one has a column for each row of the history."""

    exact: bool
    columns: list[Column] = field(default_factory=list)

    def view(self) -> Json:
        rows = [
            [each.at_ns / NS_PER_MS, each.low, each.high, each.last, each.quality, each.number]
            for each in self.columns
        ]
        return {"exact": self.exact, "columns": rows}


async def trend(store: Reader, point: int, begin: int, end: int, most: int) -> Trend:
    """Exact where it has no more rows than `most` columns. The first one says what held at the begin."""
    shift = _shift(begin, end, most)
    if shift >= PART and await _at_least(store, point, begin, end) > most:
        return await _in_columns(store, point, begin, end, shift)
    rows = await store.read(
        "SELECT at_ns, value, quality FROM history WHERE point = ? AND at_ns BETWEEN ? AND ?"
        " ORDER BY at_ns, id LIMIT ?",
        point, begin, end, most + 1,
    )  # fmt: skip
    if len(rows) > most:
        return await _in_columns(store, point, begin, end, shift)
    found = [_exact(row["at_ns"], row) for row in rows]
    if held := await _before(store, point, begin):
        found.insert(0, _exact(begin, held, 0))
    return Trend(True, found)


async def _at_least(store: Reader, point: int, begin: int, end: int) -> int:
    """So many rows, by what is summed up: PostgreSQL plans for each week of which it is to count some."""
    within = "point = ?1 AND slot BETWEEN ?2 AND ?3"
    [row] = await store.read(
        f"SELECT CAST(sum(number) AS BIGINT) AS number FROM rollup WHERE {within} AND shift = {SLOT}"
        f" AND slot NOT IN (SELECT slot FROM unrolled WHERE {within})",
        point, (begin >> SLOT) + 1, (end >> SLOT) - 1,
    )  # fmt: skip
    return row["number"] or 0


def _shift(begin: int, end: int, most: int) -> int:
    """Columns are slots of a power of two: they begin before the begin, and end behind the end."""
    shift = 0
    while (end >> shift) - (begin >> shift) >= most:
        shift += 1
    return shift


async def _before(store: Reader, point: int, at_ns: int) -> Row | None:
    """What held until then. Mostly it is near: PostgreSQL plans for few weeks then, and not for all."""
    for since in (at_ns - NEAR_NS, TIME_LEAST):
        rows = await store.read(
            "SELECT value, quality FROM history WHERE point = ? AND at_ns >= ? AND at_ns < ?"
            " ORDER BY at_ns DESC, id DESC LIMIT 1",
            point, since, at_ns,
        )  # fmt: skip
        if rows:
            return rows[0]
    return None


def _valid(value: float, quality: int) -> float | None:
    return None if quality & INVALID else value


def _exact(at_ns: int, row: Row, number: int = 1) -> Column:
    value = _valid(row["value"], row["quality"])
    return Column(at_ns, value, value, value, row["quality"], number)


async def _in_columns(store: Reader, point: int, begin: int, end: int, shift: int) -> Trend:
    first, last = begin >> shift, end >> shift
    before = await _before(store, point, first << shift)
    by_slot: dict[int, Row] = {}
    async for row in _summed(store, point, shift, first << shift, (last + 1 << shift) - 1):
        there = by_slot.get(row["slot"])
        by_slot[row["slot"]] = _joined(there, row) if there else row
    held = (before["value"], before["quality"]) if before else None
    found = []
    for slot in range(first, last + 1):
        row = by_slot.get(slot)
        column = Column(slot << shift, None, None, None, 0, 0)
        if row:
            column = Column(slot << shift, row["low"], row["high"], None, row["quality"], row["number"])
        if held:
            column.quality |= held[1]
            if (value := _valid(*held)) is not None:
                column.hold(value)
        held = (row["last_value"], row["last_quality"]) if row else held
        if held:
            column.last = _valid(*held)
            found.append(column)
    return Trend(False, found)


def _joined(a: Row, b: Row) -> Row:
    """Two parts of a slot, the earlier one first."""
    lows, highs = ([each for each in (a[key], b[key]) if each is not None] for key in ("low", "high"))
    return {
        **b,
        "low": min(lows, default=None),
        "high": max(highs, default=None),
        "number": a["number"] + b["number"],
        "quality": a["quality"] | b["quality"],
    }


async def _summed(store: Reader, point: int, shift: int, begin: int, end: int) -> AsyncIterator[Row]:
    """Of parts of slots, in order of time: out of what is summed up and fine enough; what is not, out of the
    history itself."""
    if shift < PART:
        for row in await _of_history(store, point, shift, begin, end):
            yield row
        return
    marked = await store.read(
        "SELECT slot FROM unrolled WHERE point = ? AND slot BETWEEN ? AND ? ORDER BY slot",
        point, begin >> SLOT, end >> SLOT,
    )  # fmt: skip
    at = begin
    for first, last in _ranges([row["slot"] for row in marked]):
        from_, to = max(begin, first << SLOT), min(end, (last + 1 << SLOT) - 1)
        for row in await _of_rollup(store, point, shift, at, from_ - 1):
            yield row
        for row in await _of_history(store, point, shift, from_, to):
            yield row
        at = to + 1
    for row in await _of_rollup(store, point, shift, at, end):
        yield row


def _ranges(numbers: list[int]) -> list[tuple[int, int]]:
    """Few ranges that have all of these; the widest gaps stay between them.

    >>> _ranges([1, 2, 7])
    [(1, 2), (7, 7)]
    """
    gaps = sorted(((b - a, a, b) for a, b in pairwise(numbers) if b > a + 1), reverse=True)
    cuts = sorted((a, b) for _, a, b in gaps[: RANGES_MOST - 1])
    begins = [*numbers[:1], *(b for _, b in cuts)]
    ends = [*(a for a, _ in cuts), *numbers[-1:]]
    return list(zip(begins, ends, strict=True))


def _with_last(found: str) -> str:
    last = f"FROM history WHERE history.point = ?1 AND at_ns = last_ns AND {bounded('?2', '?3')}"
    last += " ORDER BY id DESC LIMIT 1"
    return (
        "SELECT part AS slot, found.low, found.high, found.number, found.quality,"
        f" (SELECT value {last}) AS last_value, (SELECT quality {last}) AS last_quality"
        f" FROM ({found}) AS found ORDER BY part"
    )


async def _of_history(store: Reader, point: int, shift: int, begin: int, end: int) -> list[Row]:
    found = (
        f"SELECT at_ns >> {shift} AS part, {OF_HISTORY}, max(at_ns) AS last_ns FROM history"
        f" WHERE point = ?1 AND at_ns BETWEEN ?2 AND ?3 GROUP BY at_ns >> {shift}"
    )
    return await store.read(_with_last(found), point, begin, end)


async def _of_few(store: Reader, point: int, shift: int, begin: int, end: int) -> list[Row]:
    """Out of the slots that have no parts."""
    found = (
        f"SELECT at_ns >> {shift} AS part, {OF_HISTORY}, max(at_ns) AS last_ns FROM rollup CROSS JOIN history"
        f" WHERE rollup.point = ?1 AND shift = {SLOT} AND rollup.number < {MUCH}"
        " AND slot BETWEEN ?4 AND ?5 AND history.point = ?1 AND at_ns BETWEEN ?2 AND ?3"
        f" AND at_ns BETWEEN slot << {SLOT} AND (slot + 1 << {SLOT}) - 1 GROUP BY at_ns >> {shift}"
    )
    return await store.read(_with_last(found), point, begin, end, begin >> SLOT, end >> SLOT)


async def _of_rollup(store: Reader, point: int, shift: int, begin: int, end: int) -> list[Row]:
    if begin > end:
        return []
    level = SLOT if shift >= SLOT else PART
    up = shift - level
    # No join: PostgreSQL would compare each with each while it has no statistics yet.
    last = f"FROM rollup WHERE rollup.point = ?1 AND rollup.shift = {level} AND rollup.slot = last_slot"
    rows = await store.read(
        "SELECT part AS slot, found.low, found.high, found.number, found.quality,"
        f" (SELECT last_value {last}) AS last_value, (SELECT last_quality {last}) AS last_quality"
        f" FROM (SELECT slot >> {up} AS part, {OF_ROLLUP}, max(slot) AS last_slot FROM rollup"
        f" WHERE point = ?1 AND shift = {level} AND slot BETWEEN ?2 AND ?3 GROUP BY slot >> {up}) AS found"
        " ORDER BY part",
        point, begin >> level, end >> level,
    )  # fmt: skip
    return rows if level == SLOT else rows + await _of_few(store, point, shift, begin, end)
