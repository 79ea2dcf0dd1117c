# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracks and values as files: GPX 1.1, KML 2.2, GeoJSON (RFC 7946), CSV (RFC 4180).

A file is written in pieces, as what it is of comes from the database: a long one is never whole in memory.
"""

from __future__ import annotations

import csv
import datetime
import html
import io
import json
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from openrtu_tools.centre.codes import INVALID
from openrtu_tools.centre.model import NS_PER_MS, Point, metres

GPX = "http://www.topografix.com/GPX/1/1"
KML = "http://www.opengis.net/kml/2.2"
HALF_ROUND = 180.0  # degrees of longitude
WAY_MOST = 5000  # places in a line of GeoJSON, whose times stand behind them
# What XML 1.0 has no character for (section 2.2).
UNSPEAKABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
FORMULAS = ("=", "+", "-", "@", "\t", "\r")  # a spreadsheet would compute a text that begins so


@dataclass(frozen=True)
class Place:
    """Where one was at a time. One that is not valid is the last that was; it was told at `told_ms`."""

    at_ms: int
    latitude: float
    longitude: float
    altitude: float | None  # None: nobody knows it
    quality: int
    fix: int = 0
    satellites: int = 0
    told_ms: int = 0

    @property
    def is_valid(self) -> bool:
        return not self.quality & INVALID

    @property
    def remark(self) -> str:
        """Of one that is not valid."""
        return f"no valid position: the last one known, {moment(self.at_ms)}; told {moment(self.told_ms)}"


def last_place(point: Point) -> Place | None:
    """Of a vehicle, valid or not; None: it has never said where it is."""
    if point.place is None:
        return None
    return Place(
        point.placed_ns // NS_PER_MS, *point.place, metres(point.altitude), point.quality,
        point.detail & 15, point.detail >> 4, point.at_ns // NS_PER_MS,
    )  # fmt: skip


def moment(at_ms: int) -> str:
    """ISO 8601, UTC."""
    when = datetime.datetime.fromtimestamp(at_ms / 1000, datetime.UTC)
    return f"{when:%Y-%m-%dT%H:%M:%S}.{at_ms % 1000:03d}Z"


def _text(text: str) -> str:
    """Of an element. What XML cannot hold becomes visible."""
    return html.escape(UNSPEAKABLE.sub("\ufffd", text), quote=False)


class Writer:
    """Of one file: what begins and ends it, its marks, and tracks, a piece of places after the other.

    A track is cut where nobody knows the way: at a place that is not valid, and where too long nothing came.
    What a format says of each part is in the methods with an underscore.
    """

    kind = ""  # its media type

    def __init__(self, gap_s: float) -> None:
        self.gap_ms = gap_s * 1000
        self.name = ""
        self.point = 0
        self.way = 0  # of the track
        self.last_ms: int | None = None  # of the way that is open

    def begin(self) -> str:
        return ""

    def mark(self, name: str, place: Place) -> str:
        raise NotImplementedError

    def track(self, name: str, point: int) -> str:
        self.name, self.point, self.way, self.last_ms = name, point, 0, None
        return self._begin_track()

    def places(self, places: Iterable[Place]) -> str:
        return "".join(piece for place in places for piece in self._cut(place))

    def _cut(self, place: Place) -> Iterator[str]:
        lost = not place.is_valid
        if self.last_ms is not None and (lost or place.at_ms - self.last_ms > self.gap_ms):
            self.last_ms = None
            yield self._end_way()
        if lost:
            return
        if self.last_ms is None:
            self.way += 1
            yield self._begin_way()
        yield self._place(place)
        self.last_ms = place.at_ms

    def end_track(self) -> str:
        return ("" if self.last_ms is None else self._end_way()) + self._end_track()

    def end(self) -> str:
        return ""

    def _begin_track(self) -> str:
        return ""

    def _begin_way(self) -> str:
        return ""

    def _place(self, place: Place) -> str:
        raise NotImplementedError

    def _end_way(self) -> str:
        return ""

    def _end_track(self) -> str:
        return ""


class Gpx(Writer):
    """A waypoint for each RTU, as in figure 7 of the positioning paper; tracks, a gap is a new segment."""

    kind = "application/gpx+xml"

    def begin(self) -> str:
        return f'<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" creator="OpenRTU" xmlns="{GPX}">'

    def end(self) -> str:
        return "</gpx>"

    def mark(self, name: str, place: Place) -> str:
        return self._element("wpt", place, f"<name>{_text(name)}</name>")

    @staticmethod
    def _element(tag: str, place: Place, name: str = "") -> str:
        height = "" if place.altitude is None else f"<ele>{place.altitude:.1f}</ele>"
        if place.is_valid:
            more = f"<sat>{place.satellites}</sat>" if place.satellites else ""
        else:
            more = f"<desc>{place.remark}</desc><fix>none</fix>"
        return (
            f'<{tag} lat="{place.latitude:.7f}" lon="{place.longitude:.7f}">{height}'
            f"<time>{moment(place.at_ms)}</time>{name}{more}</{tag}>"
        )

    def _begin_track(self) -> str:
        return f"<trk><name>{_text(self.name)}</name>"

    def _end_track(self) -> str:
        return "</trk>"

    def _begin_way(self) -> str:
        return "<trkseg>"

    def _end_way(self) -> str:
        return "</trkseg>"

    def _place(self, place: Place) -> str:
        return self._element("trkpt", place)


class Kml(Writer):
    kind = "application/vnd.google-earth.kml+xml"

    def begin(self) -> str:
        return f'<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="{KML}"><Document>'

    def end(self) -> str:
        return "</Document></kml>"

    def mark(self, name: str, place: Place) -> str:
        remark = "" if place.is_valid else f"<description>{place.remark}</description>"
        return (
            f"<Placemark><name>{_text(name)}</name>{remark}"
            f"<TimeStamp><when>{moment(place.at_ms)}</when></TimeStamp>"
            f"<Point><coordinates>{self._place(place)}</coordinates></Point></Placemark>"
        )

    def _begin_way(self) -> str:
        name = _text(f"{self.name} {self.way}")
        return f"<Placemark><name>{name}</name><LineString><coordinates>"

    def _end_way(self) -> str:
        return "</coordinates></LineString></Placemark>"

    def _place(self, place: Place) -> str:
        height = "" if place.altitude is None else f",{place.altitude:.1f}"
        return f"{place.longitude:.7f},{place.latitude:.7f}{height} "


@dataclass
class _Line:
    """A way of GeoJSON: its times follow its places."""

    first: str = ""
    times: list[str] = field(default_factory=list)


class GeoJson(Writer):
    """A long way is several lines; each of them but the last goes on in the next, which says so."""

    kind = "application/geo+json"

    def __init__(self, gap_s: float) -> None:
        super().__init__(gap_s)
        self.some = False  # features
        self.line = _Line()
        self.before: Place | None = None  # on the way

    def begin(self) -> str:
        return '{"type": "FeatureCollection", "features": ['

    def end(self) -> str:
        return "]}"

    @staticmethod
    def _position(place: Place) -> str:
        height = [] if place.altitude is None else [place.altitude]
        return json.dumps([place.longitude, place.latitude, *height])

    def _feature(self) -> str:
        before, self.some = ",\n" if self.some else "", True
        return before + '{"type": "Feature", "geometry": '

    def mark(self, name: str, place: Place) -> str:
        properties = {"name": name, "time": moment(place.at_ms), "valid": place.is_valid}
        if not place.is_valid:
            properties["remark"] = place.remark
        return (
            f'{self._feature()}{{"type": "Point", "coordinates": {self._position(place)}}},'
            f' "properties": {json.dumps(properties)}}}'
        )

    def _begin_way(self) -> str:
        self.line, self.before = _Line(), None
        return ""

    def _place(self, place: Place) -> str:
        text = ""
        if self.before and abs(place.longitude - self.before.longitude) > HALF_ROUND:
            text = self._across(self.before, place)
        self.before = place
        return text + self._add(place)

    def _across(self, a: Place, b: Place) -> str:
        """A line is cut at the antimeridian (RFC 7946, 3.1.9)."""
        edge = math.copysign(HALF_ROUND, a.longitude)
        part = (edge - a.longitude) / (b.longitude + 2 * edge - a.longitude)
        there = replace(
            b,
            at_ms=round(a.at_ms + part * (b.at_ms - a.at_ms)),
            latitude=a.latitude + part * (b.latitude - a.latitude),
            longitude=edge,
        )
        text = self._add(there) + self._end_line(True)
        self.line = _Line()
        return text + self._add(replace(there, longitude=-edge))

    def _add(self, place: Place) -> str:
        """The first one waits: alone it would be no line."""
        position, line, text = self._position(place), self.line, ""
        if not line.times:
            line.first = position
        elif len(line.times) == 1:
            text = f'{self._feature()}{{"type": "LineString", "coordinates": [{line.first}, {position}'
        else:
            text = f", {position}"
        line.times.append(moment(place.at_ms))
        if len(line.times) == WAY_MOST:
            text += self._end_line(True)
            self.line = _Line(position, line.times[-1:])
        return text

    def _end_line(self, goes_on: bool) -> str:
        properties: dict[str, Any] = {"name": self.name, "point": self.point, "times": self.line.times}
        if goes_on:
            properties["goes_on"] = True
        return f']}}, "properties": {json.dumps(properties)}}}'

    def _end_way(self) -> str:
        if len(self.line.times) > 1:
            return self._end_line(False)
        properties = {"name": self.name, "point": self.point, "times": self.line.times}
        return (
            f'{self._feature()}{{"type": "Point", "coordinates": {self.line.first}}},'
            f' "properties": {json.dumps(properties)}}}'
        )


def _cell(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULAS) else value


def table(rows: Iterable[Iterable[Any]]) -> str:
    """CSV. No text of a station is a formula for a spreadsheet."""
    text = io.StringIO(newline="")
    csv.writer(text).writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue()


class Csv(Writer):
    kind = "text/csv"

    def begin(self) -> str:
        return table(
            [["name", "segment", "time", "latitude", "longitude", "altitude", "fix", "satellites", "valid"]]
        )

    @staticmethod
    def _row(name: str, way: int, place: Place) -> str:
        height = "" if place.altitude is None else f"{place.altitude:.1f}"
        # A number may begin with a sign; it is no text.
        return table([[name, way, moment(place.at_ms)]])[:-2] + (
            f",{place.latitude:.7f},{place.longitude:.7f},{height}"
            f",{place.fix},{place.satellites},{int(place.is_valid)}\r\n"
        )

    def mark(self, name: str, place: Place) -> str:
        return self._row(name, 0, place)

    def _place(self, place: Place) -> str:
        return self._row(self.name, self.way, place)


FORMATS: dict[str, type[Writer]] = {"gpx": Gpx, "kml": Kml, "geojson": GeoJson, "csv": Csv}
