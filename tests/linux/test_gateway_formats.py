# SPDX-License-Identifier: GPL-3.0-or-later
"""The gateway at the six lines of the emulated board.

Each format at each speed, devices of another format, and how punctual it is.
"""

import contextlib
import itertools
import json
import os
import re
import termios
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from uarts import Uart

from lab.board import PORTS, SILENCE_US, Board, lines_at
from lab.gateway import GatewayError, remove, run_directory
from lab.linesim import LineSim
from lab.show import RESPONSE_MS
from nuc980.twin.linux import Linux

FORMATS = ("8N1", "8N2", "8E1", "8E2", "8O1", "8O2")
SPEEDS = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800)
TERMIOS_SPEEDS = {getattr(termios, f"B{speed}"): speed for speed in SPEEDS}
TURNS = range(len(SPEEDS))
SPEED_TOLERANCE = 0.005
REGISTERS = 4
CONFIG = "etc/openrtu/gateway.json"
PATIENCE_S = 300.0  # a busy host
ALL_TO_COME = 0xFFFFFFFF  # characters
SPOILED = ("crc_errors", "noise_bytes", "wrong_answers")  # what a line counts of an answer that is none


def combinations(turn: int) -> dict[int, tuple[int, str]]:
    """Of each port speed and format."""
    of_ports = {}
    for port, at in enumerate(range(turn, turn + len(PORTS)), start=1):
        form = at % len(FORMATS)
        of_ports[port] = (SPEEDS[(turn + form) % len(SPEEDS)], FORMATS[form])
    return of_ports


def port_with(port: int, speed: int, form: str) -> dict[str, Any]:
    """A port of the configuration, with one device: its address is the port's number."""
    registers = [{"address": address} for address in range(REGISTERS)]
    return {
        "value": port,
        "active": 1,
        "baud_rate": speed,
        "data_bits": int(form[0]),
        "parity": "NOE".index(form[1]),
        "stop_bits": int(form[2]),
        "slaves": [{"id": port, "response_timeout_ms": RESPONSE_MS, "holding_registers": registers}],
    }


def configuration(of_ports: dict[int, tuple[int, str]]) -> str:
    return json.dumps({"port": [port_with(port, *settings) for port, settings in of_ports.items()]})


def registers(port: int) -> list[int]:
    """What a port's device has: bits of every kind."""
    return [0x1234 * port + 0x0F0F * address & 0x7FFF for address in range(REGISTERS)]


@dataclass(frozen=True)
class Bench:
    linux: Linux
    lines: LineSim
    board: Board

    def start_with(self, turn: int) -> None:
        """The gateway anew, with another configuration; returns when every device has been read."""
        self.linux.run(
            f"mount -o remount,rw / && mkdir -p /etc/openrtu && cp /turn{turn}.json /{CONFIG} &&"
            "/etc/init.d/S80rtud restart",
            PATIENCE_S,
        )

        wanted = [f"{speed} {form}" for speed, form in combinations(turn).values()]

        def all_good() -> bool:
            with contextlib.suppress(GatewayError):
                formats = [line["format"] for line in self.board.query("lines")]
                return formats == wanted and self.values() == {n: registers(n) for n in combinations(turn)}
            return False

        self.board.wait_for(all_good, PATIENCE_S, "every device has been read")

    def values(self) -> dict[int, list[int]]:
        """The good ones, by port."""
        good: dict[int, list[int]] = {port: [] for port in range(1, len(PORTS) + 1)}
        for point in self.board.points().values():
            if point["quality"] == "good":
                good[point["ca"] // 1000].append(int(point["value"]))
        return good

    def line(self, port: int) -> dict[str, int]:
        """Its counters."""
        return next(line for line in self.board.query("lines") if line["port"] == port)

    def pty(self, port: int) -> tuple[int, int]:
        """What QEMU has set the line's pty to, speed and stop bits; it carries no parity."""
        pty = os.open(self.lines.line(f"ttyS{PORTS[port - 1]}"), os.O_RDONLY | os.O_NOCTTY)
        try:
            settings = termios.tcgetattr(pty)
        finally:
            os.close(pty)
        return TERMIOS_SPEEDS[settings[5]], 2 if settings[2] & termios.CSTOPB else 1

    def errors(self, kind: str) -> dict[int, int]:
        """What the kernel has counted, by port: pe of parity, fe of framing, since the board's start."""
        found = {}
        for uart, counts in re.findall(
            r"^(\d+): (.*)$", self.linux.run("cat /proc/tty/driver/*"), re.MULTILINE
        ):
            count = re.search(rf" {kind}:(\d+)", counts)
            if int(uart) in PORTS:
                found[PORTS.index(int(uart)) + 1] = int(count[1]) if count else 0
        return found


@pytest.fixture(scope="module")
def lines(linesim_program: Path) -> Iterator[LineSim]:
    """Devices that speak at the highest speed, whatever the gateway does: a pty has none of its own."""
    folder = run_directory()
    ports = range(1, len(PORTS) + 1)
    (folder / "config.json").write_text(configuration(dict.fromkeys(ports, (SPEEDS[-1], "8N1"))))
    values = {
        f"{port}.{port}": {"holding_registers": {str(a): value for a, value in enumerate(registers(port))}}
        for port in ports
    }
    (folder / "values.json").write_text(json.dumps(values))
    with LineSim(
        folder / "config.json",
        folder / "values.json",
        folder / "dev",
        silence_us=SILENCE_US,
        program=linesim_program,
    ) as lines:
        yield lines
    remove(folder)


@pytest.fixture(scope="module")
def board_chardevs(lines: LineSim) -> dict[int, str]:
    return lines_at(lines.directory)


@pytest.fixture(scope="module")
def extra_files() -> dict[str, Path | str]:
    return {f"turn{turn}.json": configuration(combinations(turn)) for turn in TURNS}


@pytest.fixture(scope="module")
def bench(linux: Linux, lines: LineSim) -> Bench:
    """What rtuctl says besides would be on the console too, between what it prints."""
    board = Board(linux.machine, lambda command: linux.run(f"{command} 2> /dev/null"), ("", 0))
    return Bench(linux, lines, board)


def test_each_format_meets_each_speed() -> None:
    met = [settings for turn in TURNS for settings in combinations(turn).values()]
    assert sorted(met) == sorted(itertools.product(SPEEDS, FORMATS))


@pytest.mark.parametrize("turn", TURNS)
def test_six_lines_at_all_formats_and_speeds(bench: Bench, turn: int) -> None:
    bench.start_with(turn)
    for port, (speed, form) in combinations(turn).items():
        uart = Uart(bench.linux.machine, PORTS[port - 1])
        assert (uart.format, uart.speed) == (form, pytest.approx(speed, rel=SPEED_TOLERANCE)), f"port {port}"
        assert bench.pty(port) == (speed, int(form[2])), f"port {port}"
    for kind in ("pe", "fe"):
        assert not any(bench.errors(kind).values()), kind


@pytest.mark.parametrize(
    ("port", "what", "kind"), [(3, "inject-parity-errors", "pe"), (1, "inject-framing-errors", "fe")]
)
def test_device_of_another_format_is_not_good(bench: Bench, port: int, what: str, kind: str) -> None:
    """Each of its characters comes with an error."""
    bench.start_with(0)
    characters = f"qom-set /machine/soc/uart[{PORTS[port - 1]}] {what}"
    errors, before = bench.errors(kind), bench.line(port)
    bench.linux.machine.monitor(f"{characters} {ALL_TO_COME}")
    bench.board.wait_for(lambda: bench.values()[port] == [], PATIENCE_S, "its values are not good")
    # They may be so because a slow board asks too late for them: before its answers are wrong.
    bench.board.wait_for(
        lambda: bench.line(port)["timeouts"] > before["timeouts"], PATIENCE_S, "no answer is taken for one"
    )
    bench.linux.machine.monitor(f"{characters} 0")
    counted = {n for n, count in bench.errors(kind).items() if count > errors[n]}
    assert counted == {port}
    now = bench.line(port)
    assert any(now[name] > before[name] for name in SPOILED)
    bench.board.wait_for(lambda: bench.values()[port] == registers(port), PATIENCE_S, "it is good again")


def test_lines_are_served_in_real_time(bench: Bench) -> None:
    """PREEMPT_RT, SCHED_FIFO, locked memory: what the verdict speaks of. How late it is says nothing here."""
    process = bench.linux.run("pidof rtu-modbus-1").strip()
    policy = bench.linux.run(f"chrt -p {process}")
    assert "SCHED_FIFO" in policy
    assert re.search(r"priority: 45$", policy, re.MULTILINE)
    locked = re.search(r"^VmLck:\s+(\d+) kB$", bench.linux.run(f"cat /proc/{process}/status"), re.MULTILINE)
    assert locked
    assert int(locked[1]) > 0
    histograms = bench.board.query("lines", "--histogram")
    assert len(histograms) == len(PORTS)
    for histogram in histograms:
        assert histogram["realtime_kernel"]
        assert "not PREEMPT_RT" not in histogram["verdict"]
        assert sum(histogram["wakeups"]["counts"]) > 0
        assert sum(histogram["transactions"]["counts"]) > 0
