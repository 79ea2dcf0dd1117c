# SPDX-License-Identifier: GPL-3.0-or-later
"""What the centre knows now: stations, points, open alarms, commands, each as it was last stored."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from openrtu_tools.centre.clocks import Told
from openrtu_tools.centre.codes import INVALID, Content, Link
from openrtu_tools.centre.records import EVENTS, UNKNOWN_ALTITUDE

if TYPE_CHECKING:  # who makes a file needs none of it, and would wait for its schema's library
    from openrtu_tools.centre.settings import Meaning, StationSettings

Json = dict[str, Any]
NS_PER_MS = 1_000_000

# Kind, station, point or common address, area: there is one open alarm of each.
AlarmKey = tuple[str, int, int | None, str | None]


def degrees(number: int | None) -> float | None:
    """Of 1e-7 degree; None: nobody knows the place."""
    return None if number is None else number / 1e7


def metres(number: int | None) -> float | None:
    """Of the decimetres of type 201; None: nobody knows the altitude."""
    return None if number is None or number == UNKNOWN_ALTITUDE else number / 10


def milliseconds(ns: int | None) -> int | None:
    """Of the page's clock; None for never."""
    return ns // NS_PER_MS if ns else None


@dataclass(frozen=True, slots=True)
class Station:
    id: int
    settings: StationSettings
    place: int = -1  # in the collector's file; -1: it has not named it
    link: int = 0  # codes.Link; 0: the collector does not say
    reason: int = 0
    error: int = 0
    since_ns: int = 0
    heard_ns: int = 0
    sessions: int = 0
    records: int = 0
    clock_ns: int | None = None  # ahead of ours, by what came with the least delay; not stored

    @property
    def up(self) -> bool:
        return self.link == Link.UP

    def view(self) -> Json:
        return {
            "id": self.id,
            "name": self.settings.name,
            "group": self.settings.group,
            "location": self.settings.location,
            "link": self.link,
            "reason": self.reason,
            "error": self.error,
            "since": milliseconds(self.since_ns),
            "heard": milliseconds(self.heard_ns),
            "sessions": self.sessions,
            "records": self.records,
            "clock": None if self.clock_ns is None else self.clock_ns // NS_PER_MS,
        }


@dataclass(frozen=True, slots=True)
class Point:
    id: int
    station: int
    ca: int
    ioa: int
    meaning: Meaning
    content: int | None = None
    value: float | None = None
    quality: int = INVALID
    cause: int = 0
    at_ns: int = 0
    received_ns: int = 0
    tagged: int = 0
    latitude: int | None = None
    longitude: int | None = None
    altitude: int | None = None
    detail: int = 0
    placed_ns: int = 0  # when it was there: the last place that was valid

    @property
    def is_position(self) -> bool:
        return self.content == Content.POSITION

    @property
    def place(self) -> tuple[float, float] | None:
        """Where it was last, in degrees."""
        if not self.is_position or self.latitude is None or self.longitude is None:
            return None
        return self.latitude / 1e7, self.longitude / 1e7

    @property
    def told(self) -> Told:
        return Told(self.at_ns, self.received_ns, self.cause in EVENTS, bool(self.tagged))

    def view(self) -> Json:
        return {"station": self.station, **self.listed(), **self.as_received()}

    def listed(self) -> Json:
        """What it is, whatever it says."""
        meaning = self.meaning
        return {
            "ca": self.ca,
            "ioa": self.ioa,
            "name": meaning.name,
            "unit": meaning.unit,
            "device": meaning.device,
            "command": meaning.command,
            "selects": meaning.selects,
            "minimum": meaning.minimum,
            "maximum": meaning.maximum,
            "content": self._content(),
        }

    def news(self) -> Json:
        """What changes with a record; all else is of the list of points."""
        changes: Json = {
            "id": self.id,
            "content": self._content(),
            "value": self.value,
            "quality": self.quality,
            "at": milliseconds(self.at_ns),
            "tagged": bool(self.tagged),
        }
        if self.is_position:
            changes |= {
                "latitude": degrees(self.latitude),
                "longitude": degrees(self.longitude),
                "altitude": metres(self.altitude),
                "placed": milliseconds(self.placed_ns),
                "fix": self.detail & 15,
                "satellites": self.detail >> 4,
            }
        return changes

    def _content(self) -> int | None:
        """What its list says of one that has no value yet; only a position that was is somewhere."""
        listed = None if self.meaning.content == Content.POSITION else self.meaning.content
        return listed if self.content is None else self.content

    def as_received(self) -> Json:
        """With when it came, as a program wants to know that knows the link."""
        return {**self.news(), "received": milliseconds(self.received_ns)}


@dataclass(frozen=True, slots=True)
class Alarm:
    id: int
    kind: str
    station: int
    point: int | None
    ca: int | None
    priority: int
    value: float | None
    since_ns: int
    gone_ns: int | None = None
    acknowledged_ns: int | None = None
    acknowledged_by: str | None = None
    shelved_until_ns: int = 0
    area: str | None = None
    returns: int = 0  # how often it came again before somebody acknowledged it
    last_ns: int = 0  # when it came last
    shelved_why: str = ""
    suppressed_by: int | None = None  # the alarm of whose fault this one is a part

    @property
    def active(self) -> bool:
        return self.gone_ns is None

    @property
    def open(self) -> bool:
        """There is something to do or to see yet."""
        return self.gone_ns is None or self.acknowledged_ns is None

    @property
    def key(self) -> AlarmKey:
        return self.kind, self.station, self.ca if self.point is None else self.point, self.area

    def view(self) -> Json:
        return {
            "id": self.id,
            "kind": self.kind,
            "station": self.station,
            "point": self.point,
            "ca": self.ca,
            "priority": self.priority,
            "value": self.value,
            "since": milliseconds(self.since_ns),
            "gone": milliseconds(self.gone_ns),
            "acknowledged": milliseconds(self.acknowledged_ns),
            "by": self.acknowledged_by,
            "shelved": milliseconds(self.shelved_until_ns),
            "area": self.area,
            "returns": self.returns,
            "last": milliseconds(self.last_ns),
            "why": self.shelved_why,
            "suppressed_by": self.suppressed_by,
        }


@dataclass(frozen=True, slots=True)
class AlarmCause:
    """Of an alarm: it is so, or no longer. What must last for a time first waits until `due_ns`."""

    kind: str
    station: int
    place: int  # a point, or a common address; 0: none
    area: str  # empty: none
    point: int | None
    ca: int | None
    priority: int
    value: float | None
    at_ns: int
    comes: int
    due_ns: int = 0

    @property
    def key(self) -> AlarmKey:
        return self.kind, self.station, self.place or None, self.area or None


@dataclass(frozen=True, slots=True)
class Command:
    id: int
    user: str
    point: int
    value: float
    selects: int
    state: int
    result: int
    cause: int
    begun_ns: int
    changed_ns: int
    release: int = 0  # a second person executes it

    @property
    def held(self) -> bool:
        """It waits here for the second person: its point knows no selection, and nothing was sent."""
        return bool(self.release) and not self.selects

    def view(self) -> Json:
        return {
            "id": self.id,
            "user": self.user,
            "point": self.point,
            "value": self.value,
            "selects": bool(self.selects),
            "state": self.state,
            "result": self.result,
            "cause": self.cause,
            "begun": milliseconds(self.begun_ns),
            "changed": milliseconds(self.changed_ns),
            "release": bool(self.release),
        }


@dataclass
class Model:
    """By id. What is here is never changed, only replaced: whoever reads sees whole things."""

    stations: dict[int, Station] = field(default_factory=dict)
    points: dict[int, Point] = field(default_factory=dict)
    alarms: dict[int, Alarm] = field(default_factory=dict)  # open ones
    commands: dict[int, Command] = field(default_factory=dict)  # not ended
    causes: dict[AlarmKey, AlarmCause] = field(default_factory=dict)  # that have not lasted long enough yet

    def take(self, changes: Changes) -> None:
        """What a transaction has stored."""
        self.stations.update(changes.stations)
        self.points.update(changes.points)
        for alarm in changes.alarms.values():
            if alarm.open:
                self.alarms[alarm.id] = alarm
            else:
                self.alarms.pop(alarm.id, None)
        self.commands.update(changes.commands)
        for key, cause in changes.causes.items():
            if cause:
                self.causes[key] = cause
            else:
                self.causes.pop(key, None)


@dataclass
class Changes:
    """What a transaction changes, by id."""

    stations: dict[int, Station] = field(default_factory=dict)
    points: dict[int, Point] = field(default_factory=dict)
    alarms: dict[int, Alarm] = field(default_factory=dict)
    commands: dict[int, Command] = field(default_factory=dict)
    causes: dict[AlarmKey, AlarmCause | None] = field(default_factory=dict)  # None: it waits no longer
    values: list[Point] = field(default_factory=list)  # each that was told of points, in order
    doubts: set[tuple[int, int]] = field(
        default_factory=set
    )  # station and common address: to be interrogated

    @property
    def any(self) -> bool:
        return bool(self.stations or self.points or self.alarms or self.commands)
