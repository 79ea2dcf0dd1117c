# SPDX-License-Identifier: GPL-3.0-or-later
"""What a batch of records leaves in either store, and what is told of it."""

import contextlib
import struct
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from openrtu_tools.centre.codes import INVALID, OVERFLOW, TAGGED, Cause, Content, Kind, Link, Result, State
from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.intake import Intake
from openrtu_tools.centre.model import Alarm, Point
from openrtu_tools.centre.records import UNKNOWN_ALTITUDE, Record
from openrtu_tools.centre.settings import Meaning, StationSettings
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


def record(
    value: float, at_ms: int, cause: int = Cause.SPONTANEOUS, flags: int = TAGGED, ioa: int = 1
) -> Record:
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
    assert history(store) == [(1, 0, Cause.SPONTANEOUS), (2, 0, Cause.SPONTANEOUS), (2, 0, Cause.SPONTANEOUS)]
    assert history(store, 2) == [(1, 0, Cause.SPONTANEOUS)]


def test_what_is_no_event_is_stored_when_it_changes(store: Store, intake: Intake) -> None:
    polled = [record(value, at, INTERROGATED, 0) for value, at in ((1, 0), (1, 1), (2, 2))]
    assert take(store, intake, *polled) == [(1, 0), (1, 0), (2, 0)]
    tagged = [record(value, at, REQUESTED) for value, at in ((2, 3), (3, 4))]
    assert take(store, intake, *tagged) == [(2, 0), (3, 0)]
    assert take(store, intake, record(2, 5, flags=0), record(3, 4, REQUESTED)) == [(2, 0)]
    stored = [(1, INTERROGATED), (2, INTERROGATED), (3, REQUESTED), (2, Cause.SPONTANEOUS)]
    assert [(value, cause) for value, _, cause in history(store)] == stored


def test_what_is_no_number_keeps_the_last_one(store: Store, intake: Intake) -> None:
    nan = float("nan")
    assert take(store, intake, record(nan, 0), record(5, 1), record(nan, 2)) == [
        (0, INVALID),
        (5, 0),
        (5, INVALID),
    ]
    assert take(store, intake, record(nan, 3)) == [(5, INVALID)]


# ---- times: what is old, and clocks that are wrong ---------------------------------------------------

S = 1000  # ms
HOUR = 3600 * S
GI = 1 << 48  # the id of an interrogation


def said(value: float, at_ms: int, tag_ms: int, cause: int = Cause.SPONTANEOUS, ioa: int = 1) -> Record:
    """It comes at one time, and its tag says another."""
    return replace(record(value, at_ms, cause, ioa=ioa), tag_ns=NOW + tag_ms * 1_000_000)


def answered(value: float, at_ms: int) -> Record:
    return record(value, at_ms, INTERROGATED, 0)


def linked(up: bool, at_ms: int) -> Record:
    state = Link.UP if up else Link.DOWN
    rest = struct.pack("<BB2xII", state, 0, 0, 0)
    return Record(Kind.LINK, 0, 0, 0, 1, 0, received_ns=NOW + at_ms * 1_000_000, rest=rest)


def ended(
    id_: int, at_ms: int, state: State = State.EXECUTED_COMMAND, result: Result = Result.DONE
) -> Record:
    rest = struct.pack("<BB2xQ", state, result, id_)
    return Record(Kind.PROGRESS, 0, 1, 0, 1, 0, received_ns=NOW + at_ms * 1_000_000, rest=rest)


def placed(
    latitude: float, at_ms: int, tag_ms: int | None = None, quality: int = 0, altitude: int = 1170,
    cause: int = Cause.SPONTANEOUS,
) -> Record:  # fmt: skip
    rest = struct.pack("<iii", round(latitude * 1e7), round(20.4e7 if latitude else 0), altitude)
    tag_ns = NOW + (at_ms if tag_ms is None else tag_ms) * 1_000_000
    return Record(
        Kind.POSITION, TAGGED, 1, 0, 1, 9, received_ns=NOW + at_ms * 1_000_000, tag_ns=tag_ns, type=201,
        cause=cause, quality=quality, detail=0x91, rest=rest,
    )  # fmt: skip


def state(intake: Intake, ioa: int = 1) -> Point:
    [point] = [each for each in intake.model.points.values() if each.ioa == ioa]
    return point


def age_ms(intake: Intake, at_ms: int, ioa: int = 1) -> int:
    """Of what is known, at a time."""
    return at_ms - (state(intake, ioa).at_ns - NOW) // 1_000_000


def clock_alarm(intake: Intake) -> Alarm | None:
    return next((each for each in intake.model.alarms.values() if each.kind == "clock"), None)


def test_event_of_before_an_interrogation_leaves_the_state(store: Store, intake: Intake) -> None:
    """A station answers 100, then its queue tells of the 50 of a minute before: the event is stored, and the
    state stays, though the queue takes long. The interrogation that is asked for says the same."""
    take(store, intake, linked(True, 0), answered(100, 1))
    assert take(store, intake, said(50, 2, -60 * S), said(70, 3, -30 * S)) == [(50, 0), (70, 0)]
    assert state(intake).value == 100
    assert intake.changes.doubts == {(1, 1)}
    assert [value for value, _, _ in history(store)] == [50, 70, 100]
    take(store, intake, answered(100, 2 * S), ended(GI, 2 * S))
    assert (state(intake).value, intake.doubted[1, 1]) == (100, {})
    take(store, intake, said(110, 3 * S, 3 * S))
    assert state(intake).value == 110 and not intake.changes.doubts


def test_events_that_waited_may_come_before_the_connection_is_said_to_be_up(
    store: Store, intake: Intake
) -> None:
    """As rtu-centre tells it, when a station's confirmation and its first events come together."""
    take(store, intake, linked(True, 0), said(100, 1, 1))
    take(store, intake, linked(False, 10))
    take(store, intake, said(50, 20, -90 * S), linked(True, 21), said(60, 22, -80 * S))
    assert (state(intake).value, clock_alarm(intake)) == (100, None)
    assert [value for value, _, _ in history(store)] == [50, 60, 100]


def test_event_of_before_that_ends_with_the_state_is_no_doubt(store: Store, intake: Intake) -> None:
    take(store, intake, linked(True, 0), answered(100, 1), said(50, 2, -60 * S), said(100, 3, -30 * S))
    assert intake.doubted[1, 1] == {}


def test_clock_that_is_behind_is_found_by_the_interrogation(store: Store, intake: Intake) -> None:
    """Its event looks as if it had waited; the interrogation says that it was news. From then on the order of
    arrival counts, and an alarm says whose clock is off."""
    take(store, intake, linked(True, 0), answered(100, 1))
    take(store, intake, said(50, 10 * S, 10 * S - HOUR))
    assert state(intake).value == 100
    take(store, intake, answered(50, 11 * S), ended(GI, 11 * S))
    assert state(intake).value == 50
    alarm = clock_alarm(intake)
    assert alarm and alarm.value == -3600 and alarm.gone_ns is None
    take(store, intake, said(70, 20 * S, 20 * S - HOUR))
    assert (state(intake).value, age_ms(intake, 20 * S)) == (70, 0)
    assert intake.model.stations[1].clock_ns == -3600 * 10**9
    take(store, intake, said(80, 30 * S, 30 * S))
    alarm = clock_alarm(intake)
    assert alarm and alarm.gone_ns is not None


def test_old_event_of_what_nobody_interrogates_counts_at_last(store: Store, intake: Intake) -> None:
    """A point that no interrogation answers: when it has ended, the order of arrival decides."""
    take(store, intake, linked(True, 0), said(100, 1, 1), linked(False, 2), linked(True, 3))
    take(store, intake, said(50, 4, -10 * S))
    assert state(intake).value == 100
    for lost in (Result.NOT_UP, Result.UNKNOWN_FATE):  # nobody was asked: the next interrogation judges
        intake.asked[GI] = 1, 1
        take(store, intake, ended(GI, 1 * S, State.REFUSED_COMMAND, lost))
        assert (state(intake).value, intake.asked) == (100, {})
    intake.asked[GI] = 1, 1
    take(store, intake, ended(GI, 2 * S, State.REFUSED_COMMAND))
    assert state(intake).value == 50


def test_value_that_is_tagged_ahead_came_when_it_came(store: Store, intake: Intake) -> None:
    """An hour ahead: its age is since it came, its event is in the lists, and comes once; its alarm does not
    end before it begins."""
    take(store, intake, linked(True, 0), said(1, 10, HOUR + 10))
    assert age_ms(intake, 10) == 0
    sql = "SELECT at_ns, tag_ns FROM history"
    rows = store.transaction(lambda database: [tuple(row) for row in database.execute(sql)])
    assert rows == [(NOW + 10 * 1_000_000, NOW + (HOUR + 10) * 1_000_000)]
    alarm = clock_alarm(intake)
    assert alarm and alarm.value == 3600
    take(store, intake, linked(False, 20), linked(True, 30))
    assert take(store, intake, said(1, 40, HOUR + 10)) == []  # once more: it was not acknowledged
    assert len(history(store)) == 1
    assert take(store, intake, said(1, HOUR, HOUR + 10)) == []  # so late that the tag is believed
    assert len(history(store)) == 1


def test_alarm_does_not_end_before_it_began(store: Store) -> None:
    meaning = Meaning("level", high=5.0)
    settings = {"north": StationSettings("north", points={(1, 1): meaning})}
    intake = store.transaction(lambda database: Intake(database, settings))
    intake.stored()
    take(store, intake, Record(Kind.STATION, 0, 0, 0, 0, 0, name="north", received_ns=1), linked(True, 0))
    take(store, intake, said(9, 10, 10), said(1, 20, 5))
    [row] = store.transaction(lambda database: list(database.execute("SELECT * FROM alarms")))
    assert row["gone_ns"] == row["since_ns"] == NOW + 10 * 1_000_000


def test_old_event_ends_no_alarm_of_what_is_so_now(store: Store) -> None:
    """And it tells of one that was meanwhile."""
    meaning = Meaning("level", high=5.0, low=0.0)
    settings = {"north": StationSettings("north", points={(1, 1): meaning})}
    intake = store.transaction(lambda database: Intake(database, settings))
    intake.stored()
    take(store, intake, Record(Kind.STATION, 0, 0, 0, 0, 0, name="north", received_ns=1), linked(True, 0))
    take(store, intake, answered(9, 50), said(-1, 60, -200), said(1, 70, -100))
    alarms = {alarm.kind: alarm.gone_ns for alarm in intake.model.alarms.values()}
    assert alarms == {"high": None, "low": NOW - 100_000_000}


def test_vehicle_whose_clock_steps_back_moves_on(store: Store, intake: Intake) -> None:
    """By an hour, or to 2006: its next place is the present one, and says when it came."""
    take(store, intake, linked(True, 0), placed(44.8, 1 * S))
    for step, latitude in ((HOUR, 44.9), (20 * 365 * 24 * HOUR, 45.0)):
        take(store, intake, placed(latitude, 2 * S, 2 * S - step))
        assert (state(intake, 9).latitude, age_ms(intake, 2 * S, 9)) == (round(latitude * 1e7), 0)
        assert intake.model.stations[1].clock_ns == -step * 1_000_000
    assert clock_alarm(intake)
    take(store, intake, placed(45.1, 3 * S))
    assert age_ms(intake, 3 * S, 9) == 0
    track = "SELECT at_ns FROM track ORDER BY at_ns"
    rows = store.transaction(lambda database: [row[0] for row in database.execute(track)])
    assert {(at - NOW) // 1_000_000_000 for at in rows} <= {1, 2, 3}


def test_polled_vehicle_with_a_clock_of_2006_is_where_it_says(store: Store, intake: Intake) -> None:
    behind = 20 * 365 * 24 * HOUR
    take(store, intake, linked(True, 0))
    for second in range(1, 4):
        take(store, intake, placed(44 + second, second * S, second * S - behind, cause=REQUESTED))
        assert state(intake, 9).latitude == round((44 + second) * 1e7)
    assert age_ms(intake, 3 * S, 9) == 0


def test_places_that_waited_are_no_present_ones(store: Store, intake: Intake) -> None:
    """They are of the track; the state is the interrogation's."""
    take(store, intake, linked(True, 0), placed(45, 1, cause=INTERROGATED))
    take(store, intake, placed(44, 2, -60 * S), placed(44.5, 3, -30 * S))
    assert state(intake, 9).latitude == round(45e7)
    rows = store.transaction(lambda database: list(database.execute("SELECT * FROM track")))
    assert len(rows) == 3


# ---- places ------------------------------------------------------------------------------------------


def test_vehicle_that_loses_its_fix_stays_where_it_was(store: Store, intake: Intake) -> None:
    """With the time of the place; before the first fix there is none."""
    take(store, intake, placed(0, 0, quality=INVALID, altitude=0))
    assert state(intake, 9).place is None
    view = state(intake, 9).view()
    assert (view["latitude"], view["longitude"], view["altitude"]) == (None, None, None)
    take(store, intake, placed(44.8, 1 * S), placed(0, 5 * S, quality=INVALID, altitude=0))
    view = state(intake, 9).view()
    assert (view["latitude"], view["longitude"], view["altitude"], view["quality"]) == (
        44.8,
        20.4,
        117,
        INVALID,
    )
    assert (view["at"] - view["placed"], age_ms(intake, 5 * S, 9)) == (4 * S, 0)
    tracked = store.transaction(
        lambda database: [tuple(row) for row in database.execute("SELECT latitude, quality FROM track")]
    )
    assert tracked == [(448_000_000, 0), (448_000_000, INVALID)]


def test_altitude_that_nobody_knows_is_none(store: Store, intake: Intake) -> None:
    """A receiver of RMC alone: type 201 says so with OV, and the place is good."""
    take(store, intake, placed(44.8, 1, quality=OVERFLOW, altitude=UNKNOWN_ALTITUDE))
    view = state(intake, 9).view()
    assert (view["latitude"], view["altitude"], view["quality"]) == (44.8, None, 0)
