# SPDX-License-Identifier: GPL-3.0-or-later
"""What is compared: our gateway and the project report's method, on a line of its chapter 5."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lab.gateway import REPOSITORY, Gateway, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim

CHAPTER_5 = REPOSITORY / "tests" / "fixtures" / "chapter5"
PORT = 3
UNIT = 67  # the device of figures 5.3 to 5.8
DEVICE = f"{PORT}.{UNIT}"
STATION = 1000 * PORT + UNIT
TABLES = ("coils", "discrete_inputs", "input_registers", "holding_registers")
BITS = ("coils", "discrete_inputs")
FIRST_IOA = {"coils": 1, "discrete_inputs": 10001, "input_registers": 30001, "holding_registers": 40001}
STOP_TIMEOUT_S = 5.0

OURS = "ours"
REPORT = "report's method"


class ContenderError(Exception):
    """A program that is measured did not start."""


def report_program() -> Path:
    """The program that `make bench` builds, or the one that OPENRTU_BENCH names."""
    return Path(os.environ.get("OPENRTU_BENCH", REPOSITORY / "build" / "bench" / "report_gateway"))


@dataclass(frozen=True)
class Line:
    """Port 3 of chapter 5 with another baud rate, and with some of its devices only."""

    baud: int
    units: tuple[int, ...]

    @property
    def stations(self) -> list[int]:
        """Common addresses of the devices."""
        return [1000 * PORT + unit for unit in self.units]

    def __str__(self) -> str:
        return f"{self.baud} bit/s, {len(self.units)} device{'s' if len(self.units) > 1 else ''}"

    def config(self) -> dict[str, Any]:
        """The configuration of chapter 5 with nothing but this line."""
        config = json.loads((CHAPTER_5 / "gateway.json").read_text())
        config["port"] = [port for port in config["port"] if port["value"] == PORT]
        port = config["port"][0]
        port["baud_rate"] = self.baud
        port["slaves"] = [slave for slave in port["slaves"] if slave["id"] in self.units]
        return config


def values_of_the_device() -> dict[str, list[int]]:
    """What device 67 holds at the start: per table, the values at its addresses from 0."""
    values = json.loads((CHAPTER_5 / "values.json").read_text())[DEVICE]
    return {table: [values[table][str(address)] for address in range(len(values[table]))] for table in TABLES}


@dataclass(frozen=True)
class Contender:
    """A running controlled station, and the simulated line behind it."""

    name: str
    lines: LineSim
    address: tuple[str, int]
    pids: dict[str, int]  # by process name


@contextlib.contextmanager
def running(name: str, line: Line) -> Iterator[Contender]:
    """Starts the line's devices and the contender of that name; ends both."""
    start = {OURS: _our_gateway, REPORT: _report_gateway}[name]
    with contextlib.ExitStack() as stack:
        directory = run_directory()
        stack.callback(remove, directory)
        config_file = directory / "linesim.json"
        config_file.write_text(json.dumps(line.config()))
        values = CHAPTER_5 / "values.json"
        lines = stack.enter_context(
            LineSim(config_file, _of(line, values, directory), directory / "dev", trace=False)
        )
        yield stack.enter_context(start(line, lines, directory))


def _of(line: Line, values: Path, directory: Path) -> Path:
    """The values of the line's devices alone: linesim refuses those of unknown ones."""
    names = {f"{PORT}.{unit}" for unit in line.units}
    chosen = {name: tables for name, tables in json.loads(values.read_text()).items() if name in names}
    file = directory / "values.json"
    file.write_text(json.dumps(chosen))
    return file


@contextlib.contextmanager
def _our_gateway(line: Line, lines: LineSim, directory: Path) -> Iterator[Contender]:
    with Gateway(listening_on(line.config(), free_port()), directory) as gateway:
        pids = {name: module["pid"] for name, module in gateway.modules().items() if module["pid"]}
        yield Contender(OURS, lines, gateway.address, pids)


@contextlib.contextmanager
def _report_gateway(line: Line, lines: LineSim, directory: Path) -> Iterator[Contender]:
    program = report_program()
    port = free_port()
    settings = line.config()["port"][0]
    stations = [
        ":".join(
            str(number) for number in (1000 * PORT + slave["id"], *(len(slave[table]) for table in TABLES))
        )
        for slave in settings["slaves"]
    ]
    device = lines.line(f"ttyS{PORT}")
    command = [program, device, str(line.baud), str(settings["stop_bits"]), str(port), *stations]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        if process.stdout.readline() != "ready\n":
            raise ContenderError(f"{program.name} did not start: exit code {process.wait()}")
        yield Contender(REPORT, lines, ("127.0.0.1", port), {program.name: process.pid})
    finally:
        process.terminate()
        process.wait(STOP_TIMEOUT_S)
