# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of the control centre, read by a program of others (gpsbabel)."""

import doctest
import json
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

from centre import formats
from centre.formats import FORMATS, GPX, Place, Track, geojson, gpx, segments, table

WAY = [
    *(Place(1_700_000_000_000 + 1000 * i, 44.8 + i * 1e-4, 20.4, 117.0, 0, 1, 9) for i in range(5)),
    Place(1_700_000_005_000, 0, 0, 0, 128),  # no fix
    *(Place(1_700_000_006_000 + 1000 * i, 44.9 + i * 1e-4, 20.5, 117.0, 0, 1, 9) for i in range(4)),
    *(Place(1_700_000_600_000 + 1000 * i, 45.0 + i * 1e-4, 20.6, 117.0, 0, 1, 9) for i in range(3)),
]
NAME = 'van <7> & "Niš"\x01'
TRACK = Track(NAME, segments(WAY, 120))


def test_a_gap_is_no_way() -> None:
    """No fix ends a segment, and so does a time in which nothing came."""
    assert [len(way) for way in TRACK.segments] == [5, 4, 3]
    assert doctest.testmod(formats).failed == 0


def test_gpx_has_what_figure_7_has() -> None:
    root = ElementTree.fromstring(gpx([(NAME, WAY[0])], [TRACK]))
    space = {"g": GPX}
    waypoint = root.find("g:wpt", space)
    assert waypoint is not None
    assert waypoint.attrib == {"lat": "44.8000000", "lon": "20.4000000"}
    assert [child.tag.partition("}")[2] for child in waypoint] == ["ele", "time", "name", "sat"]
    assert len(root.findall("g:trk/g:trkseg", space)) == 3


@pytest.mark.slow
@pytest.mark.parametrize("form", ["gpx", "kml", "geojson"])
def test_gpsbabel_reads_each(tmp_path: Path, form: str) -> None:
    """As many places as there are in the track and its waypoint."""
    file = tmp_path / f"track.{form}"
    file.write_bytes(FORMATS[form][1]([(NAME, WAY[0])], [TRACK]))
    command = ["gpsbabel", "-w", "-r", "-t", "-i", form, "-f", file, "-o", "gpx", "-F", "-"]
    done = subprocess.run(command, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    found = ElementTree.fromstring(done.stdout)
    places = [each for each in found.iter() if each.tag.partition("}")[2] in ("wpt", "trkpt", "rtept")]
    assert len(places) == 13
    assert {each.attrib["lat"][:4] for each in places} == {"44.8", "44.9", "45.0"}


def test_geojson_is_as_rfc_7946_has_it() -> None:
    features = json.loads(geojson([], [TRACK]))["features"]
    assert [feature["geometry"]["type"] for feature in features] == ["LineString"] * 3
    assert features[0]["geometry"]["coordinates"][0] == [20.4, 44.8, 117.0]
    assert len(features[0]["properties"]["times"]) == 5


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1+2", "@SUM(A1)", "\tx"])
def test_no_text_of_a_table_is_a_formula(text: str) -> None:
    assert table(["name"], [[text]]).decode().splitlines()[1].strip('"').startswith("'")
