# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracks and values as files: GPX 1.1, KML 2.2, GeoJSON (RFC 7946), CSV (RFC 4180)."""

from __future__ import annotations

import csv
import datetime
import io
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

from centre.records import INVALID

GPX = "http://www.topografix.com/GPX/1/1"
KML = "http://www.opengis.net/kml/2.2"
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


@dataclass(frozen=True)
class Track:
    name: str
    segments: list[list[Place]]


def segments(places: Iterable[Place], gap_s: float) -> list[list[Place]]:
    """Cut where nobody knows the way: at a place that is not valid, and where too long nothing came.

    >>> ways = segments([Place(0, 1, 1, 0), Place(1000, 1, 2, 0), Place(9000, 1, 3, 0)], 5)
    >>> [len(way) for way in ways]
    [2, 1]
    """
    found: list[list[Place]] = []
    last_ms = None
    for place in places:
        if place.quality & INVALID:
            last_ms = None
            continue
        if last_ms is None or place.at_ms - last_ms > gap_s * 1000:
            found.append([])
        found[-1].append(place)
        last_ms = place.at_ms
    return found


def moment(at_ms: int) -> str:
    """ISO 8601, UTC."""
    when = datetime.datetime.fromtimestamp(at_ms / 1000, datetime.UTC)
    return f"{when:%Y-%m-%dT%H:%M:%S}.{at_ms % 1000:03d}Z"


def _text(text: str) -> str:
    """What XML cannot hold becomes visible."""
    return "".join(each if each >= " " or each in "\t\n" else "\ufffd" for each in text)


def _gpx_place(parent: ElementTree.Element, tag: str, place: Place, name: str = "") -> None:
    attributes = {"lat": f"{place.latitude:.7f}", "lon": f"{place.longitude:.7f}"}
    element = ElementTree.SubElement(parent, tag, attributes)
    ElementTree.SubElement(element, "ele").text = f"{place.altitude:.1f}"
    ElementTree.SubElement(element, "time").text = moment(place.at_ms)
    if name:
        ElementTree.SubElement(element, "name").text = _text(name)
    if place.satellites:
        ElementTree.SubElement(element, "sat").text = str(place.satellites)


def gpx(waypoints: Iterable[tuple[str, Place]], tracks: Iterable[Track]) -> bytes:
    """A waypoint for each RTU, as in figure 7 of the positioning paper; tracks, a gap is a new segment."""
    root = ElementTree.Element("gpx", {"version": "1.1", "creator": "OpenRTU", "xmlns": GPX})
    for name, place in waypoints:
        _gpx_place(root, "wpt", place, name)
    for track in tracks:
        element = ElementTree.SubElement(root, "trk")
        ElementTree.SubElement(element, "name").text = _text(track.name)
        for way in track.segments:
            segment = ElementTree.SubElement(element, "trkseg")
            for place in way:
                _gpx_place(segment, "trkpt", place)
    return ElementTree.tostring(root, "utf-8", xml_declaration=True)


def _coordinates(place: Place) -> str:
    return f"{place.longitude:.7f},{place.latitude:.7f},{place.altitude:.1f}"


def kml(waypoints: Iterable[tuple[str, Place]], tracks: Iterable[Track]) -> bytes:
    root = ElementTree.Element("kml", {"xmlns": KML})
    document = ElementTree.SubElement(root, "Document")
    for name, place in waypoints:
        mark = ElementTree.SubElement(document, "Placemark")
        ElementTree.SubElement(mark, "name").text = _text(name)
        stamp = ElementTree.SubElement(mark, "TimeStamp")
        ElementTree.SubElement(stamp, "when").text = moment(place.at_ms)
        point = ElementTree.SubElement(mark, "Point")
        ElementTree.SubElement(point, "coordinates").text = _coordinates(place)
    for track in tracks:
        for number, way in enumerate(track.segments, 1):
            mark = ElementTree.SubElement(document, "Placemark")
            ElementTree.SubElement(mark, "name").text = _text(f"{track.name} {number}")
            line = ElementTree.SubElement(mark, "LineString")
            ElementTree.SubElement(line, "coordinates").text = " ".join(map(_coordinates, way))
    return ElementTree.tostring(root, "utf-8", xml_declaration=True)


def _position(place: Place) -> list[float]:
    return [place.longitude, place.latitude, place.altitude]


def geojson(waypoints: Iterable[tuple[str, Place]], tracks: Iterable[Track]) -> bytes:
    features: list[dict[str, Any]] = [
        {
            "type": "Feature",
            "properties": {"name": name, "time": moment(place.at_ms)},
            "geometry": {"type": "Point", "coordinates": _position(place)},
        }
        for name, place in waypoints
    ]
    for track in tracks:
        for way in track.segments:
            times = [moment(place.at_ms) for place in way]
            alone = len(way) == 1
            line = [_position(place) for place in way]
            geometry = {"type": "Point" if alone else "LineString", "coordinates": line[0] if alone else line}
            properties = {"name": track.name, "times": times}
            features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    return json.dumps({"type": "FeatureCollection", "features": features}).encode()


def _cell(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULAS) else value


def table(columns: list[str], rows: Iterable[Iterable[Any]]) -> bytes:
    """CSV. No text of a station is a formula for a spreadsheet."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(columns)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue().encode()


def places_table(waypoints: Iterable[tuple[str, Place]], tracks: Iterable[Track]) -> bytes:
    rows = [(name, 0, place) for name, place in waypoints]
    for track in tracks:
        rows += [(track.name, number, place) for number, way in enumerate(track.segments, 1) for place in way]
    return table(
        ["name", "segment", "time", "latitude", "longitude", "altitude", "fix", "satellites"],
        (
            (name, number, moment(each.at_ms), f"{each.latitude:.7f}", f"{each.longitude:.7f}",
             f"{each.altitude:.1f}", each.fix, each.satellites)
            for name, number, each in rows
        ),
    )  # fmt: skip


Writer = Callable[[Iterable[tuple[str, Place]], Iterable[Track]], bytes]
FORMATS: dict[str, tuple[str, Writer]] = {
    "gpx": ("application/gpx+xml", gpx),
    "kml": ("application/vnd.google-earth.kml+xml", kml),
    "geojson": ("application/geo+json", geojson),
    "csv": ("text/csv", places_table),
}
