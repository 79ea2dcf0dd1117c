# SPDX-License-Identifier: GPL-3.0-or-later
"""What a batch of records leaves in either store, and what is told of it."""

import contextlib
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.intake import SPONTANEOUS, Intake
from openrtu_tools.centre.records import INVALID, TAGGED, Content, Kind, Record
from openrtu_tools.centre.settings import StationSettings
from openrtu_tools.centre.store import Store
from postgres import Server

NOW = time.time_ns()
REQUESTED, INTERROGATED = 5, 20  # causes of what is no event


@pytest.fixture
def store(server: Server | None, tmp_path: Path) -> Iterator[Store]:
    where = server.new_database() if server else tmp_path / "centre.db"
    with contextlib.closing(open_store(where, alone=True)) as made:
        yield made


@pytest.fixture
def intake(store: Store) -> Intake:
    """It knows the station already."""
    made = store.transaction(lambda database: Intake(database, {"north": StationSettings("north")}))
    made.stored()
    take(store, made, Record(Kind.STATION, 0, 0, 0, 0, 0, name="north", received_ns=1))
    return made


def record(value: float, at_ms: int, cause: int = SPONTANEOUS, flags: int = TAGGED, ioa: int = 1) -> Record:
    at_ns = NOW + at_ms * 1_000_000
    rest = struct.pack("<fHB5x", value, 0, Content.FLOAT)
    return Record(
        Kind.INFORMATION,
        flags,
        1,
        0,
        1,
        ioa,
        received_ns=at_ns,
        tag_ns=at_ns,
        type=36,
        cause=cause,
        rest=rest,
    )


def take(store: Store, intake: Intake, *records: Record) -> list[tuple[float | None, int]]:
    """What is told of values: each with its quality."""
    intake.begin()
    store.transaction(lambda database: intake.take(database, records))
    return [(point.value, point.quality) for point in intake.stored().values]


def history(store: Store, ioa: int = 1) -> list[tuple[float, int, int]]:
    sql = (
        "SELECT history.value, history.quality, history.cause FROM history JOIN points ON points.id = point"
        " WHERE ioa = ? ORDER BY history.at_ns, history.id"
    )
    return store.transaction(lambda database: [tuple(row) for row in database.execute(sql, (ioa,))])


def test_an_event_that_came_before_says_nothing(store: Store, intake: Intake) -> None:
    """In the same batch or in an earlier one; its like of another time, value or point does."""
    assert take(store, intake, record(1, 0), record(2, 1), record(1, 0), record(1, 0, ioa=2)) == [
        (1, 0),
        (2, 0),
        (1, 0),
    ]
    assert take(store, intake, record(1, 0), record(2, 1), record(2, 2)) == [(2, 0)]
    assert history(store) == [(1, 0, SPONTANEOUS), (2, 0, SPONTANEOUS), (2, 0, SPONTANEOUS)]
    assert history(store, 2) == [(1, 0, SPONTANEOUS)]


def test_what_is_no_event_is_stored_when_it_changes(store: Store, intake: Intake) -> None:
    polled = [record(value, at, INTERROGATED, 0) for value, at in ((1, 0), (1, 1), (2, 2))]
    assert take(store, intake, *polled) == [(1, 0), (1, 0), (2, 0)]
    tagged = [record(value, at, REQUESTED) for value, at in ((2, 3), (3, 4))]
    assert take(store, intake, *tagged) == [(2, 0), (3, 0)]
    assert take(store, intake, record(2, 5, flags=0), record(3, 4, REQUESTED)) == [(2, 0)]
    stored = [(1, INTERROGATED), (2, INTERROGATED), (3, REQUESTED), (2, SPONTANEOUS)]
    assert [(value, cause) for value, _, cause in history(store)] == stored


def test_what_is_no_number_keeps_the_last_one(store: Store, intake: Intake) -> None:
    nan = float("nan")
    assert take(store, intake, record(nan, 0), record(5, 1), record(nan, 2)) == [
        (0, INVALID),
        (5, 0),
        (5, INVALID),
    ]
    assert take(store, intake, record(nan, 3)) == [(5, INVALID)]
