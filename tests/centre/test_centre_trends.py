# SPDX-License-Identifier: GPL-3.0-or-later
"""Trends: columns say what a reader of the whole history would, whatever is summed up already."""

import asyncio
import contextlib
import doctest
import random
import sqlite3
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from openrtu_tools.centre import keep, rollup, trends
from openrtu_tools.centre.codes import TAGGED, Cause, Content, Kind
from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.intake import Intake
from openrtu_tools.centre.keep import Keeper
from openrtu_tools.centre.records import Record
from openrtu_tools.centre.rollup import PART, SLOT, Rollup
from openrtu_tools.centre.settings import Keep, StationSettings
from openrtu_tools.centre.sqlite import MIGRATIONS
from openrtu_tools.centre.store import EventRow, Store
from openrtu_tools.centre.trends import Column, Trend
from postgres import Server

S = 10**9
DAY = 86400 * S
END = 20000 * DAY  # of what is random, and now
QUALITIES = (0, 0, 0, 0, 64, 128, 192, 16)
POINTS = (1, 2, 3)
LOOP = asyncio.new_event_loop()  # a store keeps to the one that it was read in first


@pytest.fixture
def store(server: Server | None, tmp_path: Path) -> Iterator[Store]:
    where = server.new_database() if server else tmp_path / "centre.db"
    with contextlib.closing(open_store(where, alone=True)) as made:
        made.transaction(lambda database: database.insert("stations", ["name"], [("north",)]))
        points = [(1, 1, ioa) for ioa in POINTS]
        made.transaction(lambda database: database.insert("points", ["station", "ca", "ioa"], points))
        yield made


class Heard:
    """A database, and what it was told: each statement with parameters, of many with the first."""

    def __init__(self, database: Any) -> None:
        self.database = database
        self.all: list[tuple[str, Any]] = []

    def execute(self, sql: str, parameters: Sequence[Any] = (), /) -> Any:
        self.all.append((sql, parameters))
        return self.database.execute(sql, parameters)

    def executemany(self, sql: str, parameters: Iterable[Sequence[Any]], /) -> None:
        rows = list(parameters)
        if rows:
            self.all.append((sql, rows[0]))
        self.database.executemany(sql, rows)


def put(store: Store, summed: Rollup, rows: Sequence[EventRow]) -> None:
    summed.begin()

    def work(database: rollup.Database) -> None:
        database.insert("history", EventRow._fields, rows)
        summed.add(database, ((row.point, row.at_ns) for row in rows))

    store.transaction(work)
    summed.stored()


def roll(store: Store, summed: Rollup, now_ns: int = END) -> None:
    while store.transaction(lambda database: summed.step(database, now_ns)):
        pass


def rows_of(store: Store, table: str, columns: str) -> list[tuple[int, ...]]:
    return [
        tuple(row)
        for row in store.transaction(lambda database: [*database.execute(f"SELECT {columns} FROM {table}")])
    ]


def some(chance: random.Random, count: int, begin: int, end: int) -> list[EventRow]:
    """Dense and sparse stretches; many at the same time."""
    middle = chance.randrange(begin, end - 4 * DAY)
    rows = []
    for _ in range(count):
        near = chance.choice((3600, 3 * 86400))
        at = chance.choice((chance.randrange(begin, end), middle + chance.randrange(near) * S))
        rows.append(
            EventRow(
                chance.choice(POINTS), at, chance.randrange(-50, 50) / 2, chance.choice(QUALITIES), at, 3, 0
            )
        )
    return rows


def scanned(store: Store, point: int, columns: Sequence[Column], shift: int) -> list[Column]:
    """By a full scan, as simply as it can be said."""
    history = sorted(
        (at, id_, value, quality)
        for at, id_, value, quality, of in rows_of(store, "history", "at_ns, id, value, quality, point")
        if of == point
    )
    said = []
    for column in columns:
        begin, end = column.at_ns, column.at_ns + (1 << shift)
        held = [row for row in history if row[0] < begin][-1:]
        inside = [row for row in history if begin <= row[0] < end]
        valid = [value for _, _, value, quality in held + inside if quality < 128]
        last = (held + inside)[-1]
        quality = 0
        for row in held + inside:
            quality |= row[3]
        said.append(
            Column(
                begin,
                min(valid, default=None),
                max(valid, default=None),
                last[2] if last[3] < 128 else None,
                quality,
                len(inside),
            )
        )
    return said


def asked(store: Store, point: int, begin: int, end: int, most: int) -> Trend:
    return LOOP.run_until_complete(trends.trend(store, point, begin, end, most))


def check(store: Store, chance: random.Random, since: int) -> int:
    """Some spans; how many were in columns."""
    in_columns = 0
    for _ in range(12):
        point, most = chance.choice(POINTS), chance.choice((5, 40))
        begin = chance.choice([at for (at,) in rows_of(store, "history", "at_ns")]) - chance.randrange(DAY)
        end = chance.choice((END, min(END, begin + chance.randrange(1, 10 ** chance.randrange(10, 17)))))
        found = asked(store, point, begin, end, most)
        if found.exact:
            continue
        in_columns += 1
        shift = next(n for n in range(64) if (end >> n) - (begin >> n) < most)
        assert found.columns == scanned(store, point, found.columns, shift)
        expected = {*range(found.columns[0].at_ns, end + 1, 1 << shift)}
        assert {column.at_ns for column in found.columns} == expected  # none is missing on the way
        assert len(found.columns) <= most
    return in_columns


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_columns_say_what_a_full_scan_says(store: Store, monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    """After each of: some came in any order, some was summed up, the oldest went."""
    monkeypatch.setattr(keep, "ROWS_AT_ONCE", 100)
    for module in (rollup, trends):
        monkeypatch.setattr(module, "MUCH", 8)
    chance, summed = random.Random(seed), Rollup()
    since, in_columns = END - 200 * DAY, 0
    for _ in range(3):
        monkeypatch.setattr(rollup, "MARKS_AT_ONCE", chance.choice((2, 100)))
        monkeypatch.setattr(rollup, "SLOTS_AT_ONCE", chance.choice((1, 32)))
        put(store, summed, some(chance, 150, since, END))
        in_columns += check(store, chance, since)
        if chance.random() < 0.5:
            monkeypatch.setattr(rollup, "STEP_S", chance.choice((0, 1)))
            for _ in range(30):  # of many
                store.transaction(lambda database: summed.step(database, END))
        else:
            roll(store, summed, END - chance.randrange(20 * DAY))
        in_columns += check(store, chance, since)
        since += chance.randrange(30 * DAY)
        keeper = Keeper(Keep(events_days=(END - since) / DAY), 60, END, store.drop_weeks)
        store.transaction(keeper.old_rows)
        in_columns += check(store, chance, since)
        while store.transaction(keeper.old_rows):
            pass
        in_columns += check(store, chance, since)
    assert in_columns > 20
    roll(store, summed, END + 365 * DAY)
    assert not rows_of(store, "unrolled", "*")
    rows = rows_of(store, "history", "point, at_ns")
    of_slot = Counter((point, at >> SLOT) for point, at in rows)
    kept = {(point, SLOT, slot) for point, slot in of_slot}
    kept |= {(point, PART, at >> PART) for point, at in rows if of_slot[point, at >> SLOT] >= rollup.MUCH}
    assert {PART, SLOT} == {shift for _, shift, _ in kept}
    assert {*rows_of(store, "rollup", "point, shift, slot")} == kept


def test_slots_of_few_rows_are_summed_up_together(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each statement is a way to the server and back."""
    monkeypatch.setattr(rollup, "STEP_S", 60)
    summed, begin = Rollup(), (END >> SLOT) - 30 << SLOT
    put(store, summed, [EventRow(1, begin + (n << SLOT), n, 0, 0, 3, 0) for n in range(20)])

    def step(database: rollup.Database) -> int:
        heard = Heard(database)
        assert not summed.step(heard, END)  # type: ignore[arg-type]
        return len(heard.all)

    assert store.transaction(step) < 10
    assert len(rows_of(store, "rollup", "slot")) == 20


def test_summing_up_finds_each_point_by_its_index() -> None:
    """What was last, too: thousands of points may have been told at one time."""
    with contextlib.closing(sqlite3.connect(":memory:")) as database:
        database.executescript(";".join(MIGRATIONS))
        begin = (END >> SLOT) - 9 << SLOT
        rows = [EventRow(1, begin + n * S, n, 0, 0, 3, 0) for n in range(rollup.MUCH)]
        places = ", ".join("?" * len(EventRow._fields))
        database.executemany(f"INSERT INTO history ({', '.join(EventRow._fields)}) VALUES ({places})", rows)
        database.execute("INSERT INTO unrolled VALUES (1, ?)", (begin >> SLOT,))
        heard = Heard(database)
        Rollup().step(heard, END)  # type: ignore[arg-type]
        summing = [each for each in heard.all if "history" in each[0]]
        assert len(summing) == 2  # the slot, and its parts
        for sql, parameters in summing:
            plan = [row[3] for row in database.execute(f"EXPLAIN QUERY PLAN {sql}", parameters)]
            ways = [line for line in plan if "SEARCH history" in line]
            assert len(ways) == 3
            assert all("history_point (point=? AND at_ns" in line for line in ways), plan


@pytest.mark.slow
@pytest.mark.parametrize("every", [10, 3600], ids=["much", "few"])
def test_columns_narrower_than_a_slot(store: Store, every: int) -> None:
    """Of a slot in which much came out of its parts, else out of the history."""
    summed, begin = Rollup(), END - 5 * DAY
    rows = [
        EventRow(1, at, at // S % 977, QUALITIES[at // S // every % 8], at, 3, 0)
        for at in range(begin, END, every * S)
    ]
    put(store, summed, rows)
    roll(store, summed, END + DAY)
    assert not rows_of(store, "unrolled", "*")
    assert (PART in {shift for (shift,) in rows_of(store, "rollup", "shift")}) == (every == 10)
    most = 60
    found = asked(store, 1, begin, END, most)
    shift = next(n for n in range(64) if (END >> n) - (begin >> n) < most)
    assert PART <= shift < SLOT and not found.exact
    assert found.columns == scanned(store, 1, found.columns, shift)
    assert sum(column.number for column in found.columns) == len(rows)


def test_few_rows_are_told_as_they_are(store: Store) -> None:
    """With what held before them; a value that is not valid is none."""
    rows = [
        EventRow(1, at * S, value, quality, 0, 3, 0)
        for at, value, quality in ((1, 5, 0), (10, 6, 0), (10, 7, 128), (20, 8, 64))
    ]
    put(store, Rollup(), rows)
    found = asked(store, 1, 5 * S, 30 * S, 10)
    assert found.exact
    assert [(each.at_ns // S, each.last, each.quality, each.number) for each in found.columns] == [
        (5, 5, 0, 0), (10, 6, 0, 1), (10, None, 128, 1), (20, 8, 64, 1),
    ]  # fmt: skip
    assert asked(store, 2, 0, 30 * S, 10) == Trend(True, [])


def test_years_of_much_are_drawn_without_its_rows(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor are they counted: PostgreSQL would plan for each week of all years."""
    summed, begin = Rollup(), (END >> SLOT) - 300 << SLOT
    put(store, summed, [EventRow(1, begin + (n << SLOT - 1), n, 0, 0, 3, 0) for n in range(600)])
    roll(store, summed, END + DAY)
    questions = []
    read = store.read

    async def heard(sql: str, *values: Any) -> list[dict[str, Any]]:
        questions.append(sql)
        return await read(sql, *values)

    monkeypatch.setattr(store, "read", heard)
    found = asked(store, 1, begin, END, 100)
    assert not found.exact and sum(column.number for column in found.columns) == 600
    of_rows = [sql for sql in questions if "FROM history" in sql and "LIMIT 1" not in sql]
    assert questions and not of_rows


@pytest.mark.parametrize("before_ns", [S, 500 * DAY], ids=["near", "long"])
def test_first_column_says_what_held(store: Store, before_ns: int) -> None:
    put(store, Rollup(), [EventRow(1, END - before_ns, 5, 0, 0, 3, 0)])
    [column] = asked(store, 1, END, END + DAY, 100).columns
    assert (column.at_ns, column.last, column.number) == (END, 5, 0)


def test_what_is_stored_is_marked_until_it_is_summed_up(store: Store) -> None:
    """By whatever way it came; a second time as well, and a transaction that fails marks nothing."""
    intake = store.transaction(lambda database: Intake(database, {"north": StationSettings("north")}))
    intake.stored()

    def take(value: int, at_ns: int, flags: int = TAGGED, fails: bool = False) -> None:
        rest = value.to_bytes(4, "little") + bytes([0, 0, Content.SCALED]) + bytes(5)
        record = Record(
            Kind.INFORMATION, flags, 1, 0, 1, 1, received_ns=END, tag_ns=at_ns, type=35,
            cause=Cause.SPONTANEOUS, rest=rest,
        )  # fmt: skip
        named = Record(Kind.STATION, 0, 0, 0, 0, 0, name="north", received_ns=1)

        def work(database: rollup.Database) -> None:
            intake.take(database, [named, record])
            if fails:
                raise LookupError

        intake.begin()
        store.transaction(work)
        intake.stored()

    def marked() -> set[int]:
        return {slot for _, slot in rows_of(store, "unrolled", "*")}

    with pytest.raises(LookupError):
        take(1, END - 10 * S, fails=True)
    assert not marked()
    take(1, END - 10 * S)
    assert marked() == {END - 10 * S >> SLOT}
    take(2, 0, flags=0)
    assert marked() == {END - 10 * S >> SLOT, END >> SLOT}
    roll(store, intake.rollup, END + DAY)
    assert not marked()
    take(3, END - 9 * S)
    assert marked() == {END - 9 * S >> SLOT}


def test_history_of_an_older_centre_is_summed_up(tmp_path: Path) -> None:
    file = tmp_path / "centre.db"
    chance = random.Random(7)
    before = next(n for n, script in enumerate(MIGRATIONS) if "unrolled" in script)
    with contextlib.closing(sqlite3.connect(file)) as database:
        database.executescript(";".join(MIGRATIONS[:before]) + f"; PRAGMA user_version = {before};")
        database.execute("INSERT INTO stations (name) VALUES ('north')")
        database.executemany(
            "INSERT INTO points (station, ca, ioa) VALUES (1, 1, ?)", [(ioa,) for ioa in POINTS]
        )
        sql = f"INSERT INTO history ({', '.join(EventRow._fields)}) VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
        database.executemany(sql, some(chance, 500, END - 50 * DAY, END))
        database.commit()
    with contextlib.closing(open_store(file, alone=True)) as store:
        assert check(store, chance, END - 50 * DAY)
        roll(store, Rollup(), END + DAY)
        assert not rows_of(store, "unrolled", "*") and rows_of(store, "rollup", "slot")
        assert check(store, chance, END - 50 * DAY)


def test_ranges() -> None:
    assert not doctest.testmod(trends).failed
    assert trends._ranges([]) == []
    assert trends._ranges([4]) == [(4, 4)]
    numbers = [n for n in range(200) if n % 3]
    ranges = trends._ranges(numbers)
    assert len(ranges) == trends.RANGES_MOST
    assert {*numbers} <= {n for first, last in ranges for n in range(first, last + 1)}
