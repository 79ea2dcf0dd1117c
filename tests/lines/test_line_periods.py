# SPDX-License-Identifier: GPL-3.0-or-later
"""Two devices with periods and one without share a line: who is asked when, as the devices see it."""

import json
import os
import statistics
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import GatewayError
from rig.bare import Bare
from rig.desk import Substation, everything_read, gateway_on_lines

pytestmark = pytest.mark.slow  # as a whole

PORT, FAST, SLOWER, IN_TURN = 1, 1, 2, 3
PERIOD_NS = {FAST: 100_000_000, SLOWER: 250_000_000}
WATCHED_S = 8.0
STORM_S = 4.0
WINDOWS = 5
COILS = 16
# A request is begun late by the one under way and by the other device's, 14 ms each at 38400 bit/s, and its
# last character is 4 ms behind. A busy host stops us all for longer now and then: that no period slips
# without it is what modbus/test_line_periods.c holds in virtual time.
LATE_NS = 32_000_000
READ_INPUT_REGISTERS, WRITE_COIL = 4, 5
C_SC, ACT, ACT_TERM = 45, 6, 10


def configuration() -> dict[str, Any]:
    registers = [{"address": address} for address in range(8)]
    coils = [{"address": address} for address in range(COILS)]
    slaves = [
        {"id": FAST, "period_ms": 100, "input_registers": registers},
        {"id": SLOWER, "input_registers": [{**register, "period_ms": 250} for register in registers]},
        {"id": IN_TURN, "input_registers": registers, "coils": coils},
    ]
    line = {"baud_rate": 38400, "data_bits": 8, "stop_bits": 1, "parity": 0}
    return {"iec104": {}, "port": [{"value": PORT, "active": 1, **line, "slaves": slaves}]}


@pytest.fixture(scope="module")
def substation(programs: Path) -> Iterator[Substation]:
    with gateway_on_lines(configuration(), programs, {}) as (lines, gateway):
        gateway.wait_for(lambda: everything_read(gateway), 60.0, "every device has been read")
        yield Substation(lines, gateway)


def asked_at(substation: Substation, unit: int, since: int) -> list[int]:
    """When the device had a read, by CLOCK_MONOTONIC in ns."""
    return [
        frame.monotonic_ns
        for frame in substation.lines.frames(since)
        if frame.kind == "received" and frame.unit == unit and frame.bytes[1] == READ_INPUT_REGISTERS
    ]


def missed(substation: Substation) -> dict[int, int]:
    (line,) = substation.gateway.query("lines")
    return {device["id"]: device["missed_periods"] for device in line["devices"]}


def wrong_of_periods(substation: Substation) -> list[str]:
    """What does not hold in the time that is watched."""
    since, before = substation.lines.mark(), missed(substation)
    time.sleep(WATCHED_S)  # what is measured is this time
    after = missed(substation)
    wrong = []
    for unit, period_ns in PERIOD_NS.items():
        times, slipped = asked_at(substation, unit, since), after[unit] - before[unit]
        expected = WATCHED_S * 1e9 / period_ns
        late_ns = [time_ns % period_ns for time_ns in times]  # of its period, not of the request before
        if not expected - 2 <= len(times) + slipped <= expected + 3 or slipped > expected / 4:
            wrong.append(f"device {unit}: {len(times)} reads and {slipped} missed of {expected:.0f} periods")
        elif statistics.median(late_ns) > LATE_NS:
            wrong.append(
                f"device {unit}: half of its reads are {statistics.median(late_ns) / 1e6:.0f} ms late"
            )
    in_turn = len(asked_at(substation, IN_TURN, since))
    if after[IN_TURN] != 0 or in_turn <= WATCHED_S * 1e9 / PERIOD_NS[FAST]:
        wrong.append(f"the device without a period: {in_turn} reads, {after[IN_TURN]} missed")
    return wrong


def assert_once(wrong_of: Callable[[Substation], list[str]], substation: Substation) -> None:
    """Nothing is wrong in one window: a busy host spoils some, a wrong scheduler spoils each."""
    seen = []
    for _ in range(WINDOWS):
        seen.append(wrong_of(substation))
        if not seen[-1]:
            return
    raise AssertionError(seen)


def test_periods_hold_and_the_rest_is_read(substation: Substation) -> None:
    assert_once(wrong_of_periods, substation)


def single_command(coil: int, on: bool) -> bytes:
    ca = (1000 * PORT + IN_TURN).to_bytes(2, "little")
    return bytes([C_SC, 1, ACT, 0]) + ca + (coil + 1).to_bytes(3, "little") + bytes([on])


def storm(substation: Substation) -> None:
    """A command waits for each coil all the time: a new one follows the end of each."""
    with Bare(substation.gateway.address) as master:
        master.start()
        master.ask(*(single_command(coil, True) for coil in range(COILS)))
        end_s = time.monotonic() + STORM_S
        while time.monotonic() < end_s:
            asdu = master.asdu()
            master.acknowledge()
            if asdu[0] == C_SC and asdu[2] & 0x3F == ACT_TERM:
                master.ask(single_command(int.from_bytes(asdu[6:9], "little") - 1, not asdu[9] & 1))


def wrong_of_storm(substation: Substation) -> list[str]:
    """Whether commands kept the line busy, and reads had their share all the same."""
    since = substation.lines.mark()
    storm(substation)
    writes = [
        frame
        for frame in substation.lines.frames(since)
        if frame.kind == "received" and frame.bytes[1] == WRITE_COIL
    ]
    wrong = [] if len(writes) > 100 else [f"{len(writes)} commands"]
    for unit, period_ns in PERIOD_NS.items():
        reads = len(asked_at(substation, unit, since))
        if reads < STORM_S * 1e9 / period_ns / 4:
            wrong.append(f"device {unit}: {reads} reads")
    return wrong if asked_at(substation, IN_TURN, since) else [*wrong, "the device without a period: no read"]


def test_periods_slip_under_a_storm_of_commands_and_hold_again(substation: Substation) -> None:
    assert_once(wrong_of_storm, substation)
    substation.gateway.wait_for(
        lambda: not any(command["state"] == "executing" for command in substation.gateway.query("commands")),
        10.0,
        "no command is under way",
    )
    assert_once(wrong_of_periods, substation)


def is_realtime_kernel() -> bool:
    kernel = Path("/sys/kernel/realtime")
    return "PREEMPT_RT" in os.uname().version or (kernel.exists() and kernel.read_text().startswith("1"))


def test_a_point_shows_its_period(substation: Substation) -> None:
    shown = [
        json.loads(substation.gateway.ctl("--json", "show", f"p{PORT}.{unit}.i0"))["period_ms"]
        for unit in (FAST, SLOWER, IN_TURN)
    ]
    assert shown == [100, 250, None]


def test_histogram_shows_what_was_measured_and_what_it_is_worth(substation: Substation) -> None:
    answers = substation.gateway.query("lines")[0]["answers"]
    (line,) = substation.gateway.query("lines", "--histogram")
    transactions, wakeups = line["transactions"]["counts"], line["wakeups"]["counts"]
    assert answers <= sum(transactions) <= answers + 100
    # 29 characters of a read at 38400 bit/s alone take 7.6 ms: no transaction is below 4096 us.
    assert sum(transactions[:13]) == 0
    assert line["transactions"]["longest_us"] >= 7600
    # The line sleeps after each answer at least, until the silence has passed.
    assert sum(wakeups) >= answers / 2
    assert line["realtime_kernel"] is is_realtime_kernel()
    if not line["realtime_kernel"]:
        assert line["verdict"].startswith("none: this kernel is not PREEMPT_RT")
    table = substation.gateway.ctl("lines", "--histogram").splitlines()
    assert table[0].startswith(f"port {PORT}: longest wake-up ")
    assert table[1].split() == ["BELOW", "US", "WAKE-UPS", "TRANSACTIONS"]
    shown = [[int(cell) for cell in row.split()] for row in table[2:-2] if not row.strip().startswith("more")]
    assert [below for below, _, _ in shown] == sorted(below for below, _, _ in shown)
    assert sum(count for _, _, count in shown) >= sum(transactions) - transactions[-1]
    assert table[-2].startswith(f"{line['process']['name']}: ")
    assert table[-1] == f"verdict: {line['verdict']}"


def test_histogram_belongs_to_lines_alone(substation: Substation) -> None:
    with pytest.raises(GatewayError, match="takes no --histogram"):
        substation.gateway.ctl("counters", "--histogram")
