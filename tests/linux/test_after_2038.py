# SPDX-License-Identifier: GPL-3.0-or-later
"""The board in 2040, when 32 bits of seconds are over: clock, time tags, journal, log, the way in."""

import contextlib
import json
import re
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from lab.board import ETHERNET, SILENCE_US, SSH_PORT, STATION_PORT, Board, Ssh, lines_at
from lab.gateway import GatewayError
from lab.linesim import LineSim
from lab.raw_master import RawMaster
from nuc980.twin.linux import Linux
from nuc980.twin.machine import INSTRUCTION_TIME
from rig.desk import chapter_5, everything_read, of_port

VALUES = Path(__file__).resolve().parents[1] / "fixtures/chapter5/values.json"
BEGIN = datetime(2040, 2, 28, 23, 0, tzinfo=UTC)
PATIENCE_S = 300.0  # a busy host
A_TEST = timedelta(hours=1)
PORT, DEVICE, STATION, IOA, VALUE = 3, "3.67", 3067, 30002, 2040
C_CS, ACT_CON = 103, 7


def configuration() -> dict[str, Any]:
    """One device, and a journal that keeps its events."""
    config = chapter_5()
    line = of_port(config, PORT)
    line["slaves"] = [slave | {"retries": 5} for slave in line["slaves"] if slave["id"] == STATION % 1000]
    return config | {
        "port": [line],
        "iec104": {"port": STATION_PORT},
        "journal": {"path": "/data/journal", "interval_s": 1, "volume_mb": 1048576},
    }


@pytest.fixture(scope="module")
def lines(folder: Path, linesim_program: Path) -> Iterator[LineSim]:
    file = folder / "linesim.json"
    file.write_text(json.dumps(chapter_5()))
    with LineSim(file, VALUES, folder / "dev", silence_us=SILENCE_US, program=linesim_program) as lines:
        yield lines


@pytest.fixture(scope="module")
def board_arguments(port: int, ssh: Ssh) -> tuple[str | Path, ...]:
    return (*INSTRUCTION_TIME, *ETHERNET[0].arguments({port: STATION_PORT, ssh.port: SSH_PORT}))


@pytest.fixture(scope="module")
def board_chardevs(lines: LineSim) -> dict[int, str]:
    return lines_at(lines.directory)


@pytest.fixture(scope="module")
def extra_files(ssh: Ssh) -> dict[str, Path | str]:
    return {
        "/etc/openrtu/gateway.json": json.dumps(configuration()),
        "/root/.ssh/authorized_keys": ssh.key.with_suffix(".pub"),
    }


@pytest.fixture(scope="module")
def board(linux: Linux, ssh: Ssh, port: int) -> Board:
    """In 2040, from before its gateway started."""
    linux.run("/etc/init.d/S80rtud stop")
    linux.run(f"date -u -s '{BEGIN:%Y-%m-%d %H:%M:%S}'")
    linux.run("/etc/init.d/S80rtud start")
    board = Board(linux.machine, ssh.run, ("127.0.0.1", port))
    board.wait_for(ssh.answers, PATIENCE_S, "ssh lets its engineer in")
    return board


def assert_now(when: datetime) -> None:
    assert BEGIN <= when <= BEGIN + A_TEST


def test_system_knows_the_year(linux: Linux, board: Board) -> None:
    assert_now(datetime.fromtimestamp(int(linux.run("date +%s")), UTC))
    linux.run("touch /tmp/made")
    assert linux.run("stat -c %y /tmp/made").startswith("2040-02-2")


def test_log_goes_on(linux: Linux, board: Board) -> None:
    linux.run("logger -t year 'it is 2040'")
    assert re.search(r"^Feb 2[89] .* year: it is 2040$", linux.run("cat /var/log/messages"), re.MULTILINE)


def test_ssh_lets_in_a_new_session(board: Board, ssh: Ssh) -> None:
    ssh.close()
    assert_now(datetime.fromtimestamp(int(ssh.run("date +%s")), UTC))


def set_clock(master: RawMaster, when: datetime) -> None:
    """By the controlling station. Seconds, minutes, hours, day, month, year: CP56Time2a."""
    milliseconds = when.second * 1000 + when.microsecond // 1000
    date = bytes((when.minute, when.hour, when.day, when.month, when.year % 100))
    master.request(C_CS, STATION, 0, milliseconds.to_bytes(2, "little") + date)
    assert master.answer(C_CS).cause == ACT_CON


def test_unheard_event_comes_out_of_the_journal_with_its_time(
    linux: Linux, board: Board, lines: LineSim
) -> None:
    """A change that no master hears, all of the gateway anew, and then the master comes back."""
    wait_read(board)
    with RawMaster(*board.address) as master:
        set_clock(master, BEGIN + A_TEST / 2)
        master.interrogate(STATION)
    before = waiting(board)
    lines.set(DEVICE, "input_registers", 1, VALUE)
    board.wait_for(lambda: waiting(board) > before, PATIENCE_S, "the journal has the event")
    linux.run("/etc/init.d/S80rtud restart")
    wait_read(board)
    with RawMaster(*board.address) as master:
        deadline = time.monotonic() + PATIENCE_S
        while not (events := [o for o in master.spontaneous(deadline) if o.value == VALUE]):
            pass
    (event,) = events
    assert (event.ca, event.ioa) == (STATION, IOA)
    assert event.recorded_at is not None
    assert_now(event.recorded_at)


def wait_read(board: Board) -> None:
    def read() -> bool:
        with contextlib.suppress(GatewayError):
            return everything_read(board)
        return False

    board.wait_for(read, PATIENCE_S, "the device is read")


def waiting(board: Board) -> int:
    """Events in the journal that no master has acknowledged."""
    events: int = board.modules()["rtu-journal"]["journal"]["events"]
    return events
