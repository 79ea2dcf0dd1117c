# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: a reload of 5 000 points on two lines, of which one changes. What the rows mean:
docs/bench.md. No time is asserted. Exit codes: 0 done, 1 something did not work, 2 not built.
"""

from __future__ import annotations

import argparse
import copy
import json
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

from stopwatch import Spread

from bench import machine
from lab.gateway import Gateway, GatewayError, default_build, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim, LineSimError, default_program

STEADY, CHANGED = 1, 2  # ports
UNITS = range(1, 26)
REGISTERS = 100  # of a device
NEW_UNIT = 100
BAUD = 115200
READ_TIMEOUT_S = 60.0
BEFORE_S = 2.0  # as long as a reload, to compare with
RELOADS, QUICK = 6, 2
FRAMES_LEAST = 10  # in that time


def device(unit: int) -> dict[str, Any]:
    registers = [{"address": address} for address in range(REGISTERS)]
    return {"id": unit, "input_registers": registers, "response_timeout_ms": 500}


def line(port: int) -> dict[str, Any]:
    settings = {"value": port, "active": 1, "baud_rate": BAUD, "data_bits": 8, "stop_bits": 1, "parity": 0}
    return settings | {"process": port, "slaves": [device(unit) for unit in UNITS]}


def with_newcomer(config: dict[str, Any]) -> dict[str, Any]:
    changed = copy.deepcopy(config)
    changed["port"][1]["slaves"].append(device(NEW_UNIT))
    return changed


def longest_pause_ms(lines: LineSim, port: int, kind: str, since: int) -> float:
    """Between two frames of a line: "received", it was asked, or "sent", it has answered."""
    times = [f.monotonic_ns for f in lines.frames(since) if (f.port, f.kind) == (port, kind)]
    if len(times) < FRAMES_LEAST:
        raise LineSimError(f"port {port}: only {len(times)} frames were seen: the machine is too busy")
    return max(later - earlier for earlier, later in pairwise(times)) / 1e6


def everything_read(gateway: Gateway) -> bool:
    return all(point["quality"] == "good" for point in gateway.points().values())


def measure(lines: LineSim, gateway: Gateway, files: list[Path], reloads: int) -> dict[str, Spread]:
    found: dict[str, list[float]] = {}

    def note(text: str, value: float) -> None:
        found.setdefault(text, []).append(value)

    for number in range(reloads):
        gateway.wait_for(lambda: everything_read(gateway), READ_TIMEOUT_S, "every device has been read")
        mark = lines.mark()
        time.sleep(BEFORE_S)  # the time that is measured
        note(
            "unchanged line: longest pause between polls, before",
            longest_pause_ms(lines, STEADY, "received", mark),
        )
        note(
            "changed line: longest time without an answer, before",
            longest_pause_ms(lines, CHANGED, "sent", mark),
        )
        mark, begun = lines.mark(), time.monotonic()
        gateway.ctl("reload", str(files[number % 2]))
        note("the reload, with one second of proof", 1000 * (time.monotonic() - begun))
        note(
            "unchanged line: longest pause between polls, during",
            longest_pause_ms(lines, STEADY, "received", mark),
        )
        note(
            "changed line: longest time without an answer, during",
            longest_pause_ms(lines, CHANGED, "sent", mark),
        )
        print(f"  {number + 1} of {reloads} reloads", file=sys.stderr, flush=True)
    return {text: Spread("ms", values) for text, values in sorted(found.items())}


def run(reloads: int) -> dict[str, Spread]:
    directory = run_directory()
    small = listening_on({"port": [line(STEADY), line(CHANGED)]}, free_port())
    large = with_newcomer(small)
    files = [directory / "large.json", directory / "small.json"]
    files[0].write_text(json.dumps(large))
    files[1].write_text(json.dumps(small))
    values = directory / "values.json"
    values.write_text("{}")
    try:
        with LineSim(files[0], values, directory / "dev") as lines, Gateway(small, directory) as gateway:
            return measure(lines, gateway, files, reloads)
    finally:
        remove(directory)


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures what a reload does to the lines.")
    parser.add_argument("--quick", action="store_true", help="a try of some ten seconds")
    reloads = QUICK if parser.parse_args().quick else RELOADS
    missing = [file for file in (default_build() / "rtud" / "rtud", default_program()) if not file.exists()]
    if missing:
        print(
            f"not built: {', '.join(map(str, missing))}; type `make bench`, which builds it", file=sys.stderr
        )
        return 2
    head = (
        f"{machine()}. Median (minimum..maximum) of {reloads} reloads of {2 * len(UNITS) * REGISTERS} points."
    )
    try:
        found = run(reloads)
    except (GatewayError, LineSimError, OSError, subprocess.SubprocessError) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1
    print(f"\n{head}\n\n| while the configuration changes | |\n|---|---|")
    for text, spread in found.items():
        print(f"| {text} | {spread} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
