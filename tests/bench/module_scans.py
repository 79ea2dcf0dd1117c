# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: a scan of 100 inputs and 20 outputs, beside MatPLC's method, and what else a module waits for.
What the rows mean: docs/bench.md. No time is asserted. Exit codes: 0 done, 1 something did not work, 2 not
built.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from stopwatch import Spread

from bench import machine
from lab.errors import LabError
from lab.gateway import REPOSITORY, Gateway, default_build, free_port, listening_on, remove, run_directory
from lab.modules import compiled, place, program

HERE = REPOSITORY / "tests/bench"
WHOLE_COPY = REPOSITORY / "build/bench/whole_copy"
INPUTS, OUTPUTS = 100, 20
PERIOD_MS = 5
REGISTERS = 100  # of a device that only fills the map
INPUTS_A_DEVICE = 25
SIZES, QUICK = (500, 5000, 20000), (5000,)
READ_TIMEOUT_S = 120.0
EVENT_RING = 64  # the least

Readings = dict[str, list[float]]


def device(unit: int, named: range, count: int) -> dict[str, Any]:
    registers: list[dict[str, Any]] = [{"address": address} for address in range(count)]
    for register, number in zip(registers, named, strict=False):
        register["name"] = f"in-{number}"
    return {"id": unit, "input_registers": registers}


def devices(points: int) -> list[dict[str, Any]]:
    """The inputs belong to four devices; the others are nobody's business."""
    found = [
        device(1 + number, range(first, first + INPUTS_A_DEVICE), INPUTS_A_DEVICE)
        for number, first in enumerate(range(0, INPUTS, INPUTS_A_DEVICE))
    ]
    rest = points - INPUTS - OUTPUTS
    while rest > 0:
        found.append(device(1 + len(found), range(0), min(rest, REGISTERS)))
        rest -= REGISTERS
    return found


def configuration(points: int, path: str, net: bool) -> dict[str, Any]:
    line = {
        "value": 1, "active": 1, "baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0,
        "slaves": devices(points),
    }  # fmt: skip
    module = {
        "name": "scanner",
        "program": path,
        "period_ms": PERIOD_MS,
        "heartbeat_limit_ms": 5000,
        "ca": 65000,
        "points": [
            {"name": f"out-{number}", "type": "float", "ioa": 1 + number} for number in range(OUTPUTS)
        ],
        "reads": ["in-*"],
    }
    config = {"port": [line], "modules": [module], "event_ring": EVENT_RING}
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


def measured(points: int, script: Path, net: bool = False) -> tuple[Readings, float]:
    """What the module says of itself; KiB of the map."""
    directory = run_directory()
    try:
        place(directory, default_build())
        make = compiled if script.suffix == ".c" else program
        config = configuration(points, make(directory, "scanner", script), net)
        with Gateway(config, directory) as gateway:
            said = gateway.log_file
            gateway.wait_for(
                lambda: "BENCH end" in said.read_text(errors="replace"),
                READ_TIMEOUT_S,
                "it has measured",
            )
            size = sum(file.stat().st_size for file in (directory / "map").iterdir() if file.is_file())
            return readings_of(said.read_text(errors="replace")), size / 1024
    finally:
        remove(directory)


def copied(points: int) -> Readings:
    done = subprocess.run(
        [WHOLE_COPY, str(points), str(PERIOD_MS)], capture_output=True, text=True, check=True, env=os.environ
    )
    return readings_of(done.stdout)


def rows(sizes: tuple[int, ...]) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for points in sizes:
        readings, size = measured(points, HERE / "scan_module.c")
        method = copied(points)
        for name, text in (("scan", "a scan each 5 ms"), ("row", "scans in a row")):
            theirs, ours = Spread("µs", method[name]), Spread("µs", readings[name])
            found += [
                (f"{text}, {points} points: whole copy under one semaphore", str(theirs)),
                (f"{text}, {points} points: ours, in C", f"{ours}, {ours.middle / theirs.middle:.2f} of it"),
            ]
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
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures what a scan costs a module.")
    parser.add_argument("--quick", action="store_true", help="one size of the map")
    sizes = QUICK if parser.parse_args().quick else SIZES
    missing = [file for file in (default_build() / "rtud" / "rtud", WHOLE_COPY) if not file.exists()]
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
    print(f"\n{machine()}. Median (minimum..maximum); processor time of scans.\n\n| a module | |\n|---|---|")
    for text, value in found:
        print(f"| {text} | {value} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
