# SPDX-License-Identifier: GPL-3.0-or-later
"""Values whose power of ten and factor are points of the device, of whatever table."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import GatewayError
from rig.desk import Substation, gateway_on_lines, patience

DEVICE, HOLDING, INPUT = "1.5", "holding_registers", "input_registers"
POWER, CURRENT, PLACES, RATIO, LIMIT = 0, 1, 10, 11, 20
COUNT, FRACTION, OF_COUNT, OF_FRACTION = 30, 31, 32, 34
RARE, OF_RARE = 40, 41
RARELY = {"period_ms": 86_400_000}
WAIT_S = 60.0


def configuration() -> dict[str, Any]:
    pace = {"baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    both = {"scale_by": "places", "factor_by": "ratio"}
    inputs = [
        {"address": POWER, "type": "float", "format": "int16", "name": "power", "offset": 1, **both},
        {"address": CURRENT, "type": "float", "format": "uint16", "name": "current", "factor_by": "ratio"},
    ]
    registers = [
        {"address": PLACES, "name": "places"},
        {"address": RATIO, "type": "float", "format": "uint16", "scale": 0.5, "name": "ratio"},
        {"address": LIMIT, "type": "float", "format": "int16", "name": "limit", **both},
        {"address": COUNT, "format": "uint16", "name": "count"},
        {"address": FRACTION, "type": "float", "format": "int16", "scale": 0.5, "name": "fraction"},
        {"address": OF_COUNT, "type": "float", "name": "of_count", "factor_by": "count"},
        {"address": OF_FRACTION, "type": "float", "name": "of_fraction", "scale_by": "fraction"},
        {"address": OF_RARE, "format": "int16", "name": "of_rare", "scale_by": "rare", **RARELY},
        {"address": RARE, "name": "rare", **RARELY},
    ]
    slave = {"id": 5, **patience(), INPUT: inputs, HOLDING: registers}
    return {"iec104": {}, "port": [{"value": 1, "active": 1, **pace, "slaves": [slave]}]}


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Substation]:
    values = {DEVICE: {INPUT: {"0": -15, "1": 7}, HOLDING: {"10": 2, "11": 80, "40": 1, "41": 7}}}
    with gateway_on_lines(configuration(), programs, values) as (lines, gateway):
        yield Substation(lines, gateway)


def shows(running: Substation, name: str, value: float | None) -> None:
    """None: it is invalid."""

    def is_there() -> bool:
        point = running.gateway.points()[name]
        good = point["quality"] == "good"
        return not good if value is None else good and point["value"] == pytest.approx(value)

    running.gateway.wait_for(is_there, WAIT_S, f"{name} is {value}")


def test_power_and_factor_are_read_of_other_tables(running: Substation) -> None:
    shows(running, "power", -15 * 100 * 40 + 1)
    shows(running, "current", 7 * 40)
    running.lines.set(DEVICE, HOLDING, PLACES, -1, 10)
    shows(running, "power", -15 * 0.1 * 5 + 1)
    shows(running, "current", 7 * 5)


def test_what_is_read_with_a_value_scales_it(running: Substation) -> None:
    shows(running, "of_rare", 70)  # the next read is tomorrow's


def test_without_one_there_is_no_value(running: Substation) -> None:
    running.lines.set(DEVICE, HOLDING, PLACES, -32768)  # SunSpec: not implemented
    shows(running, "power", None)
    shows(running, "current", 7 * 5)
    running.lines.set(DEVICE, HOLDING, PLACES, 0, 0)
    shows(running, "current", None)
    with pytest.raises(GatewayError, match="no power of ten"):
        running.gateway.ctl("set", "limit", "5")
    running.lines.set(DEVICE, HOLDING, RATIO, 2)
    shows(running, "current", 7)


def test_command_goes_the_same_way_back(running: Substation) -> None:
    running.lines.set(DEVICE, HOLDING, PLACES, 1, 80)
    shows(running, "current", 7 * 40)
    running.gateway.wait_for(lambda: running.gateway.points()["places"]["value"] == 1, WAIT_S, "1 is read")
    assert "executed command" in running.gateway.ctl("set", "limit", "-1200")
    assert running.lines.get(DEVICE, HOLDING, LIMIT) in (-3, 65533)
    shows(running, "limit", -1200)


def test_a_factor_beyond_its_own_limits_is_none(running: Substation) -> None:
    running.lines.set(DEVICE, HOLDING, COUNT, 65535)  # of which a scaled value shows 32767, and overflow
    shows(running, "of_count", None)
    running.lines.set(DEVICE, HOLDING, COUNT, 3)
    shows(running, "of_count", 0)


def test_a_broken_power_is_none(running: Substation) -> None:
    running.lines.set(DEVICE, HOLDING, FRACTION, 3)
    shows(running, "of_fraction", None)
    running.lines.set(DEVICE, HOLDING, FRACTION, 4)
    shows(running, "of_fraction", 0)
