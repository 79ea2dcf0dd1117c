# SPDX-License-Identifier: GPL-3.0-or-later
"""What is too old goes; old tracks become thin, and neither lose a gap nor get one."""

import sqlite3
from collections.abc import Iterator
from pathlib import Path

import pytest

from openrtu_tools.centre import keep
from openrtu_tools.centre.formats import Csv, Place
from openrtu_tools.centre.keep import DAY_NS, Keeper
from openrtu_tools.centre.settings import Keep
from openrtu_tools.centre.sqlite import MIGRATIONS, SqliteStore

NOW = 1000 * DAY_NS
S = 10**9
GAP_S = 60


@pytest.fixture
def store(tmp_path: Path) -> Iterator[SqliteStore]:
    made = SqliteStore(tmp_path / "centre.db")
    made.database.execute("INSERT INTO stations (name) VALUES ('north')")
    made.database.execute("INSERT INTO points (station, ca, ioa) VALUES (1, 1, 1)")
    yield made
    made.close()


def put_track(store: SqliteStore, places: list[tuple[int, float, int]]) -> None:
    """Nanoseconds, metres to the north, quality."""
    rows = [(1, at, round(metres / 111195 * 1e7), 0, 0, quality, 0) for at, metres, quality in places]
    store.transaction(
        lambda database: database.executemany("INSERT INTO track VALUES (?, ?, ?, ?, ?, ?, ?)", rows)
    )


def track(store: SqliteStore) -> list[tuple[int, int, int]]:
    return [tuple(row) for row in store.database.execute("SELECT at_ns, latitude, quality FROM track")]


def rounds(store: SqliteStore, wanted: Keep) -> int:
    """Steps until there is nothing more to do."""
    keeper, steps = Keeper(wanted, GAP_S, NOW), 1
    while store.transaction(lambda database: keeper.track(database, 1) | keeper.old_rows(database)):
        steps += 1
    return steps


def segments(store: SqliteStore) -> list[int]:
    writer = Csv(GAP_S)
    writer.track("north", 1)
    ways = []
    for at, latitude, quality in track(store):
        writer.places([Place(at // 10**6, latitude / 1e7, 0, 0, quality)])
        ways.append(writer.way)
    return sorted({*ways})


@pytest.mark.slow
def test_one_that_stands_keeps_no_more_than_its_gaps_need(
    store: SqliteStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It drives, stands for an hour, is silent for one, loses its fix, and drives on."""
    monkeypatch.setattr(keep, "ROWS_AT_ONCE", 500)
    begin = NOW - 10 * DAY_NS
    places = [(begin + i * S, 20.0 * i, 0) for i in range(600)]
    places += [(begin + (600 + i) * S, 12000, 0) for i in range(3600)]
    places += [(begin + (7800 + i) * S, 12000, 128 if i == 50 else 0) for i in range(100)]
    places += [(begin + (7900 + i) * S, 12000 + 20.0 * i, 0) for i in range(600)]
    put_track(store, places)
    before = segments(store)
    assert len(before) == 3
    assert rounds(store, Keep(thin_m=10)) > 5
    kept = track(store)
    assert segments(store) == before
    assert 1200 < len(kept) < 1200 + 3600 / GAP_S + 40
    assert {at for at, _, quality in kept if quality} == {begin + 7850 * S}
    for edge in (4199, 7800, 7849, 7851):  # before and after the silence and the lost fix
        assert begin + edge * S in {at for at, _, _ in kept}, edge
    assert rounds(store, Keep(thin_m=10)) == 1
    assert track(store) == kept


def test_what_is_not_old_stays_whole(store: SqliteStore) -> None:
    places = [(NOW - DAY_NS + i * S, 0.0, 0) for i in range(100)]
    put_track(store, places)
    rounds(store, Keep(thin_m=10, thin_after_days=1.5, tracks_days=2))
    assert len(track(store)) == 100
    rounds(store, Keep(tracks_days=1))
    assert len(track(store)) == 100
    rounds(store, Keep(tracks_days=1 - 50 / 86400))
    assert len(track(store)) == 50


def test_old_rows_go_and_what_somebody_must_see_stays(store: SqliteStore) -> None:
    old, new = NOW - 40 * DAY_NS, NOW - 20 * DAY_NS
    for number, at in enumerate((old, new)):
        store.database.execute(
            "INSERT INTO history (point, at_ns, received_ns, value, quality, cause, tagged)"
            " VALUES (1, ?, ?, 0, 0, 3, 0)", (at, at),
        )  # fmt: skip
        store.database.execute(
            "INSERT INTO audit (at_ns, user, action, detail) VALUES (?, '', '', '')", (at,)
        )
        for gone, acknowledged in ((at, at), (at, None), (None, at)):
            store.database.execute(
                "INSERT INTO alarms (kind, station, priority, since_ns, gone_ns, acknowledged_ns)"
                " VALUES ('lost', 1, 1, ?, ?, ?)", (at, gone, acknowledged),
            )  # fmt: skip
        store.database.execute(
            "INSERT INTO commands (user, point, value, selects, state, begun_ns, changed_ns)"
            " VALUES ('', 1, 0, 0, ?, ?, ?)", (9 if number else 6, at, at),
        )  # fmt: skip

    def count(table: str) -> int:
        return int(store.database.execute(f"SELECT count(*) FROM {table}").fetchone()[0])

    rounds(store, Keep(events_days=30, alarms_days=30, audit_days=30))
    assert {table: count(table) for table in ("history", "audit", "alarms", "commands")} == {
        "history": 1, "audit": 1, "alarms": 5, "commands": 2,
    }  # fmt: skip


def test_file_of_the_first_version_is_brought_on(tmp_path: Path) -> None:
    """With what is in it."""
    file = tmp_path / "centre.db"
    with sqlite3.connect(file) as database:
        database.executescript(f"{MIGRATIONS[0]} PRAGMA user_version = 1;")
        database.execute("INSERT INTO users VALUES ('anna', 'viewer', x'00', x'00')")
    store = SqliteStore(file)
    rows = [tuple(row) for row in store.database.execute("SELECT name, role, groups FROM users")]
    store.close()
    assert rows == [("anna", "viewer", "")]
