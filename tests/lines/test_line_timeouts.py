# SPDX-License-Identifier: GPL-3.0-or-later
"""A line whose devices lose answers, get slower or die. modbus/test_line_timeouts.c has the exact times."""

import statistics
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from lab.linesim import Frame
from rig.desk import Substation, everything_read, gateway_on_lines

pytestmark = pytest.mark.slow  # as a whole

PORT, LIVING, LOSING, SLOWER, DYING = 1, 1, 2, 3, 4
# Of those that do not die. So long that it is far above all latencies that a busy host can make.
CEILING_S, FLOOR_S = 4.0, 0.1
SHARE = 0.05
WATCHED_S = 20.0
HOST_S = 0.1  # what a busy host adds to a probe
LOSSES = 7
SLOW_MS, SLOW_S = 2000, 10.0


def configuration() -> dict[str, Any]:
    registers = [{"address": address} for address in range(8)]
    slaves: list[dict[str, Any]] = [
        {"id": unit, "input_registers": registers} for unit in (LIVING, LOSING, SLOWER, DYING)
    ]
    for slave in slaves[:-1]:
        slave["response_timeout_ms"] = int(CEILING_S * 1000)
    line = {"baud_rate": 19200, "data_bits": 8, "stop_bits": 1, "parity": 2}
    return {"iec104": {}, "port": [{"value": PORT, "active": 1, **line, "slaves": slaves}]}


@pytest.fixture(scope="module")
def substation(programs: Path) -> Iterator[Substation]:
    with gateway_on_lines(configuration(), programs, {}) as (lines, gateway):
        gateway.wait_for(lambda: everything_read(gateway), 60.0, "every device has been read")
        yield Substation(lines, gateway)


def qualities(substation: Substation, unit: int) -> set[str]:
    station = substation.ca(f"{PORT}.{unit}")
    return {point["quality"] for point in substation.gateway.points().values() if point["ca"] == station}


def seconds_taken(frames: list[Frame], unit: int) -> list[float]:
    """By each request to the device: until the next one to any."""
    requests = [frame for frame in frames if frame.kind == "received"]
    return [
        (after.monotonic_ns - request.monotonic_ns) / 1e9
        for request, after in pairwise(requests)
        if request.unit == unit
    ]


def test_lost_answer_costs_less_than_the_whole_response_time(substation: Substation) -> None:
    device, taken = f"{PORT}.{LOSING}", []
    for _ in range(LOSSES):
        mark = substation.lines.mark()
        substation.lines.fault(device, "mute", count=1)
        for _ in range(4):  # two requests each: what was lost is asked for again, and answered
            substation.wait_scan(device)
        taken.append(max(seconds_taken(substation.lines.frames(mark), LOSING)))
    assert FLOOR_S <= statistics.median(taken) < CEILING_S / 2, taken
    assert qualities(substation, LOSING) == {"good"}


def test_device_that_gets_slower_stays_alive(substation: Substation) -> None:
    device = f"{PORT}.{SLOWER}"
    substation.lines.fault(device, "delay", SLOW_MS)
    try:
        mark, end_s = substation.lines.mark(), time.monotonic() + SLOW_S
        while time.monotonic() < end_s:
            assert qualities(substation, SLOWER) == {"good"}
            time.sleep(0.05)
        answers = [f for f in substation.lines.frames(mark) if f.kind == "sent" and f.unit == SLOWER]
        assert len(answers) >= 2
    finally:
        substation.lines.fault(device, "clear")


def test_dead_device_costs_its_line_a_twentieth(substation: Substation) -> None:
    device = f"{PORT}.{DYING}"
    substation.lines.fault(device, "mute")
    try:
        substation.gateway.wait_for(
            lambda: qualities(substation, DYING) == {"invalid"}, 60.0, "the device is dead"
        )
        mark, begin_s = substation.lines.mark(), time.monotonic()
        time.sleep(WATCHED_S)  # what is measured is this time
        taken = seconds_taken(substation.lines.frames(mark), DYING)
        assert taken
        assert sum(taken) <= SHARE * (time.monotonic() - begin_s) + HOST_S * len(taken), taken
    finally:
        substation.lines.fault(device, "clear")
    substation.wait_all_good(substation.ca(device))
