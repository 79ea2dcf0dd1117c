# SPDX-License-Identifier: GPL-3.0-or-later
"""5 000 points of all types with random values and qualities, as both foreign clients see them."""

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from test_iec61850 import browsed, expected

from iec61850 import FC, IedConnection
from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.modules import place, program
from rig.qualities import (
    BLOCKED,
    CA,
    CHANCE,
    INVALID,
    NOT_TOPICAL,
    OVERFLOW,
    SUBSTITUTED,
    TYPES,
    quality_of_iec61850,
)

pytestmark = pytest.mark.slow

COUNT, DEVICES = 5000, 5
VALUES = 3000  # of a device, at random: most points have had one
PATIENCE_S = 60.0
ANALOGUE, INTEGER = ("AnIn", FC.MX, "mag.f"), ("IntIn", FC.ST, "stVal")
SHOWN = {  # by the type of the point: name before the IOA, functional constraint, value
    "single": ("Ind", FC.ST, "stVal"),
    "double": ("DPCSO", FC.ST, "stVal"),
    **dict.fromkeys(("step", "bitstring", "integer"), INTEGER),
    **dict.fromkeys(("normalized", "scaled", "float", "angle"), ANALOGUE),
}
SETTABLE = ("AnOut", FC.MX, "mxVal.f")
QUALITIES = {
    "good": 0,
    "invalid": INVALID,
    "not topical": NOT_TOPICAL,
    "substituted": SUBSTITUTED,
    "blocked": BLOCKED,
    "overflow": OVERFLOW,
}


@dataclass(frozen=True)
class Point:
    """What rtuctl has of it."""

    row: dict[str, Any]

    @property
    def place(self) -> tuple[str, str, FC, str]:
        """Its logical device, its name in GGIO1, functional constraint, and value."""
        settable = self.row["name"].endswith(".wanted")
        letters, fc, attribute = SETTABLE if settable else SHOWN[self.row["type"]]
        return f"OpenRTUCA{self.row['ca']}", f"{letters}{self.row['ioa']}", fc, attribute

    @property
    def value(self) -> Any:
        return expected(self.row)

    @property
    def quality(self) -> int:
        return quality_of_iec61850(sum(QUALITIES[word] for word in self.row["quality"].split(",")))


@dataclass(frozen=True)
class Site:
    port: int
    points: list[Point]


def module(folder: Path, number: int) -> dict[str, Any]:
    """A device with its share of the points; the first is told how many values to write."""
    name = f"chance{number}"
    file = folder / f"{name}.txt"
    file.touch()
    file.chmod(0o666)
    wanted = {"name": f"{name}.wanted", "type": "scaled", "ioa": 1, "command": True}
    points = [
        {"name": f"{name}.{i}", "type": TYPES[i % len(TYPES)], "ioa": 1 + i}
        for i in range(1, COUNT // DEVICES)
    ]
    return {
        "name": name,
        "program": program(folder, name, CHANCE),
        "period_ms": 100,
        "heartbeat_limit_ms": 5000,
        "ca": CA + number,
        "points": [wanted, *points],
        "config": {"file": str(file), "seed": number},
    }


def configuration(folder: Path, port: int) -> dict[str, Any]:
    modules = [module(folder, number) for number in range(DEVICES)]
    server = {"address": "127.0.0.1", "port": port, "max_pdu": 65000}
    return {"port": [], "modules": modules, "iec61850": server}


@pytest.fixture(scope="module")
def site(programs: Path) -> Iterator[Site]:
    folder = run_directory()
    port = free_port()
    try:
        place(folder, programs)
        config = listening_on(configuration(folder, port), free_port())
        with Gateway(config, folder, programs) as gateway:
            for number in range(DEVICES):
                name = f"chance{number}"
                gateway.wait_for(
                    lambda name=name: gateway.modules()[name]["alive"], PATIENCE_S, f"{name} runs"
                )
                gateway.ctl("set", f"{name}.wanted", str(VALUES))
                written = folder / f"{name}.txt"
                gateway.wait_for(
                    lambda written=written: written.read_text().count("\n") >= VALUES,
                    PATIENCE_S,
                    f"{name} has written its values",
                )
            yield Site(port, [Point(row) for row in gateway.points().values()])
    finally:
        remove(folder)


def places(site: Site) -> list[tuple[str, str, FC, str]]:
    return [point.place for point in site.points]


def test_libiec61850_has_every_name_value_and_quality(site: Site) -> None:
    assert len(site.points) == COUNT
    found = browsed(site.port)
    names = {
        (device, name)
        for device, of_device in found.items()
        for name in of_device["values"]
        if name.startswith(("GGIO1$ST$", "GGIO1$MX$")) and not name.endswith("$Beh")
    }
    assert names == {(device, f"GGIO1${fc.name}${name}") for device, name, fc, _ in places(site)}
    for point in site.points:
        device, name, fc, _ = point.place
        value, quality, _ = found[device]["values"][f"GGIO1${fc.name}${name}"]
        assert quality == point.quality, point
        if point.row["value"] is not None:
            assert value == point.value, point
            assert type(value) is type(point.value)
        assert found[device]["values"].get(f"GGIO1$DC${name}") == [point.row["name"]]


def test_the_rust_client_has_every_name_and_value(site: Site) -> None:
    async def browse() -> tuple[set[tuple[str, str]], list[Any]]:
        connection = await IedConnection.connect(f"127.0.0.1:{site.port}")
        model = await connection.get_device_model()
        values = []
        for device, name, fc, attribute in places(site):
            values.append(await connection.read(f"{device}/GGIO1.{name}.{attribute}", fc))
        await connection.disconnect()
        return {(of["name"], name) for of in model["logical_devices"] for name in of["variables"]}, values

    names, values = asyncio.run(browse())
    for point, value in zip(site.points, values, strict=True):
        device, name, fc, attribute = point.place
        assert (device, f"GGIO1${fc.name}${name}${attribute.replace('.', '$')}") in names
        if point.row["value"] is None:  # it has none yet
            continue
        if point.row["type"] == "double":
            value = value[0] >> 6  # a bit string
        wanted = point.value
        assert value == (wanted[0] if isinstance(wanted, list) else wanted), point
