# SPDX-License-Identifier: GPL-3.0-or-later
"""rtuctl top on a gateway that polls: printed once, and drawn on a terminal with keys and sizes."""

import contextlib
import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import termios
import time
from collections.abc import Callable, Iterator

import pytest

from rig.desk import Desk

CSI = re.compile(r"\x1b\[[?0-9;]*[A-Za-z]")
PATIENCE = 30  # seconds


def rtuctl(desk: Desk, *words: str) -> list[str]:
    return [str(desk.gateway.build / "rtuctl/rtuctl"), "--map", str(desk.gateway.map), *words]


def once(desk: Desk, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        rtuctl(desk, "top", *words), capture_output=True, text=True, timeout=PATIENCE, check=False
    )


def rows(text: str, title: str) -> dict[str, list[str]]:
    """First word and the others of each line of the table with this title."""
    table = re.search(rf"^ *{title} .*\n((?:.+\n)*)", text, re.MULTILINE)
    assert table is not None, text
    return {words[0]: words[1:] for words in map(str.split, table[1].splitlines())}


def test_once_prints_modules_lines_and_points(desk: Desk) -> None:
    done = once(desk, "--once")
    assert (done.returncode, done.stderr) == (0, "")
    assert "\x1b" not in done.stdout
    modules = rows(done.stdout, "MODULE")
    assert set(modules) == {"rtud", "rtu-iec104", "rtu-modbus-1", "rtu-modbus-2"}
    assert re.match(r"(running|silent) +\d+ ms +\d+\.\d %", " ".join(modules["rtu-modbus-1"]))
    lines = rows(done.stdout, "PORT")
    assert set(lines) == set("123456")
    assert {row[1] for row in lines.values()} == {"yes"}
    assert sum(float(row[2]) for row in lines.values()) > 0
    points = rows(done.stdout, "POINT")
    assert points["p3.67.i0"][:3] == ["3067", "30001", "scaled"]
    assert len(points) == len(desk.gateway.points())


@pytest.mark.slow
def test_pattern_chooses_points_and_counts_them(desk: Desk) -> None:
    done = once(desk, "p3.67.*")  # no terminal: once
    counted = re.search(r"13 points of p3\.67\.\*: (\d+) good, (\d+) not", done.stdout)
    assert counted and int(counted[1]) + int(counted[2]) == 13  # a starved host makes some invalid
    assert {name[:6] for name in rows(done.stdout, "POINT")} == {"p3.67."}
    none = once(desk, "nothing*")
    assert (none.returncode, none.stdout) == (1, "")
    assert 'no point matches "nothing*"' in none.stderr


def test_addresses_are_columns_of_points(desk: Desk) -> None:
    shown = subprocess.run(
        rtuctl(desk, "points", "p3.67.c0"), capture_output=True, text=True, check=True
    ).stdout
    assert [line.split()[:4] for line in shown.splitlines()] == [
        ["NAME", "CA", "IOA", "TYPE"],
        ["p3.67.c0", "3067", "1", "single"],
    ]


@pytest.mark.parametrize("words", [["--json", "top"], ["points", "--once"], ["top", "a", "b"]])
def test_wrong_usage(desk: Desk, words: list[str]) -> None:
    assert subprocess.run(rtuctl(desk, *words), capture_output=True, check=False).returncode == 2


class Screen:
    """rtuctl top on a pty."""

    def __init__(self, command: list[str], size: tuple[int, int]) -> None:
        self.master, slave = pty.openpty()
        self.before = termios.tcgetattr(slave)
        self.slave = slave
        self.resize(*size)
        self.text = ""
        self.process = subprocess.Popen(
            command, stdin=slave, stdout=slave, env={**os.environ, "TERM": "xterm"}, start_new_session=True
        )

    def resize(self, height: int, width: int) -> None:
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, struct.pack("HHHH", height, width, 0, 0))

    def frame(self, wanted: Callable[[list[str]], bool]) -> list[str]:
        """The lines of the first whole frame from now on that is as wanted, without colours."""
        self.text = ""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            if select.select([self.master], [], [], 0.1)[0]:
                self.text += os.read(self.master, 65536).decode()
            for whole in re.findall(r"\x1b\[H(.*?)\x1b\[J", self.text, re.DOTALL):
                lines = CSI.sub("", whole).split("\r\n")
                if wanted(lines):
                    return lines
        pytest.fail(f"no such frame; the last: {self.text[-2000:]!r}")

    def press(self, keys: str) -> None:
        os.write(self.master, keys.encode())

    def rest(self) -> str:
        """What it writes until its end."""
        text = ""
        while self.process.poll() is None or select.select([self.master], [], [], 0)[0]:
            if select.select([self.master], [], [], 0.1)[0]:
                text += os.read(self.master, 65536).decode()
        return text


@pytest.fixture
def screen(desk: Desk) -> Iterator[Screen]:
    screen = Screen(rtuctl(desk, "top"), (24, 100))
    with contextlib.ExitStack() as stack:
        stack.callback(screen.process.wait)
        stack.callback(screen.process.kill)
        yield screen


def test_fits_the_terminal_and_follows_its_size(screen: Screen) -> None:
    lines = screen.frame(lambda lines: True)
    assert len(lines) == 24
    assert max(map(len, lines)) <= 100
    assert "\x1b[32mgood\x1b[0m" in screen.text
    screen.resize(30, 40)
    os.kill(screen.process.pid, signal.SIGWINCH)  # as a window does that the process is in the foreground of
    assert max(map(len, screen.frame(lambda lines: len(lines) == 30))) <= 40


def test_keys_move_filter_and_quit(screen: Screen) -> None:
    screen.frame(lambda lines: "points 1 to 6 of 109" in lines[-1])
    screen.press("\x1b[B")
    screen.frame(lambda lines: "points 2 to 7 of 109" in lines[-1])
    screen.press("\x1b[6~")
    screen.frame(lambda lines: "points 8 to 13 of 109" in lines[-1])
    screen.press("i")
    lines = screen.frame(lambda lines: "i all points" in lines[-1])
    assert not any(re.search(r" good +\d", line) for line in lines)
    screen.press("q")
    assert screen.rest().endswith("\x1b[?25h\x1b[?1049l")
    assert screen.process.returncode == 0
    assert termios.tcgetattr(screen.slave) == screen.before


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_the_terminal_as_it_was(screen: Screen, number: signal.Signals) -> None:
    screen.frame(lambda lines: True)
    screen.process.send_signal(number)
    assert screen.rest().endswith("\x1b[?25h\x1b[?1049l")
    assert termios.tcgetattr(screen.slave) == screen.before
