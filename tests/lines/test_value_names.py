# SPDX-License-Identifier: GPL-3.0-or-later
"""Values that have names: shown, told and commanded by them."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import GatewayError
from rig.desk import Substation, everything_read, gateway_on_lines, patience

DEVICE, HOLDING, INPUT = "1.5", "holding_registers", "input_registers"
WAIT_S = 60.0
MODE, STATE, SPEED = 10, 20, 30
MODES = {"0": "off", "1": "heating", "2": "cooling", "-1": "on strike"}


def configuration() -> dict[str, Any]:
    pace = {"baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    mode = {"address": MODE, "name": "mode", "names": MODES}
    state = {
        "address": STATE,
        "type": "float",
        "format": "uint16",
        "name": "state",
        "names": {"65535": "dead"},
    }
    valve = {"address": 21, "bit": 3, "ioa": 700, "name": "valve", "names": {"0": "shut", "1": "open"}}
    breaker = {"address": 0, "type": "double", "name": "breaker", "names": {"1": "open", "2": "closed"}}
    lamp = {"address": 4, "name": "lamp", "names": {"0": "on", "1": "off"}}  # by its manual
    tables = {
        HOLDING: [mode, {"address": SPEED, "name": "speed"}],
        INPUT: [state, valve],
        "coils": [breaker, lamp],
    }
    slave = {"id": 5, **patience(), **tables}
    return {"iec104": {}, "port": [{"value": 1, "active": 1, **pace, "slaves": [slave]}]}


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Substation]:
    values = {DEVICE: {HOLDING: {str(MODE): 2}, INPUT: {str(STATE): 65535, "21": 8}}}
    with gateway_on_lines(configuration(), programs, values) as (lines, gateway):
        gateway.wait_for(lambda: everything_read(gateway), WAIT_S, "all that is read has been read")
        yield Substation(lines, gateway)


def test_points_tell_the_names(running: Substation) -> None:
    points = running.gateway.points()
    assert [(points[name]["value"], points[name].get("meaning")) for name in ("mode", "state", "valve")] == [
        (2, "cooling"),
        (65535, "dead"),
        ("on", "open"),
    ]
    assert "meaning" not in points["speed"]
    listed = running.gateway.ctl("points")
    assert "cooling (2)" in listed
    assert "dead (65535)" in listed
    assert "open (on)" in listed


def test_value_without_a_name_is_a_number(running: Substation) -> None:
    running.lines.set(DEVICE, HOLDING, MODE, 7)
    running.gateway.wait_for(lambda: running.gateway.points()["mode"]["value"] == 7, WAIT_S, "7 is read")
    assert "meaning" not in running.gateway.points()["mode"]
    running.lines.set(DEVICE, HOLDING, MODE, 2)
    running.gateway.wait_for(lambda: running.gateway.points()["mode"]["value"] == 2, WAIT_S, "2 is read")
    changes = [json.loads(row) for row in running.gateway.ctl("events", "--json").splitlines()]
    told = [(row["value"], row.get("meaning")) for row in changes if row.get("name") == "mode"]
    assert told[-2:] == [(7, None), (2, "cooling")]


def test_command_gives_a_name_or_its_number(running: Substation) -> None:
    for value, raw in (("heating", 1), ("on strike", 65535), ("0", 0)):
        assert "executed command" in running.gateway.ctl("set", "mode", value)
        assert running.lines.get(DEVICE, HOLDING, MODE) & 0xFFFF == raw
    commands = {row["name"]: row for row in running.gateway.query("commands")}
    assert commands["mode"]["meaning"] == "off"
    assert commands["mode"]["expected"] == "on strike, off, heating, cooling"


def test_command_of_what_has_no_name_is_refused(running: Substation) -> None:
    before = running.lines.get(DEVICE, HOLDING, MODE)
    for value, message in (("5", "out of range"), ("boiling", "expected on strike, off, heating, cooling")):
        with pytest.raises(GatewayError, match=message):
            running.gateway.ctl("set", "mode", value)
    assert running.lines.get(DEVICE, HOLDING, MODE) == before


def test_number_of_a_state_is_that_of_its_name(running: Substation) -> None:
    for value, coils in (("2", [0, 1]), ("1", [1, 0]), ("closed", [0, 1])):
        assert "executed command" in running.gateway.ctl("set", "breaker", value)
        assert [running.lines.get(DEVICE, "coils", place) for place in (0, 1)] == coils
    with pytest.raises(GatewayError, match="out of range"):
        running.gateway.ctl("set", "breaker", "0")


def test_name_goes_before_the_word_of_its_type(running: Substation) -> None:
    assert "executed command" in running.gateway.ctl("set", "lamp", "on")
    assert running.lines.get(DEVICE, "coils", 4) == 0


def test_reload_takes_other_names(running: Substation) -> None:
    config = json.loads(running.gateway.config_file.read_text())
    (mode, *_) = config["port"][0]["slaves"][0][HOLDING]
    mode["names"] = MODES | {"2": "chilling"}
    mode["unit"] = "mode"
    running.gateway.config_file.write_text(json.dumps(config))
    assert "nothing changes" not in running.gateway.ctl("reload")
    running.gateway.wait_for(lambda: everything_read(running.gateway), WAIT_S, "the line is read again")
    assert "executed command" in running.gateway.ctl("set", "mode", "chilling")
    running.gateway.wait_for(
        lambda: running.gateway.points()["mode"].get("meaning") == "chilling", WAIT_S, "the new name"
    )
    (row,) = (row for row in running.gateway.query("commands") if row["name"] == "mode")
    assert row["unit"] == "mode"
