# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests have reached of each room, against the floors of coverage.toml: `make coverage`.

The parts of C are folders of package/openrtu/src, a module each; those of Python are the folders that
pyproject.toml names. gcovr counts for C, coverage.py for Python; both count lines, and of each branch both
ways. Exit code 1: a room is below its floor, or has none.
"""

import json
import math
import subprocess
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "package/openrtu/src"
BUILD = ROOT / "build/coverage"
FLOORS = Path(__file__).with_name("coverage.toml")
WHAT = ("lines", "branches")
# In Python a room is what is as deep as this below the tree's root.
DEPTHS = {"centre": 1, "scripts/image": 2, "scripts/nuc980": 3, "scripts/openrtu_tools": 3}


@dataclass
class Count:
    """Of lines and branches: those that were reached, and all."""

    lines: int = 0
    all_lines: int = 0
    branches: int = 0
    all_branches: int = 0

    def add(self, lines: int, all_lines: int, branches: int, all_branches: int) -> None:
        self.lines += lines
        self.all_lines += all_lines
        self.branches += branches
        self.all_branches += all_branches

    @property
    def percent(self) -> tuple[float, float]:
        return share(self.lines, self.all_lines), share(self.branches, self.all_branches)


def share(reached: int, there: int) -> float:
    return 100 * reached / there if there else 100.0


def room_of_c(name: str) -> str:
    """The folder; of the programs, each has its own."""
    return name.rpartition("/")[0]


def room_of_python(name: str) -> str:
    depth = next(depth for folder, depth in DEPTHS.items() if name.startswith(folder))
    return "/".join(Path(name).parent.parts[:depth])


def told_by(command: list[str | Path], report: Path) -> dict[str, object]:
    subprocess.run(command, cwd=ROOT, check=True)
    told: dict[str, object] = json.loads(report.read_text())
    return told


def rooms() -> dict[str, Count]:
    counts: dict[str, Count] = defaultdict(Count)
    c, python = BUILD / "c.json", BUILD / "python.json"
    counting = ["gcovr", "-j", "2", "--root", SOURCE, "--object-directory", BUILD, BUILD]
    without = ["--exclude", r".*/test_[^/]*", "--exclude", r".*/fuzz_[^/]*"]
    for file in told_by([*counting, *without, "--json-summary", c], c)["files"]:
        counts[room_of_c(file["filename"])].add(
            file["line_covered"], file["line_total"], file["branch_covered"], file["branch_total"]
        )
    coverage = [sys.executable, "-m", "coverage"]
    subprocess.run([*coverage, "combine", "--keep", "--quiet"], cwd=ROOT, check=True)
    for name, file in told_by([*coverage, "json", "--quiet", "-o", python], python)["files"].items():
        found = file["summary"]
        counts[room_of_python(name)].add(
            found["covered_lines"],
            found["num_statements"],
            found["covered_branches"],
            found["num_branches"],
        )
    return counts


def verdict(counts: dict[str, Count], floors: dict[str, list[int]]) -> Iterator[str]:
    """What is wrong: a line each."""
    for room in sorted(counts.keys() | floors.keys()):
        if room not in floors:
            lines, branches = map(math.floor, counts[room].percent)
            yield f"{room} has no floor: write '\"{room}\" = [{lines}, {branches}]' into {FLOORS.name}"
        elif room not in counts:
            yield f"{room} is no room any more: take its floor out of {FLOORS.name}"
        else:
            for what, reached, floor in zip(
                ("lines", "branches"), counts[room].percent, floors[room], strict=True
            ):
                if reached < floor:
                    yield f"{room}: the tests reach {reached:.1f} % of its {what}, and are to reach {floor} %"


def table(counts: dict[str, Count]) -> Iterator[str]:
    yield f"{'room':<28}{'lines':>8}{'of':>8}{'branches':>10}{'of':>8}"
    everything = Count()
    for room, count in sorted(counts.items()):
        everything.add(count.lines, count.all_lines, count.branches, count.all_branches)
        yield row(room, count)
    yield row("all", everything)


def row(room: str, count: Count) -> str:
    lines, branches = count.percent
    return f"{room:<28}{lines:>7.1f}%{count.all_lines:>8}{branches:>9.1f}%{count.all_branches:>8}"


def main() -> int:
    counts = rooms()
    print(*table(counts), sep="\n")
    wrong = list(verdict(counts, tomllib.loads(FLOORS.read_text())))
    print(*(f"coverage: {each}" for each in wrong), sep="\n", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
