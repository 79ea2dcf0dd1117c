# SPDX-License-Identifier: GPL-3.0-or-later
"""What the gateway itself writes to a device: constants, and what was commanded last."""

import json
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from lab.linesim import Frame
from rig.desk import Substation, everything_read, gateway_on_lines, patience

pytestmark = pytest.mark.slow  # as a whole; test_line_kept.c looks at the same

DEVICE, HOLDING = "1.5", "holding_registers"
READ, WRITE_REGISTER = 3, 6
SEEN, WATCHDOG, MODE, LIMIT, TOGGLED = 0, 10, 11, 12, 13
WAIT_S = 60.0

OBJECTS = [
    {"address": SEEN},
    {"address": WATCHDOG, "name": "watchdog", "write_only": True, "write_values": [7], "write_every_ms": 200},
    {"address": MODE, "name": "mode", "write_values": [-3], "write_at_return": True},
    {"address": LIMIT, "name": "limit", "write_at_return": True},
    {
        "address": TOGGLED,
        "name": "toggled",
        "write_only": True,
        "write_values": [255, -256],
        "write_every_ms": 200,
    },
]


def configuration() -> dict[str, Any]:
    """Of two lines of one process."""
    pace = {"baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    slave = {"id": 5, **patience(), "retries": 0, "probe_max_s": 1, HOLDING: OBJECTS}
    other = {"id": 6, **patience(), HOLDING: [{"address": 0}]}
    lines = [{"value": 1, "slaves": [slave]}, {"value": 2, "slaves": [other]}]
    return {"iec104": {}, "port": [{"active": 1, **pace, **line} for line in lines]}


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Substation]:
    with gateway_on_lines(configuration(), programs, {}) as (lines, gateway):
        gateway.wait_for(lambda: everything_read(gateway), WAIT_S, "all that is read has been read")
        yield Substation(lines, gateway)


@pytest.fixture(autouse=True)
def sound(running: Substation) -> Iterator[None]:
    yield
    running.lines.fault(DEVICE, "clear")
    running.gateway.wait_for(lambda: everything_read(running.gateway), WAIT_S, "the device is back")


def device(running: Substation) -> dict[str, Any]:
    found: dict[str, Any] = running.gateway.query("lines")[0]["devices"][0]
    return found


def writes(running: Substation, since: int, address: int) -> list[Frame]:
    running.lines.get(DEVICE, HOLDING, address)  # its answer comes behind the frames so far
    wanted = bytes([WRITE_REGISTER, 0, address])
    return [f for f in running.lines.frames(since) if f.kind == "received" and f.bytes[1:4] == wanted]


def holds(running: Substation, address: int, value: int) -> None:
    running.gateway.wait_for(
        lambda: running.lines.get(DEVICE, HOLDING, address) in (value, value & 0xFFFF), WAIT_S, f"{value}"
    )


def go_and_come_back(running: Substation) -> None:
    """Somebody has reset it meanwhile."""
    running.lines.fault(DEVICE, "mute")
    running.gateway.wait_for(lambda: not device(running)["alive"], WAIT_S, "the device is dead")
    dead = running.lines.mark()
    running.lines.wait_frame(lambda f: f.kind == "received" and f.bytes[1] == READ, since=dead)
    assert not writes(running, dead, WATCHDOG)  # a probe came, and none of these
    for address in (WATCHDOG, MODE, LIMIT):
        running.lines.set(DEVICE, HOLDING, address, 0)
    running.lines.fault(DEVICE, "clear")


def test_constants_are_written_when_the_device_is_there_and_when_it_is_back(running: Substation) -> None:
    holds(running, WATCHDOG, 7)
    holds(running, MODE, -3)
    go_and_come_back(running)
    holds(running, WATCHDOG, 7)
    holds(running, MODE, -3)
    assert running.lines.get(DEVICE, HOLDING, LIMIT) == 0  # nothing was commanded


def test_watchdog_is_written_again_and_again_and_is_no_command(running: Substation) -> None:
    since, before = running.lines.mark(), device(running)
    running.gateway.wait_for(lambda: len(writes(running, since, WATCHDOG)) >= 3, WAIT_S, "three writes")
    running.gateway.wait_for(
        lambda: device(running)["kept_writes"] > before["kept_writes"], WAIT_S, "counted"
    )
    assert not writes(running, since, MODE)
    assert running.gateway.query("lines")[0]["commands"] == 0
    assert device(running)["kept_writes_failed"] == before["kept_writes_failed"]


def test_values_are_written_in_turn(running: Substation) -> None:
    since = running.lines.mark()
    running.gateway.wait_for(lambda: len(writes(running, since, TOGGLED)) >= 4, WAIT_S, "four writes")
    values = [frame.bytes[4:6] for frame in writes(running, since, TOGGLED)]
    assert all(a != b and {a, b} == {b"\x00\xff", b"\xff\x00"} for a, b in pairwise(values))


def test_what_was_commanded_last_is_written_again(running: Substation) -> None:
    running.gateway.ctl("set", "limit", "77")
    assert running.lines.get(DEVICE, HOLDING, LIMIT) == 77
    go_and_come_back(running)
    holds(running, LIMIT, 77)


def test_a_refusal_is_told_once_and_nothing_else_suffers(running: Substation) -> None:
    before = device(running)["kept_writes_failed"]
    line = "exception 2 to what the gateway itself writes to watchdog"
    running.lines.fault(DEVICE, "exception", 2, WRITE_REGISTER)
    running.gateway.wait_for(
        lambda: device(running)["kept_writes_failed"] >= before + 5, WAIT_S, "five refusals"
    )
    assert running.gateway.log(200).count(line) == 1
    assert device(running)["alive"]
    assert everything_read(running.gateway)
    running.lines.fault(DEVICE, "clear")
    running.gateway.wait_for(
        lambda: "takes what the gateway itself writes to watchdog again" in running.gateway.log(200),
        WAIT_S,
        "it is said that it is taken again",
    )


def test_what_was_commanded_last_outlives_a_reload_of_another_line(running: Substation) -> None:
    gateway = running.gateway
    gateway.ctl("set", "limit", "78")
    running.lines.set(DEVICE, HOLDING, LIMIT, 0)
    changed = json.loads(gateway.config_file.read_text())
    changed["port"][1]["slaves"][0]["retries"] = 5
    gateway.config_file.write_text(json.dumps(changed))
    assert "nothing changes" not in gateway.ctl("reload")
    holds(running, LIMIT, 78)
