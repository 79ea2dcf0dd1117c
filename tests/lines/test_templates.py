# SPDX-License-Identifier: GPL-3.0-or-later
"""Templates that come with OpenRTU, as a controlling station sees them; all: test_device_library.py."""

import contextlib
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim
from lab.master import Master
from rig.capture import recorded
from rig.desk import everything_read, patience

FOLDER = Path(__file__).resolve().parents[2] / "package/openrtu/src/templates"
FILES = {
    FOLDER / name: json.loads((FOLDER / name).read_text())
    for name in ("relay.json", "sdm630.json", "sunspec.json")
}
TEMPLATES = {name: template for file in FILES.values() for name, template in file["templates"].items()}
UNITS = {name: number for number, name in enumerate(TEMPLATES, 1)}
CA = 100  # and the unit
HOLDING = "holding_registers"
PATIENCE_MS = 1500

# SunSpec's models, point by point as its public model files have them, with their registers if more than one.
# The first point stands behind the model's number and length, at 40069 and 40070.
FIRST = 40071
INVERTER = """
A AphA AphB AphC A_SF PPVphAB PPVphBC PPVphCA PhVphA PhVphB PhVphC V_SF W W_SF Hz Hz_SF VA VA_SF VAr VAr_SF
PF PF_SF WH:2 WH_SF DCA DCA_SF DCV DCV_SF DCW DCW_SF TmpCab TmpSnk TmpTrns TmpOt Tmp_SF St StVnd Evt1:2
"""
FLOATS = """
A:2 AphA:2 AphB:2 AphC:2 PPVphAB:2 PPVphBC:2 PPVphCA:2 PhVphA:2 PhVphB:2 PhVphC:2 W:2 Hz:2 VA:2 VAr:2 PF:2
WH:2 DCA:2 DCV:2 DCW:2 TmpCab:2 TmpSnk:2 TmpTrns:2 TmpOt:2 St StVnd Evt1:2
"""
METER = """
A AphA AphB AphC A_SF PhV PhVphA PhVphB PhVphC PPV PhVphAB PhVphBC PhVphCA V_SF Hz Hz_SF
W WphA WphB WphC W_SF VA VAphA VAphB VAphC VA_SF VAR VARphA VARphB VARphC VAR_SF PF PFphA PFphB PFphC PF_SF
TotWhExp:2 TotWhExpPhA:2 TotWhExpPhB:2 TotWhExpPhC:2 TotWhImp:2 TotWhImpPhA:2 TotWhImpPhB:2 TotWhImpPhC:2
TotWh_SF TotVAhExp:2 TotVAhExpPhA:2 TotVAhExpPhB:2 TotVAhExpPhC:2 TotVAhImp:2 TotVAhImpPhA:2 TotVAhImpPhB:2
TotVAhImpPhC:2 TotVAh_SF TotVArhImpQ1:8 TotVArhImpQ2:8 TotVArhExpQ3:8 TotVArhExpQ4:8 TotVArh_SF Evt:2
"""
MODELS = {"sunspec-101": INVERTER, "sunspec-103": INVERTER, "sunspec-113": FLOATS, "sunspec-203": METER}
# The names of the scale factors, where it is not the point's with _SF.
FACTORS = {
    **{f"Aph{phase}": "A" for phase in "ABC"},
    **{f"PhV{point}": "V" for point in ("", "phA", "phB", "phC", "phAB", "phBC", "phCA")},
    **{f"Wph{phase}": "W" for phase in "ABC"},
    "PPV": "V",
    "TmpCab": "Tmp",
    "TotWhExp": "TotWh",
    "TotWhImp": "TotWh",
}


def places_of(model: str) -> dict[str, int]:
    """The address of each point."""
    places, address = {}, FIRST
    for point in model.split():
        name, _, registers = point.partition(":")
        places[name] = address
        address += int(registers or 1)
    return places


@pytest.mark.parametrize("name", MODELS)
def test_sunspec_addresses_are_those_of_the_model(name: str) -> None:
    places = places_of(MODELS[name])
    events = places.get("Evt1") or places["Evt"]
    for point in TEMPLATES[name][HOLDING]:
        if "bit" in point:
            assert point["address"] == events + 1, point  # bits 0 to 15: the second register
            continue
        assert point["address"] == places[point["name"]], point
        assert point["ioa"] == point["address"] - FIRST + 1, point
        if factor := point.get("scale_register"):
            assert factor == places[f"{FACTORS.get(point['name'], point['name'])}_SF"], point


def test_every_sunspec_template_is_compared_with_its_model() -> None:
    assert set(MODELS) == {name for name in TEMPLATES if name.startswith("sunspec")}


# ---- on a line -----------------------------------------------------------------------------------


def words(value: float) -> tuple[int, int]:
    return struct.unpack(">2H", struct.pack(">f", value))


# Template, its table; the registers of a device, from an address on; the values that its objects have then.
DEVICES: list[tuple[str, str, dict[int, tuple[int, ...]], dict[int, Any]]] = [
    (
        "sunspec-101",
        HOLDING,
        {40071: (1042, 1042), 40075: (-2,), 40079: (2301,), 40082: (-1,), 40083: (-240, 1), 40085: (5002, -2)}
        | {40089: (-31, 1), 40093: (3, 5, 2), 40098: (385, 0), 40102: (415,), 40106: (-1,), 40107: (4,)}
        | {40110: (0x0080,)},
        {
            1: 10.42,
            2: 10.42,
            9: 230.1,
            13: -2400.0,
            15: 50.02,
            19: -310.0,
            23: 19661300.0,
            28: 385.0,
            32: 41.5,
        }
        | {37: 4, 101: False, 105: False, 108: True},
    ),
    (
        "sunspec-113",
        HOLDING,
        {40071: words(30.5), 40085: words(229.5), 40091: words(20100.0), 40117: (5,), 40120: (0x0011,)},
        {1: 30.5, 15: 229.5, 21: 20100.0, 47: 5, 101: True, 105: True, 108: False},
    ),
    (
        "sunspec-203",
        HOLDING,
        {40071: (-153, -51, -52, -50, -1, 2299, 2298, 2300, 2299, 3982, 3981, 3983, 3982, -1, 5001, -2)}
        | {40087: (-35, -11, -12, -12, 2, 36, -32768, -32768, -32768, 2, 7, -32768, -32768, -32768, 2)}
        | {
            40102: (-97, -32768, -32768, -32768, 0),
            40107: (1, 2),
            40115: (0, 7),
            40123: (1,),
            40175: (0x0044,),
        },
        {1: -15.3, 2: -5.1, 3: -5.2, 4: -5.0, 6: 229.9, 7: 229.8, 8: 230.0, 9: 229.9, 10: 398.2, 11: 398.1}
        | {12: 398.3, 13: 398.2, 15: 50.01, 17: -3500.0, 18: -1100.0, 19: -1200.0, 20: -1200.0, 22: 3600.0}
        | {27: 700.0, 32: -97.0, 37: 655380.0, 45: 70.0}
        | {102: True, 103: False, 105: False, 106: True, 107: False},
    ),
    (
        "sdm630",
        "input_registers",
        {0: words(231.5), 52: words(-1250.0), 70: words(49.98), 72: words(1234.5)},
        {30001: 231.5, 30053: -1250.0, 30071: 49.98, 30073: 1234.5},
    ),
    ("relay", "coils", {0: (1, 0, 1), 7: (1,)}, {1: True, 2: False, 3: True, 8: True}),
    ("relay", "discrete_inputs", {0: (0, 1), 7: (1,)}, {10001: False, 10002: True, 10008: True}),
]


def initial() -> dict[str, dict[str, dict[str, int]]]:
    """What the simulated devices have in their registers."""
    values: dict[str, dict[str, dict[str, int]]] = {}
    for template, table, registers, _ in DEVICES:
        device = values.setdefault(f"1.{UNITS[template]}", {}).setdefault(table, {})
        for begin, row in registers.items():
            device |= {str(address): value for address, value in enumerate(row, begin)}
    return values


@pytest.fixture(scope="module")
def master(programs: Path) -> Iterator[Master]:
    """A controlling station before a gateway whose one line has a device of each template."""
    port = {"value": 1, "active": 1, "baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    patient = patience(PATIENCE_MS)
    slaves = [{"id": unit, "template": name, "ca": CA + unit} | patient for name, unit in UNITS.items()]
    for slave, name in zip(slaves, UNITS, strict=True):
        slave["name_prefix"] = f"{name}/"
    config = {"include": [str(path) for path in FILES], "port": [port | {"slaves": slaves}]}
    # linesim knows no templates
    devices = {"port": [port | {"slaves": [TEMPLATES[name] | {"id": unit} for name, unit in UNITS.items()]}]}
    directory = run_directory()
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        (directory / "devices.json").write_text(json.dumps(devices))
        (directory / "values.json").write_text(json.dumps(initial()))
        stack.enter_context(LineSim(directory / "devices.json", directory / "values.json", directory / "dev"))
        gateway = stack.enter_context(Gateway(listening_on(config, free_port()), directory, programs))
        stack.enter_context(recorded(gateway))
        gateway.wait_for(lambda: everything_read(gateway), 60.0, "every device has been read")
        yield stack.enter_context(Master(*gateway.address))


@pytest.mark.slow
@pytest.mark.sample(3)
@pytest.mark.parametrize(("template", "table", "registers", "expected"), DEVICES)
def test_what_a_device_says_arrives(
    master: Master,
    template: str,
    table: str,
    registers: dict[int, tuple[int, ...]],
    expected: dict[int, Any],
) -> None:
    seen = {report.ioa: report.value for report in master.interrogate(CA + UNITS[template])}
    assert {ioa: seen[ioa] for ioa in expected} == pytest.approx(expected, rel=1e-6)
