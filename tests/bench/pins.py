# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`, second table: nuc980-pins beside dt-validate, each as a process of its own, by turns in one run.
What the rows mean: docs/bench.md. No time is asserted. Exit codes: 0 done, 1 a program failed.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PINS = "scripts/nuc980-pins"
DTS, DTB = "dts/nuvoton/nuc980-gateway.dts", "build/dtb/nuc980-gateway.dtb"
ROUNDS = 15

PROGRAMS = {
    "check of the DTB": [PINS, "check", DTB],
    "check of the source": [PINS, "check", DTS],
    "all generated files": [PINS, "generate", "--check"],
    "dt-validate of the DTB": [".venv/bin/dt-validate", "-s", "dts/bindings", DTB],
}
BESIDE = "dt-validate of the DTB"


def main() -> int:
    """Measures, and prints the table."""
    times: dict[str, list[float]] = {name: [] for name in PROGRAMS}
    for _ in range(ROUNDS):
        for name, command in PROGRAMS.items():
            begin = time.perf_counter()
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
            times[name].append(time.perf_counter() - begin)
            if done.returncode:
                print(f"{' '.join(command)}: exit {done.returncode}\n{done.stderr}", file=sys.stderr)
                return 1
    load = os.getloadavg()[0]
    print(f"\n> {os.cpu_count()} cores, load {load:.1f}. Median (minimum..maximum) of {ROUNDS}.\n")
    print(f"| process | seconds | of {BESIDE} |")
    print("|---|---|---|")
    beside = statistics.median(times[BESIDE])
    for name, values in times.items():
        middle = statistics.median(values)
        print(f"| {name} | {middle:.2f} ({min(values):.2f}..{max(values):.2f}) | {middle / beside:.2f} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
