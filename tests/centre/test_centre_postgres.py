# SPDX-License-Identifier: GPL-3.0-or-later
"""What only the store on a server of PostgreSQL has: weeks, a lock, and answers that are lost."""

import asyncio
import contextlib
import doctest
import re
import subprocess
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import asyncpg
import pytest

from openrtu_tools.centre import postgres as module
from openrtu_tools.centre import rollup, trends
from openrtu_tools.centre.errors import CentreError, StoreError
from openrtu_tools.centre.keep import DAY_NS, Keeper
from openrtu_tools.centre.postgres import WEEK_NS, PostgresStore, Session
from openrtu_tools.centre.settings import Keep
from openrtu_tools.centre.store import Database, Row
from postgres import Server
from test_centre_trends import Heard

pytestmark = pytest.mark.slow  # make test-quick brings no PostgreSQL
NOW = time.time_ns()
LOOP = asyncio.new_event_loop()  # a store keeps to the one that it was read in first


@pytest.fixture(scope="module")
def address(postgresql: Server) -> str:
    return postgresql.new_database()


@pytest.fixture
def store(address: str) -> Iterator[PostgresStore]:
    with contextlib.closing(PostgresStore(address, alone=True)) as made:
        yield made
        for table in ("history", "rollup"):
            made.transaction(lambda database, table=table: database.execute(f"DELETE FROM {table}"))


def put_event(database: Database, at_ns: int, value: float = 0) -> None:
    database.execute(
        "INSERT INTO history (point, at_ns, received_ns, value, quality, cause, tagged)"
        " VALUES (1, ?, 0, ?, 0, 3, 1) ON CONFLICT DO NOTHING", (at_ns, value),
    )  # fmt: skip


def test_event_is_in_its_week_and_once(store: PostgresStore, postgresql: Server) -> None:
    """A tag of a wrong clock has its place, too."""
    for at_ns in (NOW, NOW, NOW - 3 * WEEK_NS, 0, NOW + 500 * WEEK_NS):
        store.transaction(lambda database, at_ns=at_ns: put_event(database, at_ns))
    rows = postgresql.rows("SELECT tableoid::regclass, count(*) FROM history GROUP BY 1 ORDER BY 1")
    week = NOW // WEEK_NS
    assert {*rows} == {("history_other", "2"), (f"history_{week - 3}", "1"), (f"history_{week}", "1")}
    plan = postgresql.rows(f"SET enable_seqscan = off; EXPLAIN SELECT 1 FROM history WHERE at_ns > {NOW}")
    assert any("history" in line and "at_ns_idx" in line for (line,) in plan)


def test_what_came_before_its_week_was_made_moves_there(
    store: PostgresStore, postgresql: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    ahead = NOW + 4 * WEEK_NS
    store.transaction(lambda database: put_event(database, ahead))
    monkeypatch.setattr(module, "WEEKS_AHEAD", 4)
    store.transaction(lambda database: put_event(database, NOW))
    [(table,)] = postgresql.rows(f"SELECT tableoid::regclass FROM history WHERE at_ns = {ahead}")
    assert table == f"history_{ahead // WEEK_NS}"


def test_whole_weeks_go(store: PostgresStore, postgresql: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    ages = [0, 1, 4, 5, 600]
    for weeks in ages:
        store.transaction(lambda database, weeks=weeks: put_event(database, NOW - weeks * WEEK_NS))
    monkeypatch.setattr(module, "WEEKS_BACK", 4)  # the fifth is no more written to
    keeper = Keeper(Keep(events_days=14), 60, NOW, store.drop_weeks)
    assert not store.transaction(keeper.old_rows)
    left = [int(row[0]) for row in postgresql.rows("SELECT at_ns FROM history")]
    assert sorted((NOW - at) // WEEK_NS for at in left) == [0, 1]
    assert all((NOW - at) < 14 * DAY_NS + WEEK_NS for at in left)
    named = [
        name for (name,) in postgresql.rows("SELECT relname FROM pg_class WHERE relname LIKE 'history%'")
    ]
    assert f"history_{NOW // WEEK_NS - 5}" not in named
    assert f"history_{NOW // WEEK_NS - 4}" in named


def weeks_of(plan: Iterable[Sequence[str]]) -> set[str]:
    """The tables that a server looks into, or would."""
    return {table for (line,) in plan for table in re.findall(r" on (history_\w+)", line)}


def test_summing_up_plans_for_the_weeks_of_its_slot_alone(
    store: PostgresStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not for all that there are: planning took longer than all else. A slot lies in two weeks at most."""
    monkeypatch.setattr(rollup, "MUCH", 5)
    monkeypatch.setattr(rollup, "STEP_S", 60)
    slot = (NOW >> rollup.SLOT) - 30
    times = [(slot << rollup.SLOT) + number for number in range(10)]

    def work(database: Database) -> list[int]:
        for at_ns in times:
            put_event(database, at_ns, at_ns % 7)
        rollup.mark(database, [(1, at_ns) for at_ns in times])
        heard = Heard(database)
        assert not rollup.Rollup().step(heard, NOW)  # type: ignore[arg-type]
        plans = [
            database.execute(f"EXPLAIN {sql}", parameters)
            for sql, parameters in heard.all
            if "history" in sql
        ]
        return [len(weeks_of(plan)) for plan in plans]

    weeks = store.transaction(work)
    assert set(weeks) <= {1, 2}
    shifts = store.transaction(
        lambda database: [*database.execute("SELECT shift FROM rollup WHERE slot > 0")]
    )
    assert {shift for (shift,) in shifts} == {rollup.SLOT, rollup.PART}
    all_weeks = store.transaction(
        lambda database: weeks_of(database.execute("EXPLAIN SELECT id FROM history"))
    )
    assert len(all_weeks) > 10


def test_columns_of_hours_plan_for_their_weeks_alone(
    store: PostgresStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(100):
        store.transaction(lambda database, number=number: put_event(database, NOW - number * 10**9))
    read, weeks = store.read, []

    async def planned(sql: str, *values: Any) -> list[Row]:
        if "last_ns" in sql:
            weeks.append(len(weeks_of([each.values() for each in await read(f"EXPLAIN {sql}", *values)])))
        return await read(sql, *values)

    monkeypatch.setattr(store, "read", planned)
    found = LOOP.run_until_complete(trends.trend(store, 1, NOW - 90 * 10**9, NOW, 20))
    assert not found.exact and len(found.columns) > 10
    assert weeks and set(weeks) <= {1, 2}


def test_years_read_each_slot_a_few_times_though_there_are_no_statistics(
    store: PostgresStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A database that was just summed up has none; a join of each with each read 700 times as much."""
    slots, last = 4000, NOW >> rollup.SLOT

    def years(database: Database) -> None:
        database.execute("DELETE FROM rollup")
        database.execute(
            f"INSERT INTO rollup SELECT 1, {rollup.SLOT}, slot, slot % 7, slot % 7, 1, 0, slot % 7, 0"
            f" FROM generate_series({last - slots}::bigint, {last - 1}) AS slot"
        )

    store.transaction(years)
    read, rows = store.read, []

    async def counted(sql: str, *values: Any) -> list[Row]:
        if "last_slot" in sql:
            plan = [str(*each.values()) for each in await read(f"EXPLAIN ANALYZE {sql}", *values)]
            found = re.findall(r"actual time=\S+ rows=(\d+) loops=(\d+)", "\n".join(plan))
            rows.append(sum(int(each) * int(loops) for each, loops in found))
        return await read(sql, *values)

    monkeypatch.setattr(store, "read", counted)
    begin = last - slots << rollup.SLOT
    columns = LOOP.run_until_complete(trends._of_rollup(store, 1, rollup.SLOT + 3, begin, NOW))
    assert [each["last_value"] for each in columns[1:-1]] == [
        ((each["slot"] + 1 << 3) - 1) % 7 for each in columns[1:-1]
    ]
    assert sum(each["number"] for each in columns) == slots
    assert rows and max(rows) < 6 * slots


@pytest.mark.parametrize(("kept_s", "reads_all"), [(3600.0, True), (0.0, False)])
def test_plan_of_a_small_table_is_given_up(
    store: PostgresStore, monkeypatch: pytest.MonkeyPatch, kept_s: float, reads_all: bool
) -> None:
    monkeypatch.setattr(module, "PLANS_S", kept_s)
    sql = "SELECT low FROM rollup WHERE point = ? AND shift = ? AND slot = ?"

    def ask(database: Session) -> str:
        database.execute(sql, (1, 2, 3))
        name = database._prepared[sql].get_name()
        return "".join(row[0] for row in database.execute(f"EXPLAIN EXECUTE {name} (1, 2, 3)"))

    def grow(first: int, last: int) -> None:
        rows = f"SELECT 1, 2, slot, 0, 0, 1, 0, 0, 0 FROM generate_series({first}, {last}) AS slot"
        store.transaction(lambda database: database.execute(f"INSERT INTO rollup {rows}"))

    store.transaction(lambda database: database.execute("TRUNCATE rollup"))
    grow(1, 20)
    store.transaction(lambda database: database.execute("ANALYZE rollup"))
    for _ in range(8):
        store.transaction(ask)  # type: ignore[arg-type]
    grow(21, 20_000)
    assert ("Seq Scan" in store.transaction(ask)) == reads_all  # type: ignore[arg-type]


@pytest.mark.parametrize("stored", [True, False])
def test_lost_answer_to_commit_is_found_out(
    store: PostgresStore, monkeypatch: pytest.MonkeyPatch, stored: bool
) -> None:
    """The connection ends with the COMMIT: after the server has done it, or before."""
    whole = Session.script
    lost: list[str] = []

    def script(session: Session, text: str) -> None:
        if text == "COMMIT" and not lost:
            lost.append(text)
            if stored:
                whole(session, text)
            session.connection.terminate()
            raise asyncpg.ConnectionDoesNotExistError("as asyncpg says it of a server that is killed")
        whole(session, text)

    monkeypatch.setattr(Session, "script", script)
    if stored:
        store.transaction(lambda database: put_event(database, NOW, 7))
    else:
        with pytest.raises(StoreError):
            store.transaction(lambda database: put_event(database, NOW, 7))
    count = store.transaction(lambda database: database.execute("SELECT count(*) FROM history").fetchone())
    assert count[0] == int(stored)
    assert lost


def test_one_centre_works_on_a_database(
    store: PostgresStore, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LOCK_TRIES", 1)
    with pytest.raises(CentreError, match="another centre works on this database: stop it"):
        PostgresStore(address, alone=True)
    PostgresStore(address, alone=False).close()  # the command line adds a user meanwhile


def test_places_are_geometry_where_there_is_postgis(postgresql: Server) -> None:
    """In metres as PostGIS counts them; and as GDAL sees a layer, by which QGIS reads it."""
    address = postgresql.new_database()
    postgresql.rows("CREATE SCHEMA gis; CREATE EXTENSION postgis SCHEMA gis")

    def put(database: Database) -> None:
        database.insert("stations", ["id", "name"], [(7, "van")])
        place = 448125000, 204612000, 1170
        names = ["latitude", "longitude", "altitude"]
        database.insert(
            "points",
            ["id", "station", "ca", "ioa", *names],
            [(3, 7, 1, 1, *place), (4, 7, 1, 2, *[None] * 3)],
        )
        database.insert("track", ["point", "at_ns", *names, "quality", "detail"], [(3, NOW, *place, 0, 1)])

    with contextlib.closing(PostgresStore(address, alone=True)) as store:
        store.transaction(put)
    for view in ("places", "track_places"):
        sql = (
            "SET search_path TO public, gis; SELECT station, ST_AsText(place),"
            f" ST_Distance(place::geography, ST_MakePoint(20.4612, 44.8215)::geography)::int FROM {view}"
        )
        assert postgresql.rows(sql) == [("van", "POINT Z (20.4612 44.8125 117)", "1000")]
    where = f"PG:host={postgresql.folder} user=centre dbname={postgresql.name} schemas=public,gis"
    done = subprocess.run(
        ["ogrinfo", "-so", where, "track_places"], capture_output=True, text=True, check=True
    )
    assert "Geometry: 3D Point" in done.stdout
    assert 'ID["EPSG",4326]' in done.stdout
    assert "Feature Count: 1" in done.stdout


def test_years_are_drawn_out_of_an_index(postgresql: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is summed up lies in the order of time, so the slots of a point are all over the table."""
    slots = range(1000)
    with contextlib.closing(PostgresStore(postgresql.new_database(), alone=True)) as store:
        columns = ("point", "shift", "slot", "low", "high", "number", "quality", "last_value", "last_quality")
        rows = [(point, rollup.SLOT, slot, 0, 1, 2, 0, 1, 0) for slot in slots for point in range(1, 30)]
        store.transaction(lambda database: database.insert("rollup", columns, rows))
        postgresql.rows("VACUUM ANALYZE rollup")  # as the server does by and by
        plans = []
        read = store.read

        async def explained(sql: str, *values: Any) -> list[Row]:
            if "FROM rollup" in sql:
                plans.append("\n".join(row["QUERY PLAN"] for row in await read(f"EXPLAIN {sql}", *values)))
            return await read(sql, *values)

        monkeypatch.setattr(store, "read", explained)
        end = (slots.stop << rollup.SLOT) - 1
        drawn = LOOP.run_until_complete(trends.trend(store, 1, 0, end, 500))
        assert len(drawn.columns) == 500 and drawn.columns[9].number == 4
        assert [plan.count("Index Only Scan using rollup_pkey") for plan in plans] == [1, 3], plans


def test_newer_database_and_no_server(postgresql: Server) -> None:
    address = postgresql.new_database()
    PostgresStore(address, alone=True).close()
    postgresql.rows("INSERT INTO version VALUES (99)")
    with pytest.raises(CentreError, match="of a newer centre: start that one, or restore a backup"):
        PostgresStore(address, alone=True)
    with pytest.raises(CentreError, match="does the server run"):
        PostgresStore("postgresql://nobody@/none?host=/nowhere", alone=True)
    assert doctest.testmod(module).failed == 0
