# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests of the control centre share."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from control_room import Site, Stations
from lab.vehicles import Station

POINTS = """ca,ioa,type,command_type,name,unit,select,min,max,high,state
1,1,,,place,,,,,,
1,2,M_SP_NA_1,C_SC_NA_1,pump,,true,,,,
1,3,M_SP_NA_1,C_SC_NA_1,lamp,,,0,1,,
1,4,M_ME_NC_1,,level,m,,,,4.5,
1,5,M_SP_NA_1,,fire,,,,,,1
"""


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


def described(station: Station, folder: Path, name: str = "north", **keys: Any) -> dict[str, Any]:
    """It in the centre's file, with a list of points."""
    (folder / "points.csv").write_text(POINTS)
    address = {"address": "127.0.0.1", "port": station.port, "common_addresses": [station.ca]}
    return {"name": name, **address, "points": "points.csv", **keys}


Start = Callable[..., Site]


@pytest.fixture(scope="module")
def site(programs: Path, north: Station, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """The centre of these tests, with that station."""
    folder = tmp_path_factory.mktemp("site")
    with Site(programs, folder, [described(north, folder)]) as started:
        yield started
