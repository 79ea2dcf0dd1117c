# SPDX-License-Identifier: GPL-3.0-or-later
"""Each template that comes with OpenRTU: what it says of itself, and a simulated device, read and commanded.

What linesim's registers hold, and what the gateway makes of them, is worked out here a second time.
"""

import contextlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim
from openrtu_tools import devices
from openrtu_tools.modbus.values import BIG, WITHOUT, Layout
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
DEFAULTS = {"float": "float32", "scaled": "int16", "counter": "int32", "bitstring": "uint32"}
UNITS_A_LINE = 60
POWER = 1  # of ten, in what scales others


def format_of(one: dict[str, Any]) -> str:
    fallback = WITHOUT if "bits" in one else DEFAULTS[one.get("type", "scaled")]
    return str(one.get("format", fallback))


def layout_of(one: dict[str, Any]) -> Layout:
    return Layout(format_of(one), one.get("word_order", BIG), one.get("byte_order", BIG))


def is_bit(table: str, one: dict[str, Any]) -> bool:
    return TABLES[table] == 1 or "bit" in one


def takes_commands(table: str, one: dict[str, Any]) -> bool:
    return "write_address" in one or (
        table in ("coils", "holding_registers") and not one.get("read_only") and one.get("format") != "string"
    )


def says_what_it_takes(table: str, one: dict[str, Any]) -> bool:
    return is_bit(table, one) or bool(one.keys() & {"min", "names"})


# ---- what a template says of itself ------------------------------------------------------------------


def wrong(finds: Callable[[devices.Device], Iterator[str]]) -> dict[str, list[str]]:
    """What it finds in each template that has any of it."""
    found = {device.name: list(finds(device)) for device in LIBRARY.values()}
    return {name: messages for name, messages in found.items() if messages}


def in_what_it_says(device: devices.Device) -> Iterator[str]:
    if device.about["kind"] not in KINDS:
        yield f"its kind is {device.about['kind']}"
    yield from (f"no {key}" for key in ("maker", "device", "connection") if not device.about[key])
    if device.about["untried"] is not True:  # until somebody has read one
        yield "untried is not true"
    rows = {one["name"] for _, one in device.objects()}
    lacking = [set(source.get("lacks", ())) for source in device.about["sources"]]
    yield from (f"a source lacks {row}, which it has not" for row in set().union(*lacking) - rows)
    yield from (f"no source has {row}" for row in rows.intersection(*lacking))


def test_a_template_says_what_it_is_of_and_where_it_is_from() -> None:
    assert wrong(in_what_it_says) == {}


def is_a_unit(unit: str) -> bool:
    return unit == "" or unit in NO_SI or any(unit == prefix + si for prefix in PREFIXES for si in UNITS)


def bits_of(table: str, one: dict[str, Any]) -> Iterator[tuple[str, int, int]]:
    """Each with its address."""
    count = one.get("length") or (1 if is_bit(table, one) else layout_of(one).width)
    first, last = (one["bit"], one["bit"]) if "bit" in one else one.get("bits", (0, 15))
    for address in range(one["address"], one["address"] + count):
        yield from ((table, address, bit) for bit in range(first, last + 1))


def in_its_objects(device: devices.Device) -> Iterator[str]:
    names: set[str] = set()
    taken: set[tuple[str, int, int]] = set()
    for table, one in device.objects():
        name, bits = one["name"], set(bits_of(table, one))
        if name in names:
            yield f"a second {name}"
        if not is_a_unit(one.get("unit", "")):
            yield f"{name}: unit {one['unit']}"
        if taken & bits:
            yield f"{name}: is where another one is"
        names.add(name)
        taken |= bits


def test_its_objects_have_names_units_and_addresses_of_their_own() -> None:
    assert wrong(in_its_objects) == {}


def is_a_model(device: devices.Device) -> bool:
    """A table of SunSpec, which does not say what a device lets write."""
    return "model" in device.about


def in_its_commands(device: devices.Device) -> Iterator[str]:
    """What a device only measures has read_only."""
    for table, one in [] if is_a_model(device) else device.objects():
        if takes_commands(table, one) and not (says_what_it_takes(table, one) or one.get("write_only")):
            yield f"{one['name']}: takes any value"


def test_what_takes_commands_says_which() -> None:
    assert wrong(in_its_commands) == {}


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
            for at, register in enumerate(layout_of(one).words(str(raw)), address):
                place[at] = register
        self.values[one["name"]] = raw * one.get("scale", 1) + one.get("offset", 0)


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


def test_all_points_of_each_device_are_read(library: Library) -> None:
    wrong = {}
    for name, (place, own) in library.devices.items():
        for row, value in own.values.items():
            expected = value if isinstance(value, str) else pytest.approx(value, rel=1e-6)
            if (found := library.points[f"{place}/{row}"]["value"]) != expected:
                wrong[name, row] = found, value
    assert wrong == {}


def commanded(one: dict[str, Any]) -> float:
    """Some value that it takes."""
    return float(list(one["names"])[-1]) if "names" in one else float(one["max"])


@pytest.mark.parametrize(
    "name",
    [
        name
        for name, device in LIBRARY.items()
        if not is_a_model(device)
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
        wanted = layout_of(one).words(str(raw if "float" in format_of(one) else round(raw)))
        read = [library.lines.get(place, "holding_registers", address + i) for i in range(len(wanted))]
        assert read == wanted, one
