# SPDX-License-Identifier: GPL-3.0-or-later
"""Batches of records into the database; and what follows from them: values, alarms, commands."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import astuple, fields, replace
from operator import attrgetter
from typing import NamedTuple

from openrtu_tools.centre.alarms import NETWORK, Alarms, alarming
from openrtu_tools.centre.areas import Area, Areas
from openrtu_tools.centre.clocks import LIMIT_NS, Clock, Told
from openrtu_tools.centre.codes import (
    INVALID,
    NOT_TOPICAL,
    OVERFLOW,
    TEST,
    Content,
    Kind,
    Link,
    Result,
    State,
)
from openrtu_tools.centre.model import AlarmKey, Changes, Command, Model, Point, Station
from openrtu_tools.centre.records import ENDED, EVENTS, UNKNOWN_ALTITUDE, Record
from openrtu_tools.centre.rollup import Rollup
from openrtu_tools.centre.settings import AlarmRules, Meaning, StationSettings
from openrtu_tools.centre.store import Database, EventRow, inserted, put

ANSWERED = (Result.DONE, Result.EXCEPTION, Result.TIMEOUT)  # of a station that is there
LOST_PRIORITY, QUALITY_PRIORITY, POSITION_PRIORITY, CLOCK_PRIORITY = 1, 2, 3, 3
POINT_COLUMNS = [
    *("content", "value", "quality", "cause", "at_ns", "received_ns", "tagged"),
    *("latitude", "longitude", "altitude", "detail", "placed_ns"),
]
STATION_COLUMNS = ["link", "reason", "error", "since_ns", "heard_ns", "sessions", "records"]
TRACK_COLUMNS = ["point", "at_ns", "latitude", "longitude", "altitude", "quality", "detail"]
OF_POINT, OF_STATION = attrgetter(*POINT_COLUMNS, "id"), attrgetter(*STATION_COLUMNS, "id")
COMMAND_COLUMNS = [column.name for column in fields(Command)]


def _is_tagged_event(row: EventRow) -> bool:
    return row.cause in EVENTS and (bool(row.tagged) or row.tag_ns is not None)


class Taken(NamedTuple):
    """A record of a point, its row, and whether it is an event of before what is known."""

    record: Record
    row: EventRow
    is_old: bool


class Intake:
    """Owns the current state; only the writer's thread calls it, within a transaction.

    What a transaction changes lies in `changes` until it is stored: one that fails leaves nothing.
    """

    def __init__(
        self,
        database: Database,
        settings: dict[str, StationSettings],
        areas: tuple[Area, ...] = (),
        rules: AlarmRules | None = None,
    ) -> None:
        self.settings = settings
        self.areas = areas
        self.areas_of: dict[int, Areas] = {}  # by station
        self.clocks: defaultdict[int, defaultdict[int, Clock]] = defaultdict(lambda: defaultdict(Clock))
        self.sessions: dict[int, int] = {}  # by station: what came since is of one connection
        # By station and common address, then by point: the last old event; an interrogation is to judge it.
        self.doubted: defaultdict[tuple[int, int], dict[int, Point]] = defaultdict(dict)
        self.asked: dict[int, tuple[int, int]] = {}  # by the interrogation's id: of which address
        self.odd_points: set[int] = set()  # of which there are events whose tag nobody believes
        self.rollup = Rollup()
        self.model = Model()
        self.changes = Changes()
        self.alarms = Alarms(self.model, rules or AlarmRules())
        self.alarms.begin(self.changes)
        self.by_name: dict[str, int] = {}
        self.places: dict[int, int] = {}  # a station's place in the collector's file: its id
        self.by_address: dict[tuple[int, int, int], int] = {}
        self.invalid: defaultdict[tuple[int, int], set[int]] = defaultdict(set)
        self.heard: dict[int, tuple[int, int]] = {}  # by station, in this transaction: when last, how often
        self.places_of_tracks: list[tuple[int, ...]] = []  # rows
        # Of the transaction under way: what the table above does not have yet.
        self.new_points: dict[tuple[int, int, int], int] = {}
        self._load(database)

    # ---- at the start ------------------------------------------------------------------------

    def _load(self, database: Database) -> None:
        """What was stored, and each station and point of the file."""
        database.insert("stations", ["name"], [(name,) for name in self.settings])
        for row in database.execute("SELECT * FROM stations"):
            columns = dict(row)
            settings = self.settings.get(columns.pop("name")) or StationSettings(row["name"])
            columns["link"] = 0
            self.model.stations[row["id"]] = Station(settings=settings, **columns)
            self.by_name[row["name"]] = row["id"]
        untold = INVALID | NOT_TOPICAL
        database.insert(
            "points",
            ["station", "ca", "ioa", "quality"],
            [
                (self.by_name[name], ca, ioa, untold)
                for name, settings in self.settings.items()
                for ca, ioa in settings.points
            ],
        )
        for row in database.execute("SELECT * FROM points"):
            point = Point(meaning=self._meaning(row["station"], row["ca"], row["ioa"]), **dict(row))
            self.model.points[point.id] = point
            self.by_address[point.station, point.ca, point.ioa] = point.id
            if point.at_ns and point.quality & INVALID:
                self.invalid[point.station, point.ca].add(point.id)
        self.alarms.load(database)
        self.odd_points = {row[0] for row in database.execute("SELECT DISTINCT point FROM odd_tags")}
        self._forgotten(database)
        self.stranded(database)

    def _forgotten(self, database: Database) -> None:
        """What the file has no more would never end: a station, an area, a limit."""
        areas = {(area.alarm, area.name) for area in self.areas}

        def is_forgotten(kind: str, station: int, point: int | None, area: str | None) -> bool:
            if self.model.stations[station].settings.name not in self.settings:
                return True
            if area:
                return (kind, area) not in areas
            return bool(point) and getattr(self.model.points[point].meaning, kind) is None

        for alarm in [*self.model.alarms.values()]:
            told = alarm.kind, alarm.station, alarm.point, alarm.area
            if alarm.active and alarm.kind != NETWORK and is_forgotten(*told):
                self.alarms.put(database, replace(alarm, gone_ns=max(time.time_ns(), alarm.last_ns)))
        for cause in [*self.model.causes.values()]:
            if is_forgotten(cause.kind, cause.station, cause.point, cause.area):
                self.alarms.forget(database, cause.key)
        self.alarms.end(database)

    def stranded(self, database: Database, of: Callable[[Station], bool] = lambda station: True) -> None:
        """Their collector is gone: what became of the commands that were not ended, nobody can say."""
        gone = {station.id for station in self.model.stations.values() if of(station)}
        rows = database.execute(
            f"SELECT * FROM commands WHERE state NOT IN ({', '.join(str(int(state)) for state in ENDED)})"
        )
        for command in [Command(**dict(row)) for row in rows]:
            if self.model.points[command.point].station not in gone:
                continue
            sent = command.state in (State.EXECUTION_REQUEST, State.EXECUTING)
            state = State.REFUSED_COMMAND if sent else State.INTERRUPTED_SELECTION
            self.put_command(
                database,
                replace(command, state=state, result=Result.UNKNOWN_FATE, changed_ns=time.time_ns()),
            )
        for station in self.model.stations.values():
            if station.link and station.id in gone:
                self.changes.stations[station.id] = replace(station, link=0, since_ns=time.time_ns())

    # ---- a transaction -----------------------------------------------------------------------

    def begin(self) -> None:
        self.changes = Changes()
        self.rollup.begin()
        self.alarms.begin(self.changes)
        self.new_points.clear()
        self.heard.clear()
        self.places_of_tracks.clear()

    def stored(self) -> Changes:
        """The transaction is on the disk."""
        self.model.take(self.changes)
        self.rollup.stored()
        for id_, command in self.changes.commands.items():
            if command.state in ENDED:
                del self.model.commands[id_]
        self.alarms.stored()
        for point in self.changes.points.values():
            self.by_address[point.station, point.ca, point.ioa] = point.id
            of_address = self.invalid[point.station, point.ca]
            (of_address.add if point.quality & INVALID else of_address.discard)(point.id)
        for station in self.changes.stations.values():
            self.by_name[station.settings.name] = station.id
        return self.changes

    def take(self, database: Database, records: Iterable[Record]) -> None:
        """Stores records, and what follows from them."""
        information: list[Record] = []
        ended: list[Record] = []
        for record in records:
            if record.kind == Kind.STATION:
                self._station_named(database, record)
            elif record.kind == Kind.LINK:
                self._link(database, record)
            elif record.kind == Kind.POSITION:
                self._heard(record)
                self._position(database, record)
            elif record.kind == Kind.INFORMATION:
                self._heard(record)
                if record.content != Content.INITIALISATION and not record.flags & TEST:
                    information.append(record)
            elif record.kind == Kind.PROGRESS:
                self._progress(database, record)
                ended.append(record)
        self._information(database, information)
        for record in ended:
            self._ended(database, record)
        database.insert("track", TRACK_COLUMNS, self.places_of_tracks)
        self._clock_alarms(database)
        self._store_heard()
        self._quality_alarms(database)
        self.alarms.end(database)
        self._store_last(database)

    def due(self, database: Database) -> None:
        """What has lasted long enough for an alarm."""
        self.alarms.due(database)
        self.alarms.end(database)

    def _store_last(self, database: Database) -> None:
        points, stations = self.changes.points.values(), self.changes.stations.values()
        database.update("points", POINT_COLUMNS, [*map(OF_POINT, points)])
        database.update("stations", STATION_COLUMNS, [*map(OF_STATION, stations)])

    # ---- stations ----------------------------------------------------------------------------

    def _station(self, id_: int) -> Station:
        return self.changes.stations.get(id_) or self.model.stations[id_]

    def _station_named(self, database: Database, record: Record) -> None:
        id_ = self.by_name.get(record.name)
        if id_ is None:
            id_ = inserted(database, "INSERT INTO stations (name) VALUES (?)", (record.name,))
            station = Station(id_, self.settings.get(record.name) or StationSettings(record.name))
        else:
            station = self._station(id_)
        self.places[record.station] = id_
        self.changes.stations[id_] = replace(station, place=record.station)

    def _heard(self, record: Record) -> None:
        """What it is of all records of a transaction is stored at its end."""
        id_ = self.places[record.station]
        self.heard[id_] = record.received_ns, self.heard[id_][1] + 1 if id_ in self.heard else 1

    def _store_heard(self) -> None:
        for id_, (heard_ns, count) in self.heard.items():
            station = self._station(id_)
            seen = [clock.seen_ns for clock in self.clocks[id_].values() if clock.seen_ns is not None]
            clock = max(seen, key=abs) if seen else None
            self.changes.stations[id_] = Station(
                station.id, station.settings, station.place,
                station.link, station.reason, station.error, station.since_ns,
                heard_ns, station.sessions, station.records + count, clock,
            )  # fmt: skip
        self.heard.clear()

    def _link(self, database: Database, record: Record) -> None:
        station = self._station(self.places[record.station])
        state, reason, error, _ = record.link
        if state == Link.UP:
            self.sessions.setdefault(station.id, record.received_ns)
        else:  # the first events of a connection may come before it is said to be up
            self.sessions[station.id] = record.received_ns
        if state == Link.CONNECTING and station.link == Link.DOWN:
            return  # another attempt: down is what an operator needs to know
        self.changes.stations[station.id] = replace(
            station,
            link=state,
            reason=reason,
            error=error,
            since_ns=record.received_ns if state != station.link else station.since_ns,
            sessions=station.sessions + (state == Link.UP),
        )
        key: AlarmKey = ("lost", station.id, None, None)
        if state == Link.DOWN:
            self.alarms.raise_(database, key, LOST_PRIORITY, record.received_ns)
        elif state == Link.UP:
            self.alarms.clear(database, key, record.received_ns)

    # ---- points ------------------------------------------------------------------------------

    def _point(self, database: Database, record: Record) -> Point:
        station = self.places[record.station]
        address = (station, record.ca, record.ioa)
        id_ = self.by_address.get(address) or self.new_points.get(address)
        if id_ is not None:
            return self.changes.points.get(id_) or self.model.points[id_]
        id_ = inserted(database, "INSERT INTO points (station, ca, ioa) VALUES (?, ?, ?)", address)
        point = Point(id_, *address, self._meaning(station, record.ca, record.ioa))
        self.changes.points[point.id] = point
        self.new_points[address] = point.id
        return point

    def _meaning(self, station: int, ca: int, ioa: int) -> Meaning:
        return self._station(station).settings.points.get((ca, ioa)) or Meaning(f"{ca}.{ioa}")

    def _information(self, database: Database, records: list[Record]) -> None:
        """Events first, all at once. One that came before, and whose acknowledgement did not reach the
        station, says nothing.
        """
        taken = self._rows(database, records)
        without_tag: list[EventRow] = []  # that is believed: none of them came before
        is_new = iter(self._insert_events(database, [each.row for each in taken], without_tag))
        for record, row, is_old in taken:
            point = self._now(row.point)
            changed = (row.value, row.quality) != (point.value, point.quality) or not point.at_ns
            if _is_tagged_event(row):
                counts = next(is_new)
            elif row.tagged and changed:
                [counts] = database.insert_events([row])
            else:
                counts = True
                if changed or row.cause in EVENTS:
                    without_tag.append(row)
            if counts:
                self._value(database, point, record, row, is_old)
        database.insert("history", EventRow._fields, without_tag)
        self.rollup.add(database, ((each.row.point, each.row.at_ns) for each in taken))

    def _now(self, id_: int) -> Point:
        return self.changes.points.get(id_) or self.model.points[id_]

    def _rows(self, database: Database, records: list[Record]) -> list[Taken]:
        """Nothing of them is stored yet: what the one says of the state, the next must know."""
        taken = []
        last: dict[int, tuple[float, Told]] = {}
        for record in records:
            point = self._point(database, record)
            last_value, before = last.get(point.id) or (point.value or 0.0, point.told)
            clock = self._clock(point)
            believed = record.tagged and clock.believes(record, before)
            at_ns = record.tag_ns if believed else record.received_ns
            value, quality = record.value, record.quality
            if not math.isfinite(value):  # of a float of the wire: neither JSON nor a chart has it
                value, quality = last_value, quality | INVALID
            is_old = clock.is_old(record, at_ns, before)
            told = before if is_old else Told(at_ns, record.received_ns, record.is_event, believed)
            last[point.id] = value, told
            tag_ns = record.tag_ns if record.tagged and not believed else None
            row = EventRow(
                point.id, at_ns, value, quality, record.received_ns, record.cause, int(believed), tag_ns
            )
            taken.append(Taken(record, row, is_old))
        return taken

    def _insert_events(
        self, database: Database, rows: list[EventRow], without_tag: list[EventRow]
    ) -> list[bool]:
        """Of each tagged event whether it is new. It is known by its tag, even if nobody believes that."""
        events = [row for row in rows if _is_tagged_event(row)]
        plain = [row for row in events if row.tagged and not self._came_oddly(database, row)]
        is_new = dict(zip(map(id, plain), database.insert_events(plain), strict=True))
        for row in events:
            if row.tag_ns is not None and self._is_new_oddly(database, row):
                is_new[id(row)] = True
                without_tag.append(row)
        return [is_new.get(id(row), False) for row in events]

    def _came_oddly(self, database: Database, row: EventRow) -> bool:
        """When it came first, its clock was not believed."""
        if row.point not in self.odd_points:
            return False
        sql = "SELECT 1 FROM odd_tags WHERE point = ? AND tag_ns = ? AND value = ? AND quality = ?"
        return database.execute(sql, row[:4]).fetchone() is not None

    def _is_new_oddly(self, database: Database, row: EventRow) -> bool:
        """Its time in the history is that of its arrival, by which nobody would know it again."""
        key = (row.point, row.tag_ns, row.value, row.quality)
        self.odd_points.add(row.point)
        where = "point = ? AND at_ns = ? AND value = ? AND quality = ? AND tagged <> 0"
        if database.execute(f"SELECT 1 FROM history WHERE {where}", key).fetchone():
            return False
        sql = (
            "INSERT INTO odd_tags (point, tag_ns, value, quality, received_ns) VALUES (?, ?, ?, ?, ?)"
            " ON CONFLICT DO NOTHING"
        )
        return database.execute(sql, (*key, row.received_ns)).rowcount == 1

    def _value(self, database: Database, before: Point, record: Record, row: EventRow, is_old: bool) -> None:
        point = Point(
            before.id, before.station, before.ca, before.ioa, before.meaning,
            record.content, row.value, row.quality, row.cause,
            row.at_ns, row.received_ns, row.tagged,
            before.latitude, before.longitude, before.altitude, record.detail, before.placed_ns,
        )  # fmt: skip
        self.changes.values.append(point)
        same = (row.value, row.quality) == (before.value, before.quality)
        if is_old:
            self._doubt(point, same)
            self._point_alarms(database, point, before)
            return
        self._judge(point, record, same)
        self.changes.points[point.id] = point
        self._point_alarms(database, point)

    def _position(self, database: Database, record: Record) -> None:
        before = self._point(database, record)
        clock = self._clock(before)
        believed = record.tagged and clock.believes(record, before.told)
        at_ns = record.tag_ns if believed else record.received_ns
        latitude, longitude, altitude = record.position
        quality, placed_ns = record.quality, at_ns
        if altitude == UNKNOWN_ALTITUDE:
            quality &= ~OVERFLOW  # of the altitude alone
        if quality & INVALID:  # a receiver without a fix tells 0 or anything: what is known is the last place
            latitude, longitude, altitude = before.latitude, before.longitude, before.altitude
            placed_ns = before.placed_ns
        if latitude is not None:
            self.places_of_tracks.append(
                (before.id, at_ns, latitude, longitude, altitude, quality, record.detail)
            )
        # By place, not by dataclasses.replace: that would cost as much as all else that is done for a record.
        point = Point(
            before.id, before.station, before.ca, before.ioa, before.meaning,
            Content.POSITION, before.value, quality, record.cause,
            at_ns, record.received_ns, int(believed),
            latitude, longitude, altitude, record.detail, placed_ns,
        )  # fmt: skip
        same = (latitude, longitude, quality) == (before.latitude, before.longitude, before.quality)
        if clock.is_old(record, at_ns, before.told):  # of the station's queue: where it was, not where it is
            self._doubt(point, same)
            return
        self._judge(point, record, same)
        self.changes.points[point.id] = point
        self.changes.values.append(point)
        if self.areas and not point.quality & INVALID:
            self._area_alarms(database, point)

    # ---- what is old, or of a clock that is wrong --------------------------------------------

    def _clock(self, point: Point) -> Clock:
        clock = self.clocks[point.station][point.ca]
        clock.be_of_session(self.sessions.get(point.station, 0))
        return clock

    def _doubt(self, point: Point, same: bool) -> None:
        """An event of before the state: the station kept it, or its clock is behind and it is news.

        An interrogation says what is true, and its answer is behind this event.
        """
        address = point.station, point.ca
        if same:
            self.doubted[address].pop(point.id, None)
        else:
            self.doubted[address][point.id] = point
            self.changes.doubts.add(address)

    def _judge(self, point: Point, record: Record, same: bool) -> None:
        """An answer that has the value of the event, and not the one of before: the event was news."""
        address = point.station, point.ca
        if address not in self.doubted:
            return
        event = self.doubted[address].pop(point.id, None)
        if event is None or record.is_event or same:
            return
        if (event.value, event.quality, event.latitude, event.longitude) == (
            point.value, point.quality, point.latitude, point.longitude,
        ):  # fmt: skip
            clock = self._clock(point)
            clock.news = True
            clock.wrong |= event.at_ns < event.received_ns - LIMIT_NS

    def _ended(self, database: Database, record: Record) -> None:
        """Of an interrogation of ours: its answers stand before this record. One that did not reach the
        station, or was lost with its connection, says nothing.
        """
        state, result, id_ = record.progress
        if id_ in self.asked and state in ENDED:
            address = self.asked.pop(id_)
            if result in ANSWERED:
                self._settle(database, address)

    def _settle(self, database: Database, address: tuple[int, int]) -> None:
        """Of what the interrogation did not answer the order of arrival decides."""
        for event in self.doubted.pop(address, {}).values():
            point = replace(event, at_ns=event.received_ns, tagged=0)
            self.changes.points[point.id] = point
            if point.is_position:
                if self.areas and not point.quality & INVALID:
                    self._area_alarms(database, point)
            else:
                self._point_alarms(database, point)

    def _clock_alarms(self, database: Database) -> None:
        """Of the stations that were heard."""
        for id_, (heard_ns, _) in self.heard.items():
            for ca, clock in self.clocks[id_].items():
                key: AlarmKey = ("clock", id_, ca, None)
                if clock.wrong:
                    self.alarms.raise_(
                        database, key, CLOCK_PRIORITY, heard_ns, value=round(clock.ahead_ns / 1e9)
                    )
                else:
                    self.alarms.clear(database, key, heard_ns)

    # ---- alarms ------------------------------------------------------------------------------

    def _point_alarms(self, database: Database, point: Point, now: Point | None = None) -> None:
        """Of limits and of a state. A value that is not valid says nothing about them.

        `now` is the state behind an old event, which does not end what is so now.
        """

        def is_active(kind: str) -> bool:
            return self.alarms.is_active((kind, point.station, point.id, None))

        rules = self.alarms.rules
        so = alarming(point, rules, is_active)
        so_now = alarming(now, rules, is_active) if now else {}
        for kind, is_so in so.items():
            key: AlarmKey = (kind, point.station, point.id, None)
            if is_so:
                self.alarms.raise_(database, key, point.meaning.priority, point.at_ns, point)
            elif not so_now.get(kind):
                self.alarms.clear(database, key, point.at_ns)

    def _area_alarms(self, database: Database, point: Point) -> None:
        assert point.place
        if point.station not in self.areas_of:
            group = self._station(point.station).settings.group
            self.areas_of[point.station] = Areas(self.areas, group)
        for area, is_so in self.areas_of[point.station].alarms(*point.place):
            key: AlarmKey = (area.alarm, point.station, point.id, area.name)
            if is_so:
                self.alarms.raise_(database, key, area.priority, point.at_ns, point)
            else:
                self.alarms.clear(database, key, point.at_ns)

    def _quality_alarms(self, database: Database) -> None:
        """One for all points of a common address: a dead device is one fault, however many points it has."""
        touched: defaultdict[tuple[int, int], list[Point]] = defaultdict(list)
        for point in self.changes.points.values():
            touched[point.station, point.ca].append(point)
        for (station, ca), points in touched.items():
            invalid = set(self.invalid[station, ca])
            for point in points:
                (invalid.add if point.quality & INVALID else invalid.discard)(point.id)
            key: AlarmKey = ("quality", station, ca, None)
            now_ns = max(point.received_ns for point in points)
            if invalid:
                only_positions = all(point.is_position for point in points if point.id in invalid)
                priority = POSITION_PRIORITY if only_positions else QUALITY_PRIORITY
                self.alarms.raise_(database, key, priority, now_ns, value=len(invalid))
            else:
                self.alarms.clear(database, key, now_ns)

    # ---- commands ----------------------------------------------------------------------------

    def put_command(self, database: Database, command: Command) -> None:
        put(database, "commands", COMMAND_COLUMNS, astuple(command))
        self.changes.commands[command.id] = command

    def add_command(self, database: Database, command: Command) -> Command:
        """With an id of its own: it is stored before it is sent."""
        columns = ", ".join(f'"{column}"' for column in COMMAND_COLUMNS[1:])
        places = ", ".join("?" * len(COMMAND_COLUMNS[1:]))
        id_ = inserted(database, f"INSERT INTO commands ({columns}) VALUES ({places})", astuple(command)[1:])
        command = replace(command, id=id_)
        self.changes.commands[command.id] = command
        return command

    def is_commanded(self, point: int) -> bool:
        """A command of it has not ended."""
        known = {**self.model.commands, **self.changes.commands}
        return any(command.point == point and command.state not in ENDED for command in known.values())

    def end_command(self, database: Database, id_: int, state: State, result: Result) -> None:
        """It was not sent."""
        command = self.model.commands.get(id_)
        if command:
            self.put_command(
                database, replace(command, state=state, result=result, changed_ns=time.time_ns())
            )

    def _progress(self, database: Database, record: Record) -> None:
        state, result, id_ = record.progress
        command = self.changes.commands.get(id_) or self.model.commands.get(id_)
        if not command or command.state in ENDED:
            return  # a poll, or an interrogation
        self.put_command(
            database,
            replace(command, state=state, result=result, cause=record.cause, changed_ns=record.received_ns),
        )
