# SPDX-License-Identifier: GPL-3.0-or-later
"""What devices say that they are (function 43/14), and where that is not what the file says."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rig.configuration import VALIDATOR
from rig.desk import Substation, everything_read, gateway_on_lines, patience

WAIT_S = 60.0
ENCAPSULATED = 43
METER = {
    "vendor_name": "Müller & Sons",
    "product_code": "M1",
    "revision": "V1.2",
    "vendor_url": "https://example.org",
    "product_name": "Meter one",
}


def configuration() -> dict[str, Any]:
    pace = {"baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    own: list[dict[str, Any]] = [
        {"id": 5, "identification": METER | {"vendor_name": "Mueller"}},
        {"id": 6, "identify": True},
        {"id": 7, "identification": {"holding_registers": [[0, 0], [1, 0, 7]]}},
    ]
    slaves = [device | patience() | {"holding_registers": [{"address": 0}, {"address": 1}]} for device in own]
    return {"iec104": {}, "port": [{"value": 1, "active": 1, **pace, "slaves": slaves}]}


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Substation]:
    with gateway_on_lines(configuration(), programs, {}) as (lines, gateway):
        gateway.wait_for(lambda: everything_read(gateway), WAIT_S, "all has been read")
        yield Substation(lines, gateway)


def device(running: Substation, unit: int) -> dict[str, Any]:
    (line,) = running.gateway.query("lines")
    return next(row for row in line["devices"] if row["id"] == unit)


def state(running: Substation, unit: int, wanted: str) -> None:
    running.gateway.wait_for(
        lambda: device(running, unit)["identification_state"] == wanted, WAIT_S, f"{unit} is {wanted}"
    )


def test_device_says_what_it_is(running: Substation) -> None:
    state(running, 5, "known")
    row = device(running, 5)
    assert row["identification"] == METER | {"vendor_name": "Mueller"}
    assert row["identified"] == "Mueller M1 V1.2"
    assert row["identification_differs"] == []
    assert "Mueller M1 V1.2" in running.gateway.ctl("lines")


def test_one_that_does_not_know_it_is_left_alone(running: Substation) -> None:
    state(running, 6, "refused")
    row = device(running, 6)
    assert (row["alive"], row["exceptions"], row["identified"]) == (True, 0, "")
    assert device(running, 7)["identification_state"] == "off"
    asked = [frame.bytes[0] for frame in running.lines.frames(0) if frame.bytes[1:2] == bytes([ENCAPSULATED])]
    assert 7 not in asked
    assert asked.count(6) == 1  # the refusal has another function


def test_what_differs_is_said(running: Substation) -> None:
    state(running, 5, "known")
    changed = json.loads(running.gateway.config_file.read_text())
    changed["port"][0]["slaves"][0]["identification"] |= {"product_code": "M2", "vendor_name": "Müller"}
    assert VALIDATOR.is_valid(changed)
    running.gateway.config_file.write_text(json.dumps(changed))
    assert "nothing changes" not in running.gateway.ctl("reload")
    running.gateway.wait_for(
        lambda: device(running, 5)["identification_differs"] == ["vendor_name", "product_code"],
        WAIT_S,
        "two objects differ",
    )
    assert "vendor_name, product_code" in running.gateway.ctl("lines")
    said = "unit 5 on port 1 is not what its identification says: vendor_name, product_code differ"
    running.gateway.wait_for(lambda: running.gateway.log(200).count(said) == 1, WAIT_S, "the log says it")
