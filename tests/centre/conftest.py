# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests of the control centre share."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser

from browser import chromium
from control_room import POINTS, Site, Stations, described
from lab.vehicles import Station
from postgres import Server

# What the page is told is the same of both.
STORES = ("sqlite", pytest.param("postgresql", marks=pytest.mark.slow))


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def stations() -> Iterator[Stations]:
    made = Stations()
    yield made
    made.close()


@pytest.fixture(scope="module")
def north(stations: Stations) -> Iterator[Station]:
    """A station with a place, points and commands."""
    made = stations.station()
    yield made
    stations.do(made.stop())


@pytest.fixture(scope="module")
def south(stations: Stations) -> Iterator[Station]:
    """A second person releases its commands."""
    made = stations.station()
    yield made
    stations.do(made.stop())


@pytest.fixture(scope="session")
def postgresql() -> Iterator[Server]:
    with Server() as server:
        yield server


@pytest.fixture(scope="module", params=STORES)
def server(request: pytest.FixtureRequest) -> Server | None:
    """A server of PostgreSQL, or None: SQLite."""
    return request.getfixturevalue("postgresql") if request.param == "postgresql" else None


@pytest.fixture(scope="module")
def of_north(programs: Path, north: Station, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Site]:
    """Makes a centre of that station alone, which is yet to start; the words are Site's."""

    def make(**keys: Any) -> Site:
        folder = tmp_path_factory.mktemp("site")
        return Site(programs, folder, [described(north, folder)], **keys)

    return make


@pytest.fixture(scope="module")
def site(
    programs: Path,
    north: Station,
    south: Station,
    server: Server | None,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Site]:
    """The centre of these tests, with these stations."""
    folder = tmp_path_factory.mktemp("site")
    areas = [
        {"name": "island", "circle": {"middle": [10, 10], "radius_m": 5000}, "alarm": "inside"},
        {"name": "land", "polygon": [[40, 15], [40, 25], [50, 25], [50, 15]], "alarm": "outside"},
        {
            "name": "elsewhere",
            "circle": {"middle": [10, 10], "radius_m": 1},
            "alarm": "outside",
            "group": "gas",
        },
    ]
    points = "".join(
        line.replace(",pump,", ",south pump,").replace(",lamp,", ",south lamp,") + "\n"
        for line in POINTS.splitlines()
        if not line.startswith(("1,1,", "1,4,", "1,5,"))
    )
    here = [
        described(north, folder, group="water"),
        described(south, folder, "south", points, group="water", release=True),
    ]
    with Site(programs, folder, here, centre={"areas": areas}, server=server) as started:
        yield started
