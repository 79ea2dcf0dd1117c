# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracks and values as files: GPX 1.1, KML 2.2, GeoJSON (RFC 7946), CSV (RFC 4180).

A file is written in pieces, as what it is of comes from the database: a long one is never whole in memory.
"""

from __future__ import annotations

import csv
import datetime
import io
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any
from xml.sax.saxutils import escape

from openrtu_tools.centre.records import INVALID

GPX = "http://www.topografix.com/GPX/1/1"
KML = "http://www.opengis.net/kml/2.2"
WAY_MOST = 5000  # places in a line of GeoJSON, whose times stand behind them
FORMULAS = ("=", "+", "-", "@", "\t", "\r")  # a spreadsheet would compute a text that begins so


@dataclass(frozen=True)
class Place:
    at_ms: int
    latitude: float
    longitude: float
    altitude: float
    quality: int = 0
    fix: int = 0
    satellites: int = 0


def moment(at_ms: int) -> str:
    """ISO 8601, UTC."""
    when = datetime.datetime.fromtimestamp(at_ms / 1000, datetime.UTC)
    return f"{when:%Y-%m-%dT%H:%M:%S}.{at_ms % 1000:03d}Z"


def _text(text: str) -> str:
    """Of an element. What XML cannot hold becomes visible."""
    return escape("".join(each if each >= " " or each in "\t\n" else "\ufffd" for each in text))


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
        lost = bool(place.quality & INVALID)
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
        satellites = f"<sat>{place.satellites}</sat>" if place.satellites else ""
        return (
            f'<{tag} lat="{place.latitude:.7f}" lon="{place.longitude:.7f}"><ele>{place.altitude:.1f}</ele>'
            f"<time>{moment(place.at_ms)}</time>{name}{satellites}</{tag}>"
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
        return (
            f"<Placemark><name>{_text(name)}</name><TimeStamp><when>{moment(place.at_ms)}</when></TimeStamp>"
            f"<Point><coordinates>{self._place(place)}</coordinates></Point></Placemark>"
        )

    def _begin_way(self) -> str:
        name = _text(f"{self.name} {self.way}")
        return f"<Placemark><name>{name}</name><LineString><coordinates>"

    def _end_way(self) -> str:
        return "</coordinates></LineString></Placemark>"

    def _place(self, place: Place) -> str:
        return f"{place.longitude:.7f},{place.latitude:.7f},{place.altitude:.1f} "


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

    def begin(self) -> str:
        return '{"type": "FeatureCollection", "features": ['

    def end(self) -> str:
        return "]}"

    @staticmethod
    def _position(place: Place) -> str:
        return json.dumps([place.longitude, place.latitude, place.altitude])

    def _feature(self) -> str:
        before, self.some = ",\n" if self.some else "", True
        return before + '{"type": "Feature", "geometry": '

    def mark(self, name: str, place: Place) -> str:
        properties = {"name": name, "time": moment(place.at_ms)}
        return (
            f'{self._feature()}{{"type": "Point", "coordinates": {self._position(place)}}},'
            f' "properties": {json.dumps(properties)}}}'
        )

    def _begin_way(self) -> str:
        self.line = _Line()
        return ""

    def _place(self, place: Place) -> str:
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
        return table([["name", "segment", "time", "latitude", "longitude", "altitude", "fix", "satellites"]])

    @staticmethod
    def _row(name: str, way: int, place: Place) -> str:
        degrees = f"{place.latitude:.7f}", f"{place.longitude:.7f}", f"{place.altitude:.1f}"
        # A number may begin with a sign; it is no text.
        return table([[name, way, moment(place.at_ms)]])[:-2] + (
            f",{','.join(degrees)},{place.fix},{place.satellites}\r\n"
        )

    def mark(self, name: str, place: Place) -> str:
        return self._row(name, 0, place)

    def _place(self, place: Place) -> str:
        return self._row(self.name, self.way, place)


FORMATS: dict[str, type[Writer]] = {"gpx": Gpx, "kml": Kml, "geojson": GeoJson, "csv": Csv}
