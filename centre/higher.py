# SPDX-License-Identifier: GPL-3.0-or-later
"""What a higher centre sees of this one: a gateway's configuration, with our stations' points."""

from __future__ import annotations

import re
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from openrtu_tools.centre.codes import Content
from openrtu_tools.centre.errors import CentreError
from openrtu_tools.centre.model import Json
from openrtu_tools.centre.settings import Meaning, Settings, StationSettings
from openrtu_tools.missing import in_clone

HERE = Path(__file__).resolve().parent
PROGRAM = HERE / "run-station" if in_clone() else Path(sys.executable).parent / "openrtu-centre-station"
MODULE = "centre"  # and of another common address than that of all, centre-CA
PERIOD_MS = 100
MEMORY_MB = 512  # of addresses; a Python with its libraries maps what it never touches
HEARTBEAT_MS = 5000
COMMAND_S = 10  # the oldest command that is carried out: of the gateway, and of centre.station
RELEASE_S = 30  # so long the second person has: a module may take 40 s for what it has confirmed
POINTS_MOST, MODULES_MOST = 1024, 12  # of a module, of a gateway
NAME_MOST = 39  # octets
# Of an object, the point's type; a total is a number that was counted elsewhere.
TYPES = {
    Content.SINGLE: "single", Content.DOUBLE: "double", Content.STEP: "step", Content.BITS: "bitstring",
    Content.NORMALIZED: "normalized",
    Content.SCALED: "scaled", Content.FLOAT: "float", Content.TOTAL: "integer",
}  # fmt: skip
# A position is three points: the part of the point's view, and its type. Their addresses are so far apart.
PART_ADDRESSES = 1_000_000
PARTS = {"latitude": "angle", "longitude": "angle", "altitude": "float"}
# By what a station takes, the type of the point that takes it here.
COMMANDS = {
    "single": "single", "double": "double", "step": "step", "bits": "bitstring",
    "normalized": "normalized", "scaled": "scaled", "float": "float",
}  # fmt: skip


def gateway(settings: Settings) -> tuple[Json, list[str]]:
    """The configuration for rtud, and what of the lists cannot be told. Raises CentreError."""
    higher = settings.higher
    if not higher:
        raise CentreError('centre: "higher" is missing: it says by which common address we are seen')
    points: defaultdict[int, list[Json]] = defaultdict(list)  # by common address
    places: dict[str, list[str | int]] = {}
    left_out = []
    for station in settings.stations.values():
        for (ca, ioa), meaning in sorted(station.points.items()):
            if ca not in station.higher:
                continue
            made = list(_points(station, ca, ioa, meaning))
            if not made:
                left_out.append(f"{station.name}: {meaning.name}: its list says no type")
            for point, place in made:
                points[station.higher_ca or higher.ca].append(point)
                places[point["name"]] = place
    _check(points)
    modules = [
        {
            "name": MODULE if ca == higher.ca else f"{MODULE}-{ca}",
            "program": str(PROGRAM),
            "period_ms": PERIOD_MS,
            "heartbeat_limit_ms": HEARTBEAT_MS,
            "memory_mb": MEMORY_MB,
            "ca": ca,
            "points": of_ca,
            "config": {**higher.reached, "points": {point["name"]: places[point["name"]] for point in of_ca}},
        }
        for ca, of_ca in points.items()
    ]
    commands = {**higher.gateway.get("commands", {}), "command_timeout": COMMAND_S}
    return {
        "clock": "system",
        "port": [],
        **higher.gateway,
        "commands": commands,
        "modules": modules,
    }, left_out


def _points(
    station: StationSettings, ca: int, ioa: int, meaning: Meaning
) -> Iterator[tuple[Json, list[str | int]]]:
    """Of an object that has a type, or takes a command that says one: the points, where their values are."""
    name = re.sub(r"[\s*?\[\]\\]", "-", f"{station.name}/{meaning.name}")
    address = ioa + station.higher[ca]
    place: list[str | int] = [station.name, ca, ioa]
    if meaning.content == Content.POSITION:
        for at, (part, type_) in enumerate(PARTS.items()):
            yield (
                {"name": f"{name}.{part}", "type": type_, "ioa": address + at * PART_ADDRESSES},
                [*place, part],
            )
        return
    type_ = TYPES.get(meaning.content) if meaning.content is not None else COMMANDS.get(meaning.command)
    if not type_:
        return
    point: Json = {"name": name, "type": type_, "ioa": address}
    if meaning.unit:
        point["unit"] = meaning.unit
    if COMMANDS.get(meaning.command) == type_:
        point |= {"command": True, "select": meaning.selects}
    yield point, [*place, "value"]


def _check(points: dict[int, list[Json]]) -> None:
    if not points:
        raise CentreError('no station has "higher" with a common address of its list of points')
    if len(points) > MODULES_MOST:
        raise CentreError(f"higher: {len(points)} common addresses: a gateway has {MODULES_MOST} modules")
    for ca, of_ca in points.items():
        if len(of_ca) > POINTS_MOST:
            raise CentreError(
                f"higher: {len(of_ca)} points have the common address {ca}, which takes {POINTS_MOST}: "
                'give some stations a "higher_ca" of their own'
            )
        _check_unlike(of_ca, "ioa", "have the address")
    whole = [point for of_ca in points.values() for point in of_ca]
    _check_unlike(whole, "name", "are called")
    for point in whole:
        if len(point["name"].encode()) > NAME_MOST:
            raise CentreError(
                f"higher: {point['name']} is longer than {NAME_MOST} octets: shorten the station's name,"
                " or the point's"
            )


def _check_unlike(points: list[Json], key: str, what: str) -> None:
    seen: dict[str | int, str] = {}
    for point in points:
        other = seen.setdefault(point[key], point["name"])
        if other is not point["name"]:
            raise CentreError(
                f"higher: {other} and {point['name']} {what} {point[key]}: give one station another number"
            )
