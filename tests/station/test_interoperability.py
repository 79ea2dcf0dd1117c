# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/interoperability.md says what the station does: its lists against source, schema and wire."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from lab.show import STATION
from rig.bare import Bare
from rig.desk import Substation, chapter_5, substation_of

ROOT = Path(__file__).resolve().parents[2]
STATEMENT = (ROOT / "docs/interoperability.md").read_text()
SOURCE = (ROOT / "package/openrtu/src/iec104/asdu.h").read_text()
SCHEMA = ROOT / "package/openrtu/src/rtud/config.schema.json"

STATED = {
    int(number): (name, mark == "X")
    for mark, number, name in re.findall(r"^\| (\S) \| (\d+) \| (\w+) \|$", STATEMENT, re.MULTILINE)
}
SUPPORTED = {number: name for number, (name, supported) in STATED.items() if supported}
CONTROL = [number for number, (name, _) in STATED.items() if name[0] in "CPF"]
ACTIVATION, UNKNOWN_TYPE, NEGATIVE = 6, 44, 0x40


def test_types_are_those_of_the_source() -> None:
    source = re.findall(r"IEC104_([MCP]_\w+) = (\d+),", SOURCE)
    assert {int(number): name for name, number in source} == SUPPORTED


def test_defaults_are_those_of_the_schema() -> None:
    schema = json.loads(SCHEMA.read_text())["$defs"]["iec104"]["properties"]
    stated = re.findall(r"^\| .+ \| (\d+)(?: s)? \| .+ \| `(\w+)` \|$", STATEMENT, re.MULTILINE)
    defaults = {key: int(value) for value, key in stated if key in schema}
    assert defaults.keys() == {"t1", "t2", "t3", "k", "w", "port", "max_connections"}
    assert defaults == {key: schema[key]["default"] for key in defaults}


@pytest.fixture(scope="module")
def substation(programs: Path) -> Iterator[Substation]:
    with substation_of(chapter_5(), programs) as substation:
        yield substation


@pytest.mark.parametrize("kind", CONTROL, ids=lambda kind: STATED[kind][0])
def test_station_knows_the_types_that_are_stated(substation: Substation, kind: int) -> None:
    """A type it knows is refused for another reason, here what follows its object."""
    request = bytes([kind, 1, ACTIVATION, 0, *STATION.to_bytes(2, "little"), 1, 0, 0, *bytes(20)])
    with Bare(substation.gateway.address) as master:
        master.start()
        master.ask(request)
        refused = master.asdus_until(bytes([kind]))[-1]
        assert (refused[2] & 0x3F == UNKNOWN_TYPE) is (kind not in SUPPORTED)
        assert refused[2] & NEGATIVE
