# SPDX-License-Identifier: GPL-3.0-or-later
"""The bench of polls: each contender polls a few RTUs; the table and the picture of what they took."""

import xml.etree.ElementTree as ET

import pytest
from polls import (
    ASYNCIO,
    C104,
    CENTRE,
    FLOOR,
    PLAN,
    SHARDS,
    TOGETHER,
    TURN,
    UVLOOP,
    Case,
    Row,
    picture,
    polled_each_second,
    row,
    simulated,
    table,
)
from stopwatch import Spread

SVG = "{http://www.w3.org/2000/svg}"
FEW = Case(3, 2)


@pytest.mark.parametrize(
    ("name", "mode"),
    [
        (PLAN, TURN),
        *((name, mode) for name in (FLOOR, CENTRE, SHARDS, UVLOOP, ASYNCIO) for mode in (TURN, TOGETHER)),
    ],
)
def test_each_polls_all(programs: None, name: str, mode: str) -> None:
    with simulated(FEW.count, "h") as port:
        found = row(FEW, mode, name, port)
    assert len(found.time.values) == FEW.rounds
    assert min(found.time.values) > 0
    assert found.cpu_us > 0


@pytest.mark.parametrize("shards", [1, 2])
def test_all_are_polled_each_second(programs: None, shards: int) -> None:
    assert "10 RTUs at 1 Hz" in polled_each_second(10, 2, shards)


def test_table_and_picture() -> None:
    found = [
        Row(Case(count, 1), TURN, name, Spread("µs", [us]), 3.0)
        for count in (10, 100)
        for name, us in ((FLOOR, 10.0), (CENTRE, 25.0))
    ]
    assert table(found).splitlines()[3].split("|")[-2].strip() == "2.50"
    drawn = ET.fromstring(picture(found))
    assert len(drawn.findall(f"{SVG}polyline")) == 3  # and the paper's


def test_what_has_one_point_is_no_curve() -> None:
    few = [Row(Case(10, 1), TURN, C104, Spread("µs", [10.0]), 3.0)]
    more = [Row(Case(count, 1), TURN, UVLOOP, Spread("µs", [10.0]), 3.0) for count in (10, 100)]
    drawn = ET.fromstring(picture([*few, *more]))
    assert len(drawn.findall(f"{SVG}polyline")) == 2  # of uvloop and the paper
    names = {
        text.text: (float(text.get("x", 0)), float(text.get("y", 0))) for text in drawn.findall(f"{SVG}text")
    }
    *_, ring = drawn.findall(f"{SVG}circle")
    assert ring.get("fill") == "none"  # what lies below it is seen
    assert abs(names[C104][0] - float(ring.get("cx", 0))) < 1
    assert 10 < names[C104][1] - float(ring.get("cy", 0)) < 30
