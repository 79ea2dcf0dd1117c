# SPDX-License-Identifier: GPL-3.0-or-later
"""The gateway and its ports on the emulated board.

RS-485 with delays, what a port does not take, what another program changes.
"""

import contextlib
import json
import math
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from uarts import FUNCSEL, RS485, Moment, Uart

from lab.board import SILENCE_US, Board
from lab.gateway import GatewayError, remove, run_directory
from lab.linesim import LineSim
from lab.show import RESPONSE_MS
from nuc980.twin.linux import Linux
from nuc980.twin.machine import INSTRUCTION_TIME
from rig.desk import everything_read

PATIENCE_S = 300.0  # a busy host
WATCHED_S = 2.0  # of the board's time
GRAIN_MS = 5.0  # how well a delay is known
CONFIG = "etc/openrtu/gateway.json"
BAUD = 19200
ENABLED, RTS_ON_SEND, RTS_AFTER_SEND = 1, 2, 4

DELAYED, LOW, DIRECT = 2, 3, 4  # ports of the good configuration
BEFORE_MS, AFTER_MS = 20, 35
RS485_OF: dict[int, dict[str, Any]] = {
    DELAYED: {"rts_on_send": "high", "delay_before_ms": BEFORE_MS, "delay_after_ms": AFTER_MS},
    LOW: {"rts_on_send": "low", "delay_before_ms": BEFORE_MS},
    DIRECT: {"rts_on_send": "high"},
}
SETTINGS = {
    DELAYED: f"{ENABLED | RTS_ON_SEND:#x} {BEFORE_MS} {AFTER_MS}",
    LOW: f"{ENABLED | RTS_AFTER_SEND:#x} {BEFORE_MS} 0",
    DIRECT: f"{ENABLED | RTS_ON_SEND:#x} 0 0",
}
PERIOD_MS = 200  # so that RTS has time to fall between the requests

# What a port does not take, by port, and what the log says of it.
REFUSED: dict[int, tuple[dict[str, Any], str]] = {
    1: ({"device": "ttyS1", "baud_rate": 4000000}, r"ttyS1 does not accept 4000000 bit/s, it stays at \d+"),
    2: (
        {"device": "ttyS2", "baud_rate": 1050000},
        "ttyS2 does not accept 1050000 bit/s, it stays at 1090909",
    ),
    3: ({"device": "ttyS5"}, "ttyS5 cannot be opened: No such file or directory"),
    4: ({"device": "ttyS0"}, "ttyS0 cannot be opened: Permission denied"),
    5: ({}, "ttyS6 is used by another process"),
}


def port(number: int, **keys: Any) -> dict[str, Any]:
    device = {
        "id": number,
        "response_timeout_ms": RESPONSE_MS,
        "period_ms": PERIOD_MS,
        "holding_registers": [{"address": 0}],
    }
    settings = {"baud_rate": BAUD, "data_bits": 8, "parity": 2, "stop_bits": 1}
    return {"value": number, "active": 1, **settings, "slaves": [device], **keys}


def good_configuration() -> dict[str, Any]:
    return {"port": [port(number, rs485=rs485) for number, rs485 in RS485_OF.items()]}


def refused_configuration() -> dict[str, Any]:
    return {"port": [port(number, **keys) for number, (keys, _) in REFUSED.items()]}


@pytest.fixture(scope="module")
def lines(linesim_program: Path) -> Iterator[LineSim]:
    folder = run_directory()
    (folder / "config.json").write_text(json.dumps(good_configuration()))
    with LineSim(
        folder / "config.json", None, folder / "dev", silence_us=SILENCE_US, program=linesim_program
    ) as lines:
        yield lines
    remove(folder)


@pytest.fixture(scope="module")
def board_arguments() -> tuple[str | Path, ...]:
    return INSTRUCTION_TIME


@pytest.fixture(scope="module")
def board_chardevs(lines: LineSim) -> dict[int, str]:
    return {number: f"serial,path={lines.line(f'ttyS{number}')}" for number in RS485_OF}


@pytest.fixture(scope="module")
def extra_files(serial_line: Path) -> dict[str, Path | str]:
    return {
        "/bin/serial-line": serial_line,
        CONFIG: json.dumps(good_configuration()),
        "refused.json": json.dumps(refused_configuration()),
    }


@pytest.fixture(scope="module")
def board(linux: Linux, lines: LineSim) -> Board:
    board = Board(linux.machine, lambda command: linux.run(f"{command} 2> /dev/null"), ("", 0))
    wait_all_read(board)
    return board


def wait_all_read(board: Board) -> None:
    def read() -> bool:
        with contextlib.suppress(GatewayError):
            return everything_read(board)
        return False

    board.wait_for(read, PATIENCE_S, "every device has been read")


def wait_logged(board: Board, pattern: str) -> None:
    """Until one of the gateway's lines matches."""

    def logged() -> bool:
        with contextlib.suppress(GatewayError):
            return re.search(pattern, board.ctl("log")) is not None
        return False

    board.wait_for(logged, PATIENCE_S, pattern)


def check_in_force(linux: Linux) -> None:
    """What the kernel has, and what the UART's registers say of it."""
    for number, settings in SETTINGS.items():
        device = f"/dev/ttyS{number}"
        assert linux.run(f"serial-line rs485 {device}") == f"{device} {settings}"
        uart = Uart(linux.machine, number)
        assert (uart.register(FUNCSEL) == RS485) == (number == DIRECT), number
        assert (uart.speed, uart.format) == (pytest.approx(BAUD, rel=0.005), "8E1")


def test_kernel_has_the_settings(linux: Linux, board: Board) -> None:
    check_in_force(linux)


Times = list[tuple[float, float]]  # of each event: after the first, before the second


def changes(moments: list[Moment], state: str, to: bool) -> Times:
    """When rts_high or sending became so."""
    return [
        (before.begin, after.end)
        for before, after in pairwise(moments)
        if getattr(before, state) != to == getattr(after, state)
    ]


def quickest(first: Times, second: Times) -> float:
    """From one of the first to what followed of the second, in milliseconds: no more than this, once.

    QEMU wakes an idle board as late as a busy host lets it, so that others took longer.
    """
    following = (next((end for _, end in second if end > begin), math.inf) - begin for begin, _ in first)
    return min(following, default=math.inf)


@pytest.mark.parametrize("number", RS485_OF)
def test_direction_pin_moves_around_each_request(linux: Linux, board: Board, number: int) -> None:
    active = number != LOW
    uart, settings = Uart(linux.machine, number), RS485_OF[number]
    wanted = [settings.get(key, 0) for key in ("delay_before_ms", "delay_after_ms")]

    def delays() -> list[float]:
        seen = uart.watch(WATCHED_S)
        pin_on, pin_off = changes(seen, "rts_high", active), changes(seen, "rts_high", not active)
        begins, ends = changes(seen, "sending", True), changes(seen, "sending", False)
        return [quickest(pin_on, begins), quickest(ends, pin_off)]

    def are_as_wanted() -> bool:
        now = delays()
        assert all(delay >= least for delay, least in zip(now, wanted, strict=True)), f"sooner: {now}"
        return all(delay <= least + GRAIN_MS for delay, least in zip(now, wanted, strict=True))

    board.wait_for(are_as_wanted, PATIENCE_S, f"RTS moves {wanted} ms before and after a request")


def test_restart_sets_all_of_it_again(linux: Linux, board: Board) -> None:
    linux.run("/etc/init.d/S80rtud stop", PATIENCE_S)
    for number in RS485_OF:
        device = f"/dev/ttyS{number}"
        assert (
            linux.run(f"stty -F {device} 4800 icanon && serial-line rs485 {device} off") == f"{device} 0 0 0"
        )
    linux.run("/etc/init.d/S80rtud start")
    wait_all_read(board)
    check_in_force(linux)


@pytest.mark.parametrize("change", ["4800", "-parenb", "icanon"], ids=["speed", "parity", "mode"])
def test_another_program_changes_an_open_port(linux: Linux, board: Board, change: str) -> None:
    """Root may: within a second it is seen, and all of it is set anew."""

    def errors() -> int:
        return next(int(row["port_errors"]) for row in board.query("lines") if row["port"] == DELAYED)

    before = errors()
    linux.run(f"stty -F /dev/ttyS{DELAYED} {change}")
    board.wait_for(lambda: errors() > before, PATIENCE_S, "the change is seen")
    wait_all_read(board)
    check_in_force(linux)
    wait_logged(board, f"port {DELAYED}: /dev/ttyS{DELAYED} is lost: another program changed its settings; ")


def test_what_a_port_does_not_take_is_refused_with_a_message(linux: Linux, board: Board) -> None:
    linux.run(
        "/etc/init.d/S80rtud stop && mount -o remount,rw / && cp /refused.json /etc/openrtu/gateway.json",
        PATIENCE_S,
    )
    linux.run("flock /dev/ttyS6 sleep 100000 > /dev/null 2>&1 &")
    linux.run("/etc/init.d/S80rtud start")
    for number, (_, message) in REFUSED.items():
        wait_logged(board, rf"port {number}: /dev/{message}; trying again in 1 s")
    assert [line["open"] for line in board.query("lines")] == [False] * len(REFUSED)
    linux.run("pkill -f 'sleep 10000[0]'")
    wait_logged(board, f"port 5: /dev/ttyS6 is open, {BAUD} bit/s")
