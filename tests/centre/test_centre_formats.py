# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of the control centre, read by programs of others (gpsbabel, GDAL)."""

import csv
import doctest
import io
import itertools
import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from openrtu_tools.centre import areas, keep
from openrtu_tools.centre.formats import FORMATS, GPX, WAY_MOST, Place, table

WAY = [
    *(Place(1_700_000_000_000 + 1000 * i, 44.8 + i * 1e-4, 20.4, 117.0, 0, 1, 9) for i in range(5)),
    Place(1_700_000_005_000, 0, 0, 0, 128),  # no fix
    *(Place(1_700_000_006_000 + 1000 * i, 44.9 + i * 1e-4, 20.5, 117.0, 0, 1, 9) for i in range(4)),
    *(Place(1_700_000_600_000 + 1000 * i, 45.0 + i * 1e-4, 20.6, 117.0, 0, 1, 9) for i in range(3)),
]
NAME = 'van <7> & "Niš"\x01'
GAP_S = 120


def written(form: str, way: list[Place] = WAY, piece: int = 3) -> str:
    """A mark and a track, which comes in pieces as from the database."""
    writer = FORMATS[form](GAP_S)
    pieces = [writer.begin(), writer.mark(NAME, way[0]), writer.track(NAME, 7)]
    pieces += [writer.places(way[begin : begin + piece]) for begin in range(0, len(way), piece)]
    return "".join([*pieces, writer.end_track(), writer.end()])


@pytest.mark.parametrize("form", FORMATS)
def test_pieces_do_not_matter(form: str) -> None:
    assert {written(form, piece=piece) for piece in (1, 2, 5, 100)} == {written(form)}


def test_gpx_has_what_figure_7_has() -> None:
    """No fix ends a segment, and so does a time in which nothing came."""
    root = ElementTree.fromstring(written("gpx"))
    space = {"g": GPX}
    waypoint = root.find("g:wpt", space)
    assert waypoint is not None
    assert waypoint.attrib == {"lat": "44.8000000", "lon": "20.4000000"}
    assert [child.tag.partition("}")[2] for child in waypoint] == ["ele", "time", "name", "sat"]
    assert [len(way) for way in root.findall("g:trk/g:trkseg", space)] == [5, 4, 3]


def test_table_has_the_number_of_each_segment() -> None:
    rows = list(csv.DictReader(io.StringIO(written("csv"))))
    assert [row["segment"] for row in rows] == ["0", *"11111", *"2222", *"333"]
    assert rows[0]["name"] == NAME
    assert (rows[0]["latitude"], rows[0]["satellites"]) == ("44.8000000", "9")


def test_south_and_west_are_no_formulas() -> None:
    rows = list(csv.DictReader(io.StringIO(written("csv", [Place(0, -33.9, -58.1, -4, 0)]))))
    assert (rows[1]["latitude"], rows[1]["longitude"], rows[1]["altitude"]) == (
        "-33.9000000", "-58.1000000", "-4.0",
    )  # fmt: skip


UNKNOWN_ALTITUDE = [Place(1000 * i, 44.8, 20.4 + i / 1e4, None, 0, 1, 9) for i in range(3)]


@pytest.mark.parametrize("form", FORMATS)
def test_altitude_that_nobody_knows_is_told_by_no_number(form: str) -> None:
    text = written(form, UNKNOWN_ALTITUDE)
    assert "838860" not in text and "<ele>" not in text and "None" not in text
    if form == "geojson":
        assert [len(place) for place in lines(text)[0]["geometry"]["coordinates"]] == [2, 2, 2]
    elif form == "csv":
        assert {row["altitude"] for row in csv.DictReader(io.StringIO(text))} == {""}


def test_last_place_of_one_that_lost_its_fix_is_told_as_that() -> None:
    """When it was there, and when it said that it has no place now."""
    lost = Place(1_700_000_004_000, 44.8, 20.4, 117.0, 128, 0, 0, told_ms=1_700_000_060_000)
    texts = {form: FORMATS[form](GAP_S).mark(NAME, lost) for form in FORMATS}
    point = ElementTree.fromstring(texts["gpx"])
    assert (point.attrib["lat"], point.findtext("fix")) == ("44.8000000", "none")
    for form in ("gpx", "kml", "geojson"):
        assert "no valid position" in texts[form]
        assert "2023-11-14T22:13:24.000Z" in texts[form] and "2023-11-14T22:14:20.000Z" in texts[form]
    assert texts["csv"].rstrip().endswith(",0")
    assert json.loads(texts["geojson"])["properties"]["valid"] is False


def test_name_has_only_characters_that_xml_has() -> None:
    """U+FFFE, a lone surrogate and control characters are none of XML 1.0."""
    writer = FORMATS["gpx"](GAP_S)
    name = "a\ufffeb\uffffc\ud800d\x0be\U0001f690"
    ElementTree.fromstring(writer.mark(name, WAY[0]))
    assert "a\ufffdb\ufffdc\ufffdd\ufffde\U0001f690" in writer.mark(name, WAY[0])


def test_geojson_is_cut_at_the_antimeridian() -> None:
    """RFC 7946, 3.1.9: each part has the edge, at the same latitude and time."""
    way = [
        Place(1000 * i, -17.0 + i / 10, longitude, None, 0)
        for i, longitude in enumerate((179, 179.8, -179.8))
    ]
    east, west = lines(written("geojson", way))
    assert east["geometry"]["coordinates"] == [[179, -17.0], [179.8, -16.9], [180.0, pytest.approx(-16.85)]]
    assert west["geometry"]["coordinates"] == [[-180.0, pytest.approx(-16.85)], [-179.8, -16.8]]
    assert east["properties"]["goes_on"] and "goes_on" not in west["properties"]
    assert east["properties"]["times"][-1] == west["properties"]["times"][0] == "1970-01-01T00:00:01.500Z"
    back = [replace(place, longitude=-place.longitude) for place in way]
    west, east = lines(written("geojson", back))
    assert west["geometry"]["coordinates"][-1][0] == -180 and east["geometry"]["coordinates"][0][0] == 180


@pytest.mark.parametrize("module", [areas, keep])
def test_examples_of(module: object) -> None:
    assert doctest.testmod(module).failed == 0


@pytest.mark.slow
@pytest.mark.parametrize("form", ["gpx", "kml", "geojson"])
def test_gpsbabel_reads_each(tmp_path: Path, form: str) -> None:
    """As many places as there are in the track and its waypoint."""
    file = tmp_path / f"track.{form}"
    file.write_text(written(form))
    command = ["gpsbabel", "-w", "-r", "-t", "-i", form, "-f", file, "-o", "gpx", "-F", "-"]
    done = subprocess.run(command, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    found = ElementTree.fromstring(done.stdout)
    places = [each for each in found.iter() if each.tag.partition("}")[2] in ("wpt", "trkpt", "rtept")]
    assert len(places) == 13
    assert {each.attrib["lat"][:4] for each in places} == {"44.8", "44.9", "45.0"}


@pytest.mark.slow
@pytest.mark.parametrize("form", ["gpx", "kml", "geojson"])
def test_gdal_reads_each(tmp_path: Path, form: str) -> None:
    """By its drivers QGIS does. The segments of the track, and the places in each."""
    file = tmp_path / f"track.{form}"
    file.write_text(written(form))
    done = subprocess.run(["ogrinfo", "-ro", "-al", file], capture_output=True, text=True, check=True)
    ways = re.findall(r"\([^()]*,[^()]*\)", "".join(re.findall("LINESTRING.*", done.stdout)))
    assert [way.count(",") + 1 for way in ways] == [5, 4, 3]
    assert re.search(r"POINT (Z )?\(20\.4 44\.8", done.stdout)
    assert not done.stderr


def lines(text: str) -> list[dict]:
    return [each for each in json.loads(text)["features"] if "times" in each["properties"]]


def test_geojson_is_as_rfc_7946_has_it() -> None:
    features = lines(written("geojson"))
    assert [feature["geometry"]["type"] for feature in features] == ["LineString"] * 3
    assert features[0]["geometry"]["coordinates"][0] == [20.4, 44.8, 117.0]
    assert [len(feature["properties"]["times"]) for feature in features] == [5, 4, 3]
    (alone,) = lines(written("geojson", WAY[:1]))
    assert alone["geometry"] == {"type": "Point", "coordinates": [20.4, 44.8, 117.0]}


def test_long_way_goes_on_in_the_next_line() -> None:
    """No piece is lost between them, and it is no gap."""
    way = [Place(1000 * i, i / 1e6, 0, 0, 0) for i in range(2 * WAY_MOST)]
    features = lines(written("geojson", way))
    assert [feature["properties"].get("goes_on", False) for feature in features] == [True, True, False]
    for a, b in itertools.pairwise(features):
        assert a["geometry"]["coordinates"][-1] == b["geometry"]["coordinates"][0]
    assert sum(len(feature["properties"]["times"]) - 1 for feature in features) + 1 == len(way)


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1+2", "@SUM(A1)", "\tx"])
def test_no_text_of_a_table_is_a_formula(text: str) -> None:
    assert table([[text]]).strip('"').startswith("'")
