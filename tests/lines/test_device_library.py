# SPDX-License-Identifier: GPL-3.0-or-later
"""Each template that comes with OpenRTU: what it says of itself, and a simulated device, read and commanded.

What linesim's registers hold, and what the gateway makes of them, is worked out here a second time.
"""

import contextlib
import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim
from openrtu_tools import devices
from rig.desk import everything_read, patience

KINDS = {"meter", "inverter", "battery", "relay", "drive", "sensor", "I/O", "genset", "heat pump"}
KINDS |= {"EV charger", "UPS", "SunSpec"}
LIBRARY = {device.name: device for device in devices.read(devices.folder())}
# What iec61850/unit.c has a number for, with its prefixes, and what manuals have besides.
UNITS = {"V", "A", "W", "var", "VA", "Wh", "varh", "VAh", "Hz", "°C", "%", "s", "min", "h", "Pa", "m", "m/s"}
UNITS |= {"W/m²", "deg", "lx", "ppm", "ohm", "K", "m³", "m³/s", "l", "l/s", "1/s", "cos(phi)", "g", "J"}
PREFIXES = ("", "m", "µ", "k", "M", "h", "d", "c", "G")
NO_SI = {"rpm", "l/h", "m³/h", "bar", "mbar", "Ah", "d", "µg/m³", "mm/h"}
TABLES = {"coils": 1, "discrete_inputs": 1, "input_registers": 16, "holding_registers": 16}
FORMATS = {
    **{"int16": (1, "h"), "uint16": (1, "H"), "int32": (2, "i"), "uint32": (2, "I")},
    **{"int64": (4, "q"), "uint64": (4, "Q"), "float32": (2, "f"), "float64": (4, "d")},
}
DEFAULTS = {"float": "float32", "scaled": "int16", "counter": "int32", "bitstring": "uint32"}
UNITS_A_LINE = 60
POWER = 1  # of ten, in what scales others


def format_of(one: dict[str, Any]) -> str:
    fallback = "uint16" if "bits" in one else DEFAULTS[one.get("type", "scaled")]
    return str(one.get("format", fallback))


def is_bit(table: str, one: dict[str, Any]) -> bool:
    return TABLES[table] == 1 or "bit" in one


def takes_commands(table: str, one: dict[str, Any]) -> bool:
    return "write_address" in one or (
        table in ("coils", "holding_registers") and not one.get("read_only") and one.get("format") != "string"
    )


def says_what_it_takes(table: str, one: dict[str, Any]) -> bool:
    return is_bit(table, one) or bool(one.keys() & {"min", "names"})


# ---- what a template says of itself ------------------------------------------------------------------


@pytest.mark.parametrize("name", LIBRARY)
def test_a_template_says_what_it_is_of_and_where_it_is_from(name: str) -> None:
    device = LIBRARY[name]
    assert device.about["kind"] in KINDS
    assert device.about["maker"] and device.about["device"] and device.about["connection"]
    assert device.about["untried"] is True  # until somebody has read one
    rows = {one["name"] for _, one in device.objects()}
    sources = device.about["sources"]
    assert all(set(source.get("lacks", ())) <= rows for source in sources), (
        "a source lacks what the template has not"
    )
    assert {row for row in rows if all(row in source.get("lacks", ()) for source in sources)} == set()


@pytest.mark.parametrize("name", LIBRARY)
def test_its_objects_have_names_units_and_addresses_of_their_own(name: str) -> None:
    objects = list(LIBRARY[name].objects())
    names = [one["name"] for _, one in objects]
    assert len(names) == len(set(names))
    bits: dict[tuple[str, int], set[int]] = {}
    for table, one in objects:
        unit = one.get("unit", "")
        assert unit == "" or unit in NO_SI or any(unit == p + u for p in PREFIXES for u in UNITS), one
        count = one.get("length") or (1 if is_bit(table, one) else FORMATS[format_of(one)][0])
        first, last = (one["bit"], one["bit"]) if "bit" in one else one.get("bits", (0, 15))
        for address in range(one["address"], one["address"] + count):
            whole = TABLES[table] == 1 or not one.keys() & {"bit", "bits"}
            taken = set(range(16)) if whole else set(range(first, last + 1))
            assert not taken & bits.setdefault((table, address), set()), one
            bits[table, address] |= taken


@pytest.mark.parametrize("name", [name for name in LIBRARY if not name.startswith("sunspec-model")])
def test_what_takes_commands_says_which(name: str) -> None:
    """What a device only measures has read_only."""
    for table, one in LIBRARY[name].objects():
        if takes_commands(table, one):
            assert says_what_it_takes(table, one) or one.get("write_only"), one


# ---- on a line ---------------------------------------------------------------------------------------


@dataclass
class Simulated:
    """A device's registers, and the values that its objects have then."""

    registers: dict[str, dict[int, int]] = field(default_factory=lambda: {table: {} for table in TABLES})
    values: dict[str, Any] = field(default_factory=dict)

    def put(self, table: str, one: dict[str, Any], number: int) -> None:
        """Some value that fits it."""
        address, place = one["address"], self.registers[table]
        if one.get("format") == "string":
            self.values[one["name"]] = "AB"
            place[address] = ord("A") << 8 | ord("B")
            return
        if is_bit(table, one):
            value = number % 2
            place[address] = place.get(address, 0) | value << one.get("bit", 0)
            self.values[one["name"]] = "on" if value ^ one.get("inverted", False) else "off"
            return
        raw = 3 + number % 5 if "names" in one or "bits" in one else 100 + number
        if "names" in one:
            raw = int(list(one["names"])[number % len(one["names"])])
        if "bits" in one:
            first, last = one["bits"]
            raw %= 1 << last - first + 1
            place[address] = place.get(address, 0) | raw << first
        else:
            for at, register in enumerate(registers_of(one, raw), address):
                place[at] = register
        self.values[one["name"]] = raw * one.get("scale", 1) + one.get("offset", 0)


def registers_of(one: dict[str, Any], raw: float) -> list[int]:
    count, letter = FORMATS[format_of(one)]
    octets = struct.pack(f">{letter}", raw)
    registers = list(struct.unpack(f">{count}H", octets))
    if one.get("byte_order") == "little":
        registers = [register >> 8 | (register & 0xFF) << 8 for register in registers]
    return registers[::-1] if one.get("word_order") == "little" else registers


def simulated(device: devices.Device) -> Simulated:
    found = Simulated()
    objects = list(device.objects())
    powers = {one["scale_by"] for _, one in objects if "scale_by" in one}
    for number, (table, one) in enumerate(objects):
        if not one.get("write_only"):
            found.put(table, one, POWER - 100 if one["name"] in powers else number)
    for table, one in objects:
        if "scale_register" in one:  # 10^0, where no object says else
            found.values[one["name"]] *= 10 ** found.registers[table].setdefault(one["scale_register"], 0)
        for key, way in (("scale_by", lambda v: 10**v), ("factor_by", lambda v: v)):
            if key in one:
                found.values[one["name"]] *= way(found.values[one[key]])
    return found


@dataclass
class Library:
    lines: LineSim
    gateway: Gateway
    devices: dict[str, tuple[str, Simulated]]  # template: port.unit
    points: dict[str, dict[str, Any]]


@pytest.fixture(scope="module")
def library(programs: Path) -> Iterator[Library]:
    """One gateway, with a device of each template on its lines."""
    pace = {"active": 1, "baud_rate": 460800, "data_bits": 8, "stop_bits": 1, "parity": 0}
    ports: list[dict[str, Any]] = []
    plain: list[dict[str, Any]] = []
    initial: dict[str, dict[str, dict[str, int]]] = {}
    found: dict[str, tuple[str, Simulated]] = {}
    for number, device in enumerate(LIBRARY.values()):
        port, unit = 1 + number // UNITS_A_LINE, 1 + number % UNITS_A_LINE
        if unit == 1:
            ports.append(pace | {"value": port, "slaves": []})
            plain.append(pace | {"value": port, "slaves": []})
        own = simulated(device)
        found[device.name] = f"{port}.{unit}", own
        initial[f"{port}.{unit}"] = {
            table: {str(address): value for address, value in registers.items()}
            for table, registers in own.registers.items() if registers
        }  # fmt: skip
        slave = {"id": unit, "template": device.name, "name_prefix": f"{port}.{unit}/", "period_ms": 60000}
        periods = {one["name"]: one.get("period_ms", 0) for _, one in device.objects()}
        overrides = {row: {"period_ms": 60000} for row, period in periods.items() if period > 1000}
        ports[-1]["slaves"].append(
            slave | patience() | {"ca": 100 + number, "overrides": overrides, "pause_ms": 0}
        )
        plain[-1]["slaves"].append(device.template | {"id": unit})
    templates = {device.name: device.template for device in LIBRARY.values()}
    directory = run_directory()
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        (directory / "devices.json").write_text(json.dumps({"port": plain}))
        (directory / "values.json").write_text(json.dumps(initial))
        lines = stack.enter_context(
            LineSim(directory / "devices.json", directory / "values.json", directory / "dev")
        )
        config = listening_on({"templates": templates, "port": ports}, free_port())
        gateway = stack.enter_context(Gateway(config, directory, programs))
        gateway.wait_for(lambda: everything_read(gateway), 60.0, "every device has been read")
        yield Library(lines, gateway, found, gateway.points())


@pytest.mark.parametrize("name", LIBRARY)
def test_all_points_of_its_device_are_read(library: Library, name: str) -> None:
    place, own = library.devices[name]
    for row, value in own.values.items():
        expected = value if isinstance(value, str) else pytest.approx(value, rel=1e-6)
        assert library.points[f"{place}/{row}"]["value"] == expected, row


def commanded(one: dict[str, Any]) -> float:
    """Some value that it takes."""
    return float(list(one["names"])[-1]) if "names" in one else float(one["max"])


@pytest.mark.parametrize(
    "name",
    [
        name
        for name, device in LIBRARY.items()  # a table of SunSpec does not say what a device lets write
        if "model" not in device.about
        and any(takes_commands(*row) and says_what_it_takes(*row) for row in device.objects())
    ],
)
def test_its_device_is_commanded(library: Library, name: str) -> None:
    place, _ = library.devices[name]
    for table, one in LIBRARY[name].objects():
        if not (takes_commands(table, one) and says_what_it_takes(table, one)):
            continue
        point, address = f"{place}/{one['name']}", one.get("write_address", one["address"])
        if is_bit(table, one):
            library.gateway.ctl("set", point, "on")
            assert library.lines.get(place, "coils", address) == 1
            continue
        value = commanded(one)
        library.gateway.ctl("set", *(["--select"] if one.get("select") else []), point, f"{value:g}")
        raw = (value - one.get("offset", 0)) / one.get("scale", 1)
        wanted = registers_of(one, raw if "float" in format_of(one) else round(raw))
        read = [library.lines.get(place, "holding_registers", address + i) for i in range(len(wanted))]
        assert read == wanted, one
