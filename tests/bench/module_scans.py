# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: a scan of 100 inputs and 20 outputs, beside MatPLC's method, here and on the board's core; and
what else a module waits for. What the rows mean: docs/bench.md. No time is asserted. Exit codes: 0 done, 1
something did not work, 2 not built.
"""

from __future__ import annotations

import argparse
import os
import re
import statistics
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from emulated import PLUGIN_API, build_plugin
from logic_scans import ARM
from stopwatch import Spread

from bench import machine
from lab.errors import LabError
from lab.gateway import REPOSITORY, Gateway, default_build, free_port, listening_on, remove, run_directory
from lab.modules import compiled, place, program

HERE = REPOSITORY / "tests/bench"
SOURCE = REPOSITORY / "package/openrtu/src"
WHOLE_COPY = REPOSITORY / "build/bench/whole_copy"
INPUTS, OUTPUTS = 100, 20
PERIOD_MS = 5
REGISTERS = 100  # of a device that only fills the map
INPUTS_A_DEVICE = 25
SIZES, QUICK = (500, 5000, 20000), (5000,)
FIRST_CA = 65000
HEARTBEAT_LIMIT_MS = 5000
READ_TIMEOUT_S = 120.0
EVENT_RING = 64  # the least
OPTIONS = ["-Os", "-std=gnu11", "-D_GNU_SOURCE", "-D_TIME_BITS=64", "-D_FILE_OFFSET_BITS=64"]
LIBRARY = ("commands", "events", "openrtu", "requests", "scan", "synch", "values")
OF_THE_LIBRARY = ("process/commanding", "process/stop", "synch/synched", "synch/net")

Readings = dict[str, list[float]]
Counts = dict[str, float]


def device(unit: int, named: range, count: int) -> dict[str, Any]:
    registers: list[dict[str, Any]] = [{"address": address} for address in range(count)]
    for register, number in zip(registers, named, strict=False):
        register["name"] = f"in-{number}"
    return {"id": unit, "input_registers": registers}


def parts_of_inputs() -> list[range]:
    return [range(first, first + INPUTS_A_DEVICE) for first in range(0, INPUTS, INPUTS_A_DEVICE)]


def others(points: int) -> list[dict[str, Any]]:
    """Devices of points that are nobody's business."""
    rest = points - INPUTS - OUTPUTS
    first = 1 + len(parts_of_inputs())
    return [
        device(unit, range(0), min(REGISTERS, rest - done))
        for unit, done in enumerate(range(0, rest, REGISTERS), first)
    ]


def module(name: str, path: str, ca: int, points: str, numbers: range) -> dict[str, Any]:
    return {
        "name": name,
        "program": path,
        "period_ms": PERIOD_MS,
        "heartbeat_limit_ms": HEARTBEAT_LIMIT_MS,
        "ca": ca,
        "points": [
            {"name": f"{points}-{number}", "type": "float", "ioa": ioa}
            for ioa, number in enumerate(numbers, 1)
        ],
    }


def configuration(points: int, path: str, net: bool = False, source: str = "") -> dict[str, Any]:
    """The inputs belong to four devices that do not answer, or to four modules that run source."""
    line = {
        "value": 1, "active": 1, "baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0,
        "slaves": others(points),
    }  # fmt: skip
    modules = [module("scanner", path, FIRST_CA, "out", range(OUTPUTS)) | {"reads": ["in-*"]}]
    for number, inputs in enumerate(parts_of_inputs(), 1):
        if source:
            modules.append(module(f"source-{number}", source, FIRST_CA + number, "in", inputs))
        else:
            line["slaves"].append(device(number, inputs, INPUTS_A_DEVICE))
    config = {"port": [line], "modules": modules, "event_ring": EVENT_RING}
    if net:
        config["net"] = {
            "transitions": ["T"],
            "modules": [{"name": "scanner", "points": [{"name": "fire", "transition": "T"}]}],
        }
    return listening_on(config, free_port())


def readings_of(text: str) -> Readings:
    found: Readings = {}
    for name, ns in re.findall(r"^BENCH (\w+) (\d+)$", text, re.MULTILINE):
        found.setdefault(name, []).append(int(ns) / 1000)
    return found


@contextmanager
def folder() -> Iterator[Path]:
    directory = run_directory()
    try:
        place(directory, default_build())
        yield directory
    finally:
        remove(directory)


def measured(points: int, script: Path, net: bool = False, changing: bool = False) -> tuple[Readings, float]:
    """What the module says of itself; KiB of the map."""
    with folder() as directory:
        make = compiled if script.suffix == ".c" else program
        source = compiled(directory, "source", HERE / "scan_source.c") if changing else ""
        config = configuration(points, make(directory, "scanner", script), net, source)
        with Gateway(config, directory) as gateway:
            log = gateway.log_file
            gateway.wait_for(
                lambda: "BENCH end" in log.read_text(errors="replace"),
                READ_TIMEOUT_S,
                "it has measured",
            )
            size = sum(file.stat().st_size for file in (directory / "map").iterdir() if file.is_file())
            return readings_of(log.read_text(errors="replace")), size / 1024


def copied(points: int) -> Readings:
    done = subprocess.run(
        [WHOLE_COPY, str(points), str(PERIOD_MS)], capture_output=True, text=True, check=True, env=os.environ
    )
    return readings_of(done.stdout)


# ---- on the board's core ---------------------------------------------------------------------------


def counts_of(text: str) -> Counts:
    found: Readings = {}
    for name, count in re.findall(r"^COUNT (\w+) (\d+)$", text, re.MULTILINE):
        found.setdefault(name, []).append(float(count))
    return {name: statistics.median(counts) for name, counts in found.items()}


class Core:
    """Programs as the board's core runs them, under QEMU, which counts."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.plugin = directory / "count.so"
        self.file = directory / "counts"
        self.file.touch()
        build_plugin(self.plugin, "count_memory.c")

    def built(self, name: str, *sources: Path) -> list[str]:
        path = self.directory / f"{name}-arm"
        defines = [f'-DCOUNTS="{self.file}"', '-DOPENRTU_VERSION="bench"']
        include = [f"-I{SOURCE}", f"-I{SOURCE}/lib"]
        subprocess.run([*ARM, *OPTIONS, *defines, *include, "-o", path, *sources, "-lm"], check=True)
        return ["qemu-arm", "-cpu", "arm926", "-plugin", f"{self.plugin},count={self.file}", str(path)]

    def whole_copy(self, points: int) -> Counts:
        words = [*self.built("copy", HERE / "whole_copy.c"), str(points), str(PERIOD_MS)]
        return counts_of(subprocess.run(words, capture_output=True, text=True, check=True).stderr)

    def module(self) -> list[str]:
        maps = {file for file in (SOURCE / "map").glob("*.c") if not file.name.startswith(("test_", "fuzz_"))}
        library = [SOURCE / "lib" / f"{name}.c" for name in LIBRARY]
        library += [SOURCE / f"{name}.c" for name in OF_THE_LIBRARY]
        return self.built("scanner", HERE / "scan_module.c", *library, *maps)


def counted(points: int, changing: bool) -> Counts:
    """rtud limits a module's memory to less than QEMU takes: so it starts a stand-in, and this the module."""
    with folder() as directory:
        words = Core(directory).module()
        stand_in = directory / "stand-in"
        stand_in.write_text("#!/bin/sh\nexec sleep 1000\n")
        stand_in.chmod(0o755)
        source = compiled(directory, "source", HERE / "scan_source.c") if changing else ""
        words += ["--map", str(directory / "map"), "--module", "scanner"]
        with (
            Gateway(configuration(points, str(stand_in), source=source), directory),
            subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as scanner,
        ):
            assert scanner.stderr is not None
            output = ""
            for line in scanner.stderr:
                output += line
                if line.startswith("BENCH end"):
                    break
            scanner.terminate()
            return counts_of(output)


def counted_rows(sizes: tuple[int, ...]) -> Iterator[tuple[str, str]]:
    for points in sizes:
        with folder() as directory:
            method = Core(directory).whole_copy(points)
        found = {
            "whole copy under one semaphore": method,
            "ours, no input changes": counted(points, changing=False),
            "ours, all inputs change": counted(points, changing=True),
        }
        for text, counts in found.items():
            of_it = f", {counts['octets'] / method['octets']:.2f} of it" if counts is not method else ""
            yield (
                f"ARM926, a scan each 5 ms, {points} points: {text}",
                f"{counts['instructions']:.0f} instructions, {counts['calls']:.0f} system calls, "
                f"{counts['octets'] / 1024:.1f} KiB to and from memory{of_it}",
            )
        print(f"  {points} points, counted", file=sys.stderr, flush=True)


# ---- rows ------------------------------------------------------------------------------------------


def rows(sizes: tuple[int, ...]) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for points in sizes:
        method = copied(points)
        if not found:
            found.append(("a wake-up each 5 ms, without a scan", str(Spread("µs", method["wake"]))))
        readings, size = measured(points, HERE / "scan_module.c")
        changing, _ = measured(points, HERE / "scan_module.c", changing=True)
        for name, text in (("scan", "a scan each 5 ms"), ("row", "scans in a row")):
            theirs = Spread("µs", method[name])
            found.append((f"{text}, {points} points: whole copy under one semaphore", str(theirs)))
            for what, of_ours in (("no input changes", readings), ("all inputs change each 5 ms", changing)):
                ours = Spread("µs", of_ours[name])
                of_it = f"{ours.middle / theirs.middle:.2f} of it"
                found.append((f"{text}, {points} points: ours, in C, {what}", f"{ours}, {of_it}"))
        found += [
            (f"attach, to {points} points", str(Spread("µs", readings["attach"]))),
            (f"the map of {points} points, with {EVENT_RING} events a module", f"{size:.0f} KiB"),
        ]
        print(f"  {points} points", file=sys.stderr, flush=True)
    readings, _ = measured(sizes[-1], HERE / "scan_module.py")
    found.append(
        (f"a scan each 5 ms, {sizes[-1]} points: ours, in Python", str(Spread("µs", readings["scan"])))
    )
    readings, _ = measured(sizes[0], HERE / "scan_module.c", net=True)
    found.append(("a firing of the net: round trip to rtu-synch", str(Spread("µs", readings["firing"]))))
    found += counted_rows(sizes)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures what a scan costs a module.")
    parser.add_argument("--quick", action="store_true", help="one size of the map")
    sizes = QUICK if parser.parse_args().quick else SIZES
    wanted = (default_build() / "rtud" / "rtud", WHOLE_COPY, PLUGIN_API / "qemu-plugin.h")
    missing = [file for file in wanted if not file.exists()]
    if missing:
        print(
            f"not built: {', '.join(map(str, missing))}; type `make bench`, which builds it", file=sys.stderr
        )
        return 2
    try:
        found = rows(sizes)
    except (LabError, OSError, KeyError, subprocess.SubprocessError) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1
    head = f"{machine()}. Median (minimum..maximum); processor time of scans; of counts the median."
    print(f"\n{head}\n\n| a module | |\n|---|---|")
    for text, value in found:
        print(f"| {text} | {value} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
